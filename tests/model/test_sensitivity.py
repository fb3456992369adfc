"""Derivatives of answers along their inputs: against formulas, and on the command line; against differences of answers
in test_parallel_taylor."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import run_coulomb
from drawn_block import weights

import coulomb
from coulomb.solvers import derivatives

STEEL = (2.119e11, 0.277)


def block(friction=1.0, gap=1.0, top=1.0, right=1.0, young=1.0):
    """Clamped on the left, pressed and drawn: nodes that are open, stick and slip."""
    return coulomb.ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (6, 2, 2)),
        coulomb.Material(young * STEEL[0], STEEL[1]),
        [coulomb.Clamp("left")],
        coulomb.Contact("bottom", friction=0.3 * friction, gap=2e-6 * gap),
        [coulomb.Traction("top", (0.0, 1e7 * top, -4e7 * top)), coulomb.Traction("right", (2e7 * right, 0.0, 0.0))],
    )


def pair(friction=1.0, pushed=1.0, rubber=1.0, steel=1.0):
    """Two bodies on each other, the upper one pushed down and along."""
    upper = coulomb.moved(coulomb.box((0.8, 0.8, 0.4), (3, 3, 2)), translate=(0.1, 0.1, 0.5))
    return coulomb.ContactProblem(
        coulomb.join(lower=coulomb.box((1.0, 1.0, 0.5), (2, 2, 2)), upper=upper),
        {"lower": coulomb.Material(3e6 * steel, 0.3), "upper": coulomb.Material(1e6 * rubber, 0.3)},
        [
            coulomb.Clamp("lower:bottom"),
            coulomb.PrescribedDisplacement("upper:top", (0.008 * pushed, 0.0, -0.01 * pushed)),
        ],
        coulomb.Contact("upper:bottom", friction=0.2 * friction, against="lower:top"),
        small_strain="warn",
    )


def free(friction=1.0, load=1.0, young=1.0):
    """A block that contact alone holds, pressed out of the middle and pushed below the bound of friction."""
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)),
        coulomb.Material(young * STEEL[0], STEEL[1]),
        [],
        coulomb.Contact("bottom", friction=0.3 * friction),
        [coulomb.PointLoad("top", (1e5 * load, 0.0, -1e6 * load), point=(0.55, 0.48, 0.5))],
    )


def bonded(friction=1.0, cohesion=1.0, limit=1.0, pushed=1.0, young=1.0):
    """With a cohesion, and a limit that friction reaches where the pressure is large."""
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (4, 4, 2)),
        coulomb.Material(young * 1e9, 0.3),
        [coulomb.PrescribedDisplacement("top", (2e-3 * pushed, 0.0, -3e-4 * pushed))],
        coulomb.Contact("bottom", friction=0.3 * friction, cohesion=1e5 * cohesion, friction_limit=4e5 * limit),
    )


def heated(friction=1.0, pushed=1.0, lower=1.0, upper=1.0, hot=1.0):
    """Two bodies tied to each other, of different expansion: thermal forces are in proportion to Young's modulus; one
    is nearly incompressible, and changes its volumes by their means."""
    upper_body = coulomb.moved(coulomb.box((1.0, 1.0, 0.3), (2, 2, 1)), translate=(0.0, 0.0, 0.3))
    return coulomb.ContactProblem(
        coulomb.join(a=coulomb.box((1.0, 1.0, 0.3), (3, 3, 1)), b=upper_body),
        {
            "a": coulomb.Material(lower * 1e9, 0.47, expansion=1e-5),
            "b": coulomb.Material(upper * 3e9, 0.2, expansion=3e-5),
        },
        [coulomb.Clamp("b:top")],
        coulomb.Contact("a:bottom", friction=0.2 * friction),
        [coulomb.TotalForce("a:left", (2e5 * pushed, 0.0, 0.0))],
        temperature=40.0 * hot,
        ties=[coulomb.Tied("a:top", "b:bottom")],
    )


@pytest.mark.parametrize("softness", [1e-5, 1e-8])
def test_on_soft_springs(softness):
    """Which give a body that contact holds motions of 1/softness times what the same forces do to it.  Adjoint and
    forward agree, and are those of two stiffer springs, extrapolated: softness does to the answer what it is."""

    def derivatives_of(softness):
        answer = coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (4, 4, 2)),
            coulomb.Material(2e11, 0.3),
            [],
            coulomb.Contact("bottom", friction=0.3),
            [coulomb.Pressure("top", 1e7), coulomb.Traction("right", (1e6, 1e6, 0.0))],
            springs=[coulomb.Spring("top", 2e11 * softness)],
        ).solve(tolerance=1e-12)
        of_x, of_u = weights(answer)
        gradient = answer.gradient(of_x, of_u)
        (pressing, _) = (one.forces for one in answer.problem.elasticity.loads_in(answer.problem.loading))
        found = {one.name: one for one in answer.sensitivities()}["pressure on 'top'"]
        return of_x @ found.contact_force + np.sum(of_u * found.displacement), np.sum(gradient.load * pressing)

    forward, adjoint = derivatives_of(softness)
    stiff, stiffer = (derivatives_of(one)[0] for one in (1e-4, 2e-4))
    assert adjoint == pytest.approx(forward, rel=1e-9)
    assert forward == pytest.approx(stiff + (stiff - stiffer) * (1.0 - softness / 1e-4), rel=1e-7)


def test_with_the_compliance_as_a_matrix_they_are_the_same(monkeypatch):
    """Of a body that contact alone holds, with A as a matrix and with its low-rank approximation."""
    answer, found = free().solve(tolerance=1e-12), []
    for formed in (4000, 0):
        monkeypatch.setattr(derivatives, "_FORMED", formed)
        found.append(answer.sensitivities())
    for one, other in zip(*found, strict=True):
        size = np.linalg.norm(answer.contact_force)
        assert one.contact_force == pytest.approx(other.contact_force, abs=1e-9 * size), one.name


def test_a_body_that_contact_alone_holds_changes_first_where_differences_say():
    """By forces over their bounds and slips of answers nearby, to first order."""
    h, before = 1e-5, free().solve(tolerance=1e-12)
    slips = before.at_nodes.status == 2

    def margins(friction):
        at = free(friction=friction).solve(tolerance=1e-12).at_nodes
        left = 0.3 * friction * at.force[:, 0] - np.linalg.norm(at.force[:, 1:], axis=1)
        return np.concatenate([at.force[:, 0], left[~slips], np.linalg.norm(at.slip[slips], axis=-1)])

    rates = (margins(1.0 + h) - margins(1.0 - h)) / (2.0 * h)
    step = next(one.step for one in before.sensitivities() if one.name.startswith("friction"))
    assert step == pytest.approx(np.min(np.abs(margins(1.0) / rates)), rel=1e-3)


def test_forces_are_homogeneous():
    """Of degree 1 in loads and gaps together (Euler), and in Young's moduli and gaps where loads are given."""
    answer = block().solve(tolerance=1e-12)
    by = {one.name: one.contact_force for one in answer.sensitivities()}
    size = np.abs(answer.contact_force).max()
    loads = by["traction on 'top'"] + by["traction on 'right'"]
    assert loads + by["gap of 'bottom'"] == pytest.approx(answer.contact_force, abs=1e-8 * size)
    assert by["young"] == pytest.approx(by["gap of 'bottom'"], abs=1e-8 * size)


def test_a_sliding_block_has_friction_in_proportion_to_its_coefficient():
    """T = F N, with N by the weight on top: dT/dlog F = T, and neither stiffness nor way changes it, but for the
    directions of slip, 1e-4 apart.  Its work is F N (s - c N / E), c of the block and F."""
    problem = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)),
        coulomb.Material(1e9, 0.0),
        [coulomb.PrescribedDisplacement("top", (0.01, 0.0, 0.0), components="xy")],
        coulomb.Contact("bottom", friction=0.3),
        [coulomb.TotalForce("top", (0.0, 0.0, -1e6))],
    )
    answer = problem.solve(tolerance=1e-11)
    by = {one.name: one.totals["bottom"] for one in answer.sensitivities()}
    assert by["friction of 'bottom'"]["friction_force"] == pytest.approx(3e5, rel=1e-7)
    assert by["friction of 'bottom'"]["normal_force"] == pytest.approx(0.0, abs=1e-2)
    assert by["total force on 'top'"]["friction_force"] == pytest.approx(3e5, rel=1e-7)
    for name in ("young", "prescribed displacements"):
        assert by[name]["friction_force"] == pytest.approx(0.0, abs=0.1)
    work, way = {name: one["dissipated_energy"] for name, one in by.items()}, 3e5 * 0.01
    left = answer.forces["dissipated_energy"]
    assert work["prescribed displacements"] == pytest.approx(way, rel=1e-4)
    assert work["young"] == pytest.approx(way - left, rel=1e-3)
    assert work["total force on 'top'"] == pytest.approx(left - work["young"], rel=1e-8)


def test_on_the_command_line_and_where_it_is_refused(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text(
        "[mesh]\nbox = [1.0, 1.0, 0.5]\ncells = [2, 2, 1]\n[material]\nyoung = 1e9\npoisson = 0.3\nexpansion = 1e-5\n"
        "[temperature]\nvalue = 30.0\nreference = 20.0\n"
        '[[total_force]]\nface = "top"\nforce = [1e5, 0.0, -1e6]\n[contact]\nface = "bottom"\nfriction = 0.3\n'
        '[[probe]]\nname = "corner"\npoint = [1.0, 1.0, 0.5]\n[output]\npicture = false\n'
    )
    done = run_coulomb("run", case, "--sensitivity", "--verify", cwd=tmp_path)
    assert "1 % more of an input does to the forces of 'bottom'" in done.stdout
    assert "and to the strain energy:" in done.stdout and "and to the displacement of probe 'corner':" in done.stdout
    assert "and to the contact area of 'bottom':\n  length" in done.stdout
    entries = json.loads((tmp_path / "results" / "summary.json").read_text())["sensitivity"]
    assert [entry["verified"]["passed"] for entry in entries] == [True] * len(entries), entries
    by = {entry["input"]: entry["totals"]["bottom"] for entry in entries}
    assert by["total force on 'top'"]["normal_force"] == pytest.approx(1e6, rel=1e-9)
    assert by["total force on 'top'"]["force"] == pytest.approx([-1e5, 0.0, 1e6], rel=1e-9, abs=1e-3)
    assert [by[f"length {axis}"]["normal_force"] for axis in "xyz"] == pytest.approx([0.0] * 3, abs=0.1)
    refused = run_coulomb("run", case, "--verify", cwd=tmp_path, code=2)
    assert "verify is about sensitivity: give both" in refused.stderr


def test_a_list_of_inputs_names_those_of_the_table_and_places_of_numbers(tmp_path):
    """A number that is an input alone has its name; those of the list are what they are without it."""
    (tmp_path / "case.toml").write_text(
        "[mesh]\nbox = [1.0, 1.0, 0.5]\ncells = [2, 2, 1]\n[material]\nyoung = 1e9\npoisson = 0.3\n"
        '[[total_force]]\nface = "top"\nforce = [1e5, 0.0, -1e6]\n[contact]\nface = "bottom"\nfriction = 0.3\n'
        "friction_tolerance = 0.05\n[output]\npicture = false\n"
    )

    def entries(*words):
        done = run_coulomb("run", "case.toml", *words, cwd=tmp_path)
        for name in ("length y", "young") if words[0] == "--set" else ():  # loads alone make the forces
            assert f"  {name:<25} normal 0 N          friction 0 N " in done.stdout
        contents = json.loads((tmp_path / "results" / "summary.json").read_text())
        slips = {one["input"]: one["totals"]["bottom"]["greatest_slip"] for one in contents["sensitivity"]}
        return slips, contents["input_bars"]["bottom"]["greatest_slip"]

    wanted = ["material.young", "length y", "material.poisson"]
    found, bars = entries("--set", f"output.sensitivity={json.dumps(wanted)}")
    assert list(found) == ["friction of 'bottom'", "young", "length y", "material.poisson"]  # one has a tolerance
    every, of_all = entries("--sensitivity")
    poisson = found.pop("material.poisson")
    assert found == pytest.approx({name: every[name] for name in found}, rel=1e-9) and len(every) > len(found)
    assert bars == pytest.approx(of_all, rel=1e-9)
    more, less = (
        json.loads((tmp_path / f"{nu}" / "summary.json").read_text())["totals"]["greatest_slip"]
        for nu in (0.301, 0.299)
        if run_coulomb("run", "case.toml", "--set", f"material.poisson={nu}", "--output", f"{nu}", cwd=tmp_path)
    )
    assert poisson == pytest.approx(0.3 * (more - less) / 0.002, rel=1e-3)
    for wrong in ("frction of 'bottom'", "contact.gap", "mesh.cells.0"):
        given = f"output.sensitivity={json.dumps(['young', wrong])}"
        refused = run_coulomb("run", "case.toml", "--set", given, cwd=tmp_path, code=2)
        assert f'there is no input "{wrong}"' in refused.stderr.replace("'" + wrong + "'", f'"{wrong}"')
        assert (
            "there are friction of 'bottom', total force on 'top', young, length x, length y, length z"
            in refused.stderr
        )
    for wrong in ("[]", '"young"', "[3]"):
        refused = run_coulomb("run", "case.toml", "--set", f"output.sensitivity={wrong}", cwd=tmp_path, code=2)
        assert "should be true, false, or a list of inputs" in refused.stderr


EVERYTHING = """
[[body]]
name = "low"
box = [1.0, 1.0, 0.5]
cells = [2, 2, 1]
material = { young = 1e9, poisson = 0.3 }
[[body]]
name = "up"
box = [0.8, 0.8, 0.4]
cells = [2, 1, 1]
translate = [0.1, 0.1, 0.501]
material = { young = 2e9, poisson = 0.2 }
[[spring]]
face = "low:left"
stiffness = [1e8, 1e8, 1e8]
[[clamp]]
face = "up:top"
value = [1e-4, 0.0, -2e-3]
amplitude = [[0, 0], [1, 1]]
[[traction]]
face = "up:right"
value = ["1e5 * (1 + y)", 0.0, 0.0]
[[total_force]]
face = "low:right"
force = [1e4, 0.0, 0.0]
[[point_load]]
face = "low:left"
force = [1e3, 0.0, 0.0]
moment = [0.0, 1e2, 0.0]
[[contact]]
face = "up:bottom"
against = "low:top"
friction = { pressure = [0.0, 1e7], coefficient = [0.3, 0.2] }
gap = "1e-4 * (1 + x)"
[[contact]]
face = "low:bottom"
friction = "0.3 + 0.1 * x"
cohesion = 1e3
foundation = { normal = [0.0, 0.0, 1.0], point = [0.0, 0.0, 0.0] }
motion = [[0, 0, 0, 0], [1, 1e-4, 0, 1e-4]]
[history]
end = 1
steps = 1
[output]
picture = false
"""


def test_each_input_of_a_case_is_verified_by_answers_of_the_changed_case(tmp_path):
    """With a derivative that is a tenth too large, none that matters."""
    from coulomb.case.case import read_case
    from coulomb.case.scaled import inputs_in
    from coulomb.cli import bars
    from coulomb.cli.bars import sensitivity_entries

    case = tmp_path / "case.toml"
    case.write_text(EVERYTHING)
    settings = read_case(case)
    found = []
    for step in settings.load_history().steps(settings.problem()):
        found = step.solution.sensitivities(found)
    assert {one.name for one in found} < set(inputs_in(settings, step.solution.problem.surface.faces))
    some = step.solution.sensitivities([], only=lambda name: name.startswith("young"))
    assert [one.name for one in some] == ["young of 'low'", "young of 'up'"]
    verify = bars.TaylorTest(settings, step.solution)
    results = {one.name: verify.of(one) for one in found}
    assert len(results) >= 10 and all(one["passed"] for one in results.values())
    one = next(one for one in found if one.name == "prescribed displacements")
    twice = settings.model_copy(update={"total_force": settings.total_force * 2})
    force = next(one for one in found if one.name.startswith("total force"))
    assert bars.TaylorTest(twice, step.solution).of(force)["words"] == "not verified: there are several of this name"
    wrong = verify.of(replace(one, contact_force=1.1 * one.contact_force))
    assert wrong["passed"] is False and "NOT VERIFIED" in wrong["words"]
    assert verify.of(replace(one, displacement=1.1 * one.displacement))["passed"] is False
    assert sensitivity_entries(found)["sensitivity"][0]["reactions"]


def test_of_a_history_with_reversal_along_its_steps():
    """Pressed, pulled until most of it slips, and pushed back: slip counts from where the step before has ended."""

    def steps(friction=0.4, pressed=1.0, pulled=1.0, young=1.0):
        problem = coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (4, 3, 2)),
            coulomb.Material(1e9 * young, 0.3),
            [
                coulomb.PrescribedDisplacement(
                    "right", (2.5e-3 * pulled, 0.0, 0.0), "x", amplitude=[(1.0, 0.0), (2.0, 1.0), (3.0, 0.2)]
                )
            ],
            coulomb.Contact("bottom", friction=friction),
            [coulomb.Pressure("top", 2e6 * pressed, amplitude=[(0.0, 0.0), (1.0, 1.0), (3.0, 0.8)])],
        )
        return coulomb.LoadHistory([1.0, 2.0, 3.0], tolerance=1e-12).steps(problem)

    found = []
    for step in steps():
        if found:
            with pytest.raises(ValueError, match="those of the step before"):
                step.solution.sensitivities()
        found = step.solution.sensitivities(found)
    answer = step.solution
    inputs = {"friction of 'bottom'": "friction", "pressure on 'top'": "pressed", "young": "young"}
    inputs["prescribed displacements"] = "pulled"
    assert {one.name for one in found} == set(inputs)
    status = answer.at_nodes.status
    assert len(np.unique(status)) > 1
    for one in found:
        key, h = inputs[one.name], min(1e-4, 0.1 * one.step)
        value = {"friction": 0.4}.get(key, 1.0)
        more, less = ([s.solution for s in steps(**{key: value * (1.0 + d)})][-1] for d in (h, -h))
        change = (more.contact_force - less.contact_force) / (2.0 * h)
        assert one.contact_force == pytest.approx(change, abs=1e-6 * np.linalg.norm(answer.contact_force)), one.name
        change = (more.displacement - less.displacement) / (2.0 * h)
        assert one.displacement == pytest.approx(change, abs=1e-6 * np.abs(answer.displacement).max()), one.name


def test_tolerances_of_inputs_along_a_history_on_the_command_line(tmp_path):
    """Of a block that slides from the second step on with T = F N: 10 % of F and 3 % of N make 10.4 % of T, nu none."""
    case = tmp_path / "case.toml"
    case.write_text(
        "[mesh]\nbox = [1.0, 1.0, 0.5]\ncells = [2, 2, 1]\n[material]\nyoung = 1e9\nyoung_tolerance = 5e7\n"
        'poisson = 0.1\npoisson_tolerance = 0.05\n[[pressure]]\nface = "top"\nvalue = 1e6\nvalue_tolerance = 3e4\n'
        'amplitude = [[0, 0], [1, 1], [2, 1]]\n[[prescribed_displacement]]\nface = "top"\ncomponents = "xy"\n'
        "value = [0.1, 0.0, 0.0]\nvalue_tolerance = [0.002, 0.0, 0.0]\namplitude = [[1, 0], [2, 1]]\n"
        '[contact]\nface = "bottom"\nfriction = 0.3\nfriction_tolerance = 0.03\n'
        "[history]\nend = 2\nsteps = 2\n[output]\npicture = false\n"
    )
    done = run_coulomb("run", case, "--report", "--sensitivity", cwd=tmp_path)
    assert "Which input matters" in (tmp_path / "results" / "report.html").read_text()
    assert "with the tolerances given" in done.stdout and "no bar has" not in done.stderr
    summary = json.loads((tmp_path / "results" / "steps" / "0002" / "summary.json").read_text())
    bars = summary["input_bars"]["bottom"]
    assert bars["friction_force"] == pytest.approx(3e5 * np.hypot(0.1, 0.03), rel=1e-4)
    assert bars["normal_force"] == pytest.approx(1e6 * 0.03, rel=1e-9)
    assert "material.poisson" in [one["input"] for one in summary["sensitivity"]]
    assert json.loads((tmp_path / "results" / "case.json").read_text())["contact"]["friction_tolerance"] == 0.03


def test_the_gradient_along_a_field_of_friction():
    """The normal force on the middle of the face, along friction that grows with x."""

    def answer(slope=0.0):
        made = coulomb.ContactProblem(
            coulomb.box((3.0, 1.0, 1.0), (6, 2, 2)),
            coulomb.Material(*STEEL),
            [coulomb.Clamp("left")],
            coulomb.Contact("bottom", friction=lambda x: 0.3 + slope * x[0]),
            [coulomb.Traction("top", (0.0, 1e7, -4e7)), coulomb.Traction("right", (2e7, 0.0, 0.0))],
        )
        return made.solve(tolerance=1e-12)

    there = answer()
    place = there.at_nodes.x
    of_x = np.zeros_like(there.contact_force)
    of_x[0::3] = np.abs(place[:, 0] - 1.5) < 0.6
    more, less = (of_x @ answer(h).contact_force for h in (1e-5, -1e-5))
    found = there.gradient(of_x).friction
    assert found @ place[:, 0] == pytest.approx((more - less) / 2e-5, rel=1e-5)


def test_along_the_motion_of_a_plane():
    """Of a tilted one that comes, and rubs to and fro: normal along all of its way, slip along that of the step."""

    def steps(far=1.0):
        problem = coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (4, 3, 2)),
            coulomb.Material(1e9, 0.3),
            [coulomb.Clamp("top")],
            coulomb.Contact(
                "bottom",
                friction=0.4,
                foundation=coulomb.Plane((0.0, 0.0, 0.0), (0.1, 0.0, 1.0)),
                motion=lambda t: far * np.array([2e-3 * (t - 1.0 if t < 2.0 else 3.0 - t), 0.0, 2e-3 + 1e-4 * t]),
            ),
            small_strain="warn",
        )
        return coulomb.LoadHistory([1.0, 2.0, 3.0], tolerance=1e-12).steps(problem)

    found = []
    for step in steps():
        found = step.solution.sensitivities(found)
    (along,) = (one.contact_force for one in found if one.name == "motion of the foundation of 'bottom'")
    more, less = ([step.solution.contact_force for step in steps(1.0 + h)][-1] for h in (1e-4, -1e-4))
    assert along == pytest.approx((more - less) / 2e-4, abs=1e-7 * np.linalg.norm(along))


def test_at_the_border_of_two_states_each_direction_has_its_own():
    """A contact point sticks exactly at its bound, and others touch without a force: along each input, answers on
    either side."""

    def sheared(friction=10.0, pressed=1.0, sheared=1.0):
        return coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (3, 2, 2)),
            coulomb.Material(1e9, 0.3),
            [coulomb.PrescribedDisplacement("top", (2e-3 * sheared, 0.0, -4e-3))],
            coulomb.Contact("bottom", friction=friction),
            [coulomb.Pressure("right", 1e7 * pressed)],
        ).solve(tolerance=1e-13)

    x = sheared().contact_force.reshape(-1, 3)
    bound = float(np.max(np.hypot(x[:, 1], x[:, 2]) / x[:, 0]))
    answer = sheared(friction=bound)
    inputs = {"friction of 'bottom'": ("friction", bound), "pressure on 'right'": ("pressed", 1.0)}
    inputs["prescribed displacements"] = "sheared", 1.0
    found = {one.name: one for one in answer.sensitivities()}
    apart = 0.0
    for name in ("friction of 'bottom'", "pressure on 'right'"):
        one, (key, value) = found[name], inputs[name]
        assert one.border > 0 and one.falling is not None
        for side, h in ((one, 1e-4), (one.falling, -1e-4)):
            assert side.step > 1e-4
            change = (sheared(**{"friction": bound, key: value * (1.0 + h)}).contact_force - answer.contact_force) / h
            assert side.contact_force == pytest.approx(change, abs=1e-3 * np.linalg.norm(change) + 1.0), (name, h)
        apart = max(apart, float(np.linalg.norm(one.contact_force - one.falling.contact_force)))
    assert apart > 1e-2 * np.linalg.norm(found["friction of 'bottom'"].falling.contact_force) > 0.0


@pytest.mark.parametrize("aside", [0.0, 1e-4])
def test_a_body_that_just_touches_has_forces_on_one_side_only(aside):
    """Further by the part h of its way g it is pressed by E A g h/height, and what has slipped before it touched rubs
    with F times that; back by as much there is nothing."""
    problem = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (2, 2, 1)),
        coulomb.Material(1e9, 0.0),
        [coulomb.PrescribedDisplacement("top", (aside, 0.0, -1e-3))],
        coulomb.Contact("bottom", friction=0.02, gap=1e-3),
    )
    answer = problem.solve()
    assert not np.any(answer.contact_force)
    (one,) = (one for one in answer.sensitivities() if one.name == "prescribed displacements")
    assert one.border == 9
    further, back = np.array(one.totals["bottom"]["force"]), np.array(one.falling.totals["bottom"]["force"])
    assert further == pytest.approx([-0.02 * 2e6 if aside else 0.0, 0.0, 2e6], abs=1e-3)
    assert back == pytest.approx(np.zeros(3), abs=1e-3)
    rubs = 0.02 * 2e6 if aside else 0.0
    assert one.totals["bottom"]["friction_force"] == pytest.approx(rubs, abs=1e-3)
    assert one.falling.totals["bottom"]["friction_force"] == pytest.approx(0.0, abs=1e-3)
