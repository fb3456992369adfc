"""Derivatives of totals of answers other than forces of contact, against differences of answers and formulas."""

import numpy as np
import pytest

import coulomb
from coulomb.cli.bars import input_bars
from coulomb.pictures.report import words


def sprung(stiffness=1.0, pushed=1.0, young=1.0):
    """A block on springs, held on one side, with probes."""
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)),
        coulomb.Material(1e9 * young, 0.3),
        [coulomb.PrescribedDisplacement("left", (1e-3, 0.0, 1e-4))],
        coulomb.Contact("bottom", friction=0.3),
        [coulomb.Pressure("top", 1e7 * pushed)],
        springs=[coulomb.Spring("right", (2e8 * stiffness, 3e8 * stiffness, 1e8 * stiffness))],
        probes=[coulomb.Probe("above", (0.5, 0.5, 0.5)), coulomb.Probe("below", (0.9, 0.4, 0.0))],
    )


def turned(pushed=1.0, moved=1.0, young=1.0, friction=0.3):
    """A block with a rigid side, of which a motion is given."""
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)),
        coulomb.Material(1e9 * young, 0.3),
        [],
        coulomb.Contact("bottom", friction=friction),
        [coulomb.TotalForce("top", (0.5e5 * pushed, 0.0, -1e6 * pushed))],
        rigid_faces=[coulomb.RigidFace("right", translation=(1e-4 * moved, None, None))],
    )


def bolted(force=1.0, young=1.0):
    """Two blocks on each other, tightened by a section between them; supports hold nodes on which it pulls."""
    upper = coulomb.moved(coulomb.box((0.3, 0.3, 0.4), (2, 2, 2)), translate=(0.1, 0.1, 0.5))
    return coulomb.ContactProblem(
        coulomb.join(low=coulomb.box((0.5, 0.5, 0.5), (3, 3, 2)), up=upper),
        {"low": coulomb.Material(2e11, 0.3), "up": coulomb.Material(2e11 * young, 0.3)},
        [coulomb.PrescribedDisplacement("up:top", (1e-5, 0.0, 0.0)), coulomb.Clamp("low:left", "z")],
        coulomb.Contact("low:bottom", friction=0.3),
        [coulomb.TotalForce("low:right", (1e3, 0.0, -2e3))],
        ties=[coulomb.Pretension("up:bottom", "low:top", force=-1e5 * force)],
    )


def tightened(one=1.0, two=1.0):
    """A block that two bolts pull onto the ground, between which it is lifted."""
    names = "one", "two"
    columns = {
        name: coulomb.moved(coulomb.box((0.1, 0.2, 0.3), (1, 1, 1)), translate=(0.6 * k + 0.1, 0.1, 0.2))
        for k, name in enumerate(names)
    }
    forces = {"one": 3e5 * one, "two": 2e5 * two}
    return coulomb.ContactProblem(
        coulomb.join(low=coulomb.box((0.9, 0.4, 0.2), (9, 4, 2)), **columns),
        coulomb.Material(2e11, 0.3),
        [coulomb.Clamp(f"{name}:top") for name in names],
        coulomb.Contact("low:bottom", friction=0.3),
        [coulomb.TotalForce("low:right", (2e4, 0.0, 3e4))],
        ties=[coulomb.Pretension(f"{name}:bottom", "low:top", force=-forces[name]) for name in names],
    )


def glued(pushed=1.0, young=1.0, moved=1.0):
    """A block that is tied to another, which lies on the ground, and held aside."""
    upper = coulomb.moved(coulomb.box((0.3, 0.3, 0.4), (2, 2, 2)), translate=(0.1, 0.1, 0.5))
    return coulomb.ContactProblem(
        coulomb.join(low=coulomb.box((0.5, 0.5, 0.5), (3, 3, 2)), up=upper),
        {"low": coulomb.Material(2e9, 0.3), "up": coulomb.Material(1e9 * young, 0.3)},
        [coulomb.PrescribedDisplacement("up:right", (2e-4 * moved, 0.0, 0.0), "x")],
        coulomb.Contact("low:bottom", friction=0.3),
        [coulomb.TotalForce("up:top", (0.0, 3e4 * pushed, -2e5 * pushed))],
        ties=[coulomb.Tied("up:bottom", "low:top")],
    )


def other_totals(answer):
    """Of reactions, probes, ties, bolts, rigid faces and bodies, and the largest values of contact, by kind, name and
    what it is."""
    kinds = {name: getattr(answer, name) for name in ("reactions", "ties", "bolts", "rigid_faces")}
    named = [(kind, getattr(one, "name", None) or one.face, one) for kind, some in kinds.items() for one in some]
    named += [("probes", one.name, one) for one in answer.probes]
    wanted = ("force", "moment", "translation", "rotation", "shortening", "displacement", "slip", "pressure")
    wanted += ("shear", "bending", "torsion")
    found = {(k, name, of): getattr(one, of, None) for k, name, one in named for of in wanted}
    for name in ("greatest_slip", "greatest_pressure", "friction_force"):
        if (
            name != "greatest_pressure" or not answer.rigid_faces
        ):  # at nodes of a rigid face only their resultants count
            found["totals", answer.at_nodes.faces[0], name] = answer.forces[name]
    for one in answer.problem.elasticity.members:
        found["bodies", one.name, "strain_energy"] = one.body.strain_energy(answer.displacement[one.nodes])
    return {key: np.asarray(value, dtype=float) for key, value in found.items() if value is not None}


def test_strain_energy_and_pressures_of_a_block_under_given_forces():
    """Without gaps the answer is in proportion to the forces, and displacements to 1/E: the energy is so to F^2 and 1/E
    (half the work of the forces less that of friction), mean pressure to F, and the centre of pressure stays."""
    answer = turned(moved=0.0).solve(tolerance=1e-12)
    by, place = {one.name: one for one in answer.sensitivities()}, answer.forces["centre_of_pressure"]
    energy = answer.problem.elasticity.alone.strain_energy(answer.displacement)
    work = np.sum(answer.evidence.load * answer.displacement) - answer.forces["dissipated_energy"]
    assert energy == pytest.approx(0.5 * work, rel=1e-8)
    pressed, young = by["total force on 'top'"], by["young"]
    assert pressed.others["bodies"][""]["strain_energy"] == pytest.approx(2.0 * energy, rel=1e-8)
    assert young.others["bodies"][""]["strain_energy"] == pytest.approx(-energy, rel=1e-8)
    totals, forces = pressed.totals["bottom"], answer.forces
    assert totals["mean_pressure"] == pytest.approx(forces["normal_force"] / forces["contact_area"], rel=1e-8)
    assert totals["contact_area"] == 0.0
    assert totals["centre_of_pressure"] == pytest.approx(np.zeros(3), abs=1e-8)
    change, h = by["friction of 'bottom'"].totals["bottom"]["centre_of_pressure"], 1e-4
    more, less = (
        np.array(turned(moved=0.0, friction=0.3 + d).solve(tolerance=1e-12).forces["centre_of_pressure"])
        for d in (0.3 * h, -0.3 * h)
    )
    assert change == pytest.approx((more - less) / (2.0 * h), abs=1e-6 * np.linalg.norm(place))
    assert np.linalg.norm(change) > 1e-4


def test_along_lengths_of_a_box():
    """Pressed by a way w, N = E a b w/c with energy N w/2 and the centre of pressure in the middle: exact without
    Poisson's ratio.  With it, and friction, central differences; the ball is a length as well."""

    def pressed(x=1.0, y=1.0, z=1.0, ball=1.0, poisson=0.0, aside=0.0):
        return coulomb.ContactProblem(
            coulomb.box((1.0 * x, 2.0 * y, 0.5 * z), (2, 3, 2)),
            coulomb.Material(1e9, poisson),
            [coulomb.PrescribedDisplacement("top", (aside, 0.0, -1e-3))],
            coulomb.Contact(
                "bottom",
                friction=0.3,
                cohesion=1e4 * aside / 1e-3,
                foundation=coulomb.Sphere((0.5, 1.0, -500.0 * ball), 500.0 * ball) if aside else None,
            ),
            [coulomb.Pressure("right", 5e8 * aside)],
            small_strain="warn",
        )

    def along(answer, names, **given):
        others = {name: lambda factor, name=name: pressed(**{name: factor}, **given) for name in names}
        return {one.name: one for one in answer.sensitivities(others=others) if one.name in others}

    found, force = along(pressed().solve(), "xyz"), 1e9 * 2.0 * 1e-3 / 0.5
    for name, power in (("x", 1.0), ("y", 1.0), ("z", -1.0)):
        totals, others = found[name].totals["bottom"], found[name].others
        assert totals["normal_force"] == pytest.approx(power * force, rel=1e-7)
        assert totals["contact_area"] == pytest.approx(max(power, 0.0) * 2.0, abs=1e-7)
        assert totals["mean_pressure"] == pytest.approx(min(power, 0.0) * force / 2.0, abs=1e-7 * force)
        assert others["bodies"][""]["strain_energy"] == pytest.approx(power * force * 5e-4, rel=1e-7)
        middle = np.array([0.5 * (name == "x"), name == "y", 0.0])
        assert totals["centre_of_pressure"] == pytest.approx(middle, abs=1e-7)
        (reaction,) = others["reactions"].values()
        change = power * np.cross([0.5, 1.0, 0.5], [0.0, 0.0, -force]) + np.cross(middle, [0.0, 0.0, -force])
        assert reaction["moment"] == pytest.approx(change, abs=1e-6 * force)
    given, h = {"poisson": 0.3, "aside": 4e-4}, 1e-5
    answer = pressed(**given).solve(tolerance=1e-12)
    assert len(np.unique(answer.at_nodes.status)) == 3
    for name, one in along(answer, ("x", "y", "z", "ball"), **given).items():
        assert one.step > h
        more, less = (pressed(**{name: 1.0 + d}, **given).solve(tolerance=1e-12) for d in (h, -h))
        change = (more.contact_force - less.contact_force) / (2.0 * h)
        assert one.contact_force == pytest.approx(change, abs=1e-5 * np.abs(change).max()), name
        for key in ("force", "moment", "dissipated_energy", "centre_of_pressure", "mean_pressure"):
            pressure = key == "mean_pressure"
            of = [
                np.array(one.forces["normal_force"] / one.forces["contact_area"] if pressure else one.forces[key])
                for one in (more, less)
            ]
            change = (of[0] - of[1]) / (2.0 * h)
            size = max(np.abs(change).max(), np.abs(of[0]).max())
            assert one.totals["bottom"][key] == pytest.approx(change, abs=1e-5 * size), (name, key)


def test_where_lengths_are_not_known():
    with pytest.raises(ValueError, match="not known with ties, rigid faces, bolts and springs"):
        sprung().solve().sensitivities(others={"x": lambda factor: sprung()})


@pytest.mark.parametrize(
    "make, inputs",
    [
        (sprung, {"stiffness of the spring on 'right'": "stiffness", "pressure on 'top'": "pushed", "young": "young"}),
        (turned, {"total force on 'top'": "pushed", "prescribed displacements": "moved", "young": "young"}),
        (bolted, {"pretension of 'up:bottom'": "force", "young of 'up'": "young"}),
        (tightened, {"pretension of 'one:bottom'": "one", "pretension of 'two:bottom'": "two"}),
        (glued, {"total force on 'up:top'": "pushed", "young of 'up'": "young", "prescribed displacements": "moved"}),
    ],
)
def test_reactions_probes_ties_bolts_rigid_faces_and_energies_are_those_of_central_differences(make, inputs):
    answer = make().solve(tolerance=1e-12)
    values, by, h = other_totals(answer), {one.name: one for one in answer.sensitivities()}, 1e-4
    assert values
    for name, key in inputs.items():
        assert by[name].step > h
        more, less = (other_totals(make(**{key: 1.0 + d}).solve(tolerance=1e-12)) for d in (h, -h))
        for kind, called, of in values:
            found = np.asarray((by[name].others | {"totals": by[name].totals})[kind][called][of])
            size = max(np.abs(one).max() for (k, _, o), one in values.items() if (k, o) == (kind, of))
            difference = (more[kind, called, of] - less[kind, called, of]) / (2.0 * h)
            # of those that are 0; of torsion what the tolerance leaves of a bending moment of 5.6 kN m, over the step
            least = {"moment": 1e-6, "torsion": 1e-12 * 5600.0 / h}.get(of, 1e-9)
            assert found == pytest.approx(difference, abs=1e-5 * size + least), (name, kind, called, of)


def test_largest_values_and_sizes_have_two_derivatives_where_they_are_tied_or_zero():
    """Of a block pressed evenly its four corners slip alike, and friction has no resultant, until one side is lifted:
    exact on either side, so differences are one-sided, too."""

    def pressed(left=1.0):
        lifted = [coulomb.Traction("left", (0.0, 0.0, 1e3 * left)), coulomb.Traction("right", (0.0, 0.0, 1e3))]
        return coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 1.0), (2, 2, 1)),
            coulomb.Material(1e9, 0.3),
            [coulomb.Clamp("top", "xy")],
            coulomb.Contact("bottom", friction=0.3),
            [coulomb.Traction("top", (0.0, 0.0, -1e6)), *lifted],
        )

    answer, h = pressed().solve(tolerance=1e-12), 1e-4
    more, less = (pressed(1.0 + d).solve(tolerance=1e-12).forces for d in (h, -h))
    by = {one.name: one for one in answer.sensitivities()}
    one = by["traction on 'left'"]
    assert one.falling is not None and one.border == 0 and one.falling.contact_force is one.contact_force
    for name in ("greatest_slip", "greatest_pressure", "friction_force"):
        now, of = answer.forces[name], (found.totals["bottom"][name] for found in (one, one.falling))
        change, fallen = (more[name] - now) / h, (now - less[name]) / h
        assert list(of) == pytest.approx([change, fallen], rel=1e-4), name
        assert name == "greatest_pressure" or change > fallen + 1e-9
    assert all(by[name].falling is None for name in ("young", "traction on 'top'", "friction of 'bottom'"))


def test_tolerances_of_inputs_give_all_totals_a_bar():
    """The root of the sum of squares."""
    found = sprung().solve().sensitivities()
    by, tolerances = {one.name: one for one in found}, {"pressure on 'top'": 0.1, "young": 0.02}
    entries = input_bars(found, [(by[name], part) for name, part in tolerances.items()])
    for kind, called, of in (("probes", "below", "slip"), ("reactions", "spring_right", "force")):
        each = [tolerances[name] * np.array(by[name].others[kind][called][of]) for name in tolerances]
        bar = entries["other_input_bars"][kind][called][of]
        assert bar == pytest.approx(np.hypot(*each)) and max(bar) > 0.0
    normal = entries["input_bars"]["bottom"]["normal_force"]
    assert normal > 0.0
    of_mesh = [
        {"quantity": place, "value": 100.0 * normal, "error": normal, "order": None, "unit": "N"}
        for place in ("totals.normal_force", "strain_energy", "maximum.displacement")
    ]
    shown = [text for _, text, _ in words.bars_in_words(entries | {"error": {"bars": of_mesh}})]
    assert ["(mesh)" in one and "(inputs)" in one for one in shown] == [True, True, False]
    assert input_bars(found, [])["input_bars"]["bottom"]["force"] == [0.0, 0.0, 0.0]


def test_the_totals_beside_forces_are_listed_by_what_changes_them():
    """Largest first; without mean pressures where areas stay, and without what nothing changes or has no entry."""

    def entry(name, area, energy, flow, **others):
        totals = {"normal_force": 1.0, "contact_area": area, "mean_pressure": 50.0, "dissipated_energy": 0.0}
        bodies, flows = {"": {"strain_energy": energy}}, {"heat_film_front": {"power": flow}}
        return {"input": name, "totals": {"base": totals}, "bodies": bodies, "heat_flows": flows, **others}

    probes = {"tip": {"displacement": [3.0, 0.0, 4.0], "pressure": None}}
    small = [entry("young", 0.0, -2.0, 0.0, probes=probes), entry("friction", 0.0, 3.0, 7.0)]
    assert list(words.other_totals({"sensitivity": small})) == [
        ("strain energy", "J", {"friction": [0.03], "young": [-0.02]}),
        ("heat flow of 'film front'", "W", {"friction": [0.07]}),
        ("displacement of probe 'tip'", "m", {"young": [0.03, 0.0, 0.04]}),
    ]
    large = [entry("young", 2.0, 0.0, 0.0), entry("friction", 0.0, 0.0, 0.0)]
    assert [total for total, *_ in words.other_totals({"sensitivity": large})] == [
        "contact area of 'base'",
        "mean pressure of 'base'",
    ]
    assert not list(words.other_totals({}))
