"""Large motions against formulas, in rotated frames, over long ways, and what is refused."""

import pickle

import numpy as np
import pytest
from mpi4py import MPI
from rubber_blocks import LAME, MU, RubberBlock, side, stress
from scipy.optimize import brentq

import coulomb
from coulomb.fem.compat import fem, mesh, ufl
from coulomb.fem.contact.slip import _along_arc as along_arc
from coulomb.fem.geometry.rotations import rotation_matrix
from coulomb.kinematics import LargeMotions, NonlinearBody, mooney_rivlin, neo_hookean
from coulomb.linalg.reductions import Reductions
from coulomb.model.iterate import rigid_part
from coulomb.model.load_history import StepFailed


def down(depth, until=1.0):
    return lambda time, x: np.array([0.0 * x[0], 0.0 * x[0], 0.0 * x[0] - depth * min(time, until)])


def drawn(depth, way):
    """Down until time 1, then along x until time 2."""
    zero = down(depth)
    return lambda time, x: zero(time, x) + np.array([[way * min(max(time - 1.0, 0.0), 1.0)], [0.0], [0.0]])


def answers(body, contacts, times, **history):
    problem = LargeMotions(body, contacts)
    return [step.solution for step in coulomb.LoadHistory(times, **history).steps(problem)]


def force(solution):
    return np.array(solution.at_nodes.totals()["force"])


@pytest.mark.parametrize(
    "cell, degree, given, most",
    [
        ("hexahedron", 1, "energy", 6),
        ("hexahedron", 1, "residual", 6),
        ("hexahedron", 2, "energy", 6),
        ("tetrahedron", 1, "energy", 6),
        ("tetrahedron", 2, "energy", 6),
    ],
)
def test_a_block_between_smooth_plates_has_the_stress_of_the_formula(cell, degree, given, most):
    cells = (1, 1, 1) if degree == 2 else (2, 2, 2)
    one = RubberBlock(down(0.4), cells, cell=cell, degree=degree, components=(2,), rollers=True, given=given)
    (answer,) = answers(one.body, coulomb.Contact("bottom", friction=0.0), [1.0])
    assert answer.valid and answer.outer_iterations <= most
    assert force(answer) == pytest.approx([0.0, 0.0, -stress(0.6)], rel=1e-7, abs=1.0)


def test_a_mooney_rivlin_energy_has_the_stress_of_its_formula():
    c1, c2, stretch = 3e5, 1e5, 0.8
    energy = lambda u: mooney_rivlin(u, c1, c2, 1e4 * c1)  # noqa: E731
    one = RubberBlock(down(0.2), (1, 1, 1), components=(2,), rollers=True, energy=energy)
    *_, last = answers(one.body, coulomb.Contact("bottom", friction=0.0), [0.5, 1.0])
    incompressible = 2.0 * (stretch - stretch**-2) * (c1 + c2 / stretch)
    assert -force(last)[2] == pytest.approx(incompressible, rel=1e-3)


def test_a_pressure_follows_its_surface_and_contact_holds_the_block_against_it():
    """A residual with a surface term; the stress is that of the pressure on the area as it has become.  Beside contact
    a spring of a billionth of its stiffness holds the block along z."""
    one, pressure = RubberBlock(components=(), rollers=True), 1e5
    u, v, p = one.u, ufl.TestFunction(one.V), fem.Constant(one.domain, 0.0)
    top = np.sort(one.on(2, 1.0))
    tags = mesh.meshtags(one.domain, 2, top, np.ones(len(top), dtype=np.int32))
    ds = ufl.Measure("ds", domain=one.domain, subdomain_data=tags, metadata={"quadrature_degree": 4})
    F = ufl.Identity(3) + ufl.grad(u)
    n = ufl.det(F) * ufl.inv(F).T * ufl.FacetNormal(one.domain)
    energy = (neo_hookean(u, MU, LAME) + 0.5e-3 * ufl.inner(u, u)) * ufl.dx(metadata={"quadrature_degree": 3})

    def update(time):
        p.value = pressure * time

    residual = ufl.derivative(energy, u, v) + p * ufl.inner(n, v) * ds(1)
    faces = {"bottom": one.on(2, 0.0)}
    body = NonlinearBody(residual=residual, bcs=one.conditions, faces=faces, displacement=u, update=update)
    *_, last = answers(body, coulomb.Contact("bottom", friction=0.0), [0.2, 1.0])

    stretch = brentq(lambda s: stress(s) + pressure * side(s) ** 2, 0.5, 1.0)
    assert last.valid
    assert force(last)[2] == pytest.approx(-stress(stretch), rel=1e-6)
    assert last.at_nodes.area.sum() == pytest.approx(side(stretch) ** 2, rel=1e-6)


def test_slip_on_a_sphere_is_as_long_as_the_arc_in_the_present_tangent_plane():
    def normal(angle):
        return np.column_stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)])

    angle, start, radius = np.array([1e-6, 0.01, 0.5, 2.0, 3.0]), 0.3, 2.5
    then, now = normal(np.full(5, start)), normal(start + angle)
    tangent = np.column_stack([np.cos(start + angle), np.zeros(5), -np.sin(start + angle)])
    slip, turns = along_arc(radius * (now - then), now, then)
    assert slip == pytest.approx(radius * angle[:, None] * tangent, rel=1e-8, abs=1e-12)
    assert turns == pytest.approx(angle[:, None] * tangent, rel=1e-8, abs=1e-12)


def test_a_rotation_by_90_degrees_turns_the_forces_and_nothing_slips():
    def turned(angle):
        return np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])

    def angle(time):
        return 0.5 * np.pi * max(time - 1.0, 0.0)

    def way(time, x):
        return turned(angle(time)) @ (x + down(0.2)(time, x)) - x

    rotation = coulomb.Rotation((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), angle)
    plane = coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    contact = coulomb.Contact("bottom", friction=0.3, foundation=plane, rotation=rotation)
    before, *_, after = answers(RubberBlock(way).body, contact, [1.0, 1.25, 1.5, 1.75, 2.0], tolerance=1e-10)
    assert after.valid and after.certificate["natural residual"].value < 1e-9
    size = np.linalg.norm(force(before))
    assert np.abs(force(after) - turned(0.5 * np.pi) @ force(before)).max() < 1e-9 * size
    assert np.abs(after.at_nodes.slip).max() < 1e-9


def test_a_load_inside_the_friction_cone_does_not_creep():
    held = answers(
        RubberBlock(drawn(0.1, 0.02)).body, coulomb.Contact("bottom", friction=0.8), [0.5, 1.0, 1.5, 2.0, *range(3, 13)]
    )[4:]
    assert all(one.valid for one in held)

    def place(one):
        return one.displacement[one.problem.surface.nodes]

    moved = np.abs(place(held[-1]) - place(held[0]))
    assert moved[:, :2].max() < 1e-12 and moved[:, 2].max() < 1e-11  # along the floor; and into it, by the tolerance
    assert np.abs(force(held[-1])[0]) > 0.04 * force(held[-1])[2]  # there is something to hold


def test_a_kept_state_goes_on_with_the_same_numbers():
    history, contact = coulomb.LoadHistory([0.5, 1.0, 1.5, 2.0]), coulomb.Contact("bottom", friction=0.3)
    steps = list(history.steps(LargeMotions(RubberBlock(drawn(0.1, 0.4)).body, contact)))
    kept = pickle.loads(pickle.dumps(steps[1].state))
    again = list(history.steps(LargeMotions(RubberBlock(drawn(0.1, 0.4)).body, contact), kept))
    assert [one.state.time for one in again] == [1.5, 2.0]
    for one, other in zip(again, steps[2:], strict=True):
        assert np.abs(one.state.displacement - other.state.displacement).max() < 1e-12


def test_drawn_over_waves_every_step_takes_few_iterations():
    """The normals turn, and with them the tangent: without that term the sixth step takes more than twice as many."""
    waves = coulomb.SignedDistance(lambda x: x[2] + 0.1 - 0.1 * np.sin(np.pi * x[0]))
    one = RubberBlock(drawn(0.3, 1.5), (4, 1, 2))
    found = answers(
        one.body, coulomb.Contact("bottom", friction=0.3, foundation=waves), [0.25, 0.5, 0.75, 1.0, 1.05, 1.1, 1.15]
    )
    assert all(one.valid for one in found)
    assert max(one.outer_iterations for one in found) <= 8
    y = (one.body.reference + found[-1].displacement)[found[-1].problem.surface.nodes]
    closed = found[-1].contact_force[0::3] > 0.0
    assert np.any(closed)
    assert np.abs(y[closed, 2] - 0.1 * (np.sin(np.pi * y[closed, 0]) - 1.0)).max() < 1e-9


def test_two_bodies_slide_past_each_other_by_elements():
    """Friction is at its bound, but for the slope of the pressed face, and both bodies are in balance."""
    lower = RubberBlock(cells=(5, 1, 1), size=(1.7, 1.0, 0.5), held="bottom")
    upper = RubberBlock(drawn(0.05, 0.7), cells=(2, 1, 1), size=(0.8, 0.8, 0.5), at=(0.1, 0.1, 0.5))
    both = coulomb.join(lower=lower.body, upper=upper.body)
    contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.2)
    found = answers(both, contact, [1.0, 1.2, 1.4, 1.6])
    assert all(one.valid for one in found)
    for one in found[2:]:
        totals = one.at_nodes.totals()
        along, _, across = totals["force"]
        assert along == pytest.approx(-0.2 * across, rel=0.05)
        assert totals["greatest_slip"] == pytest.approx(0.14, rel=0.15)
        assert one.certificate["action and reaction"].value < 1e-12


def test_a_block_comes_from_beside_and_leaves_entirely(caplog):
    """Before and after nothing is opposite; between the force is that of a block pressed where it is."""

    def way(time, x):
        along, down = np.interp(time, [0.0, 1.0, 2.0, 3.0], [0.0, -1.4, -1.4, -3.0]), min(max(time - 1.0, 0.0), 1.0)
        return np.array([along + 0.0 * x[0], 0.0 * x[0], 0.0 * x[0] - 0.12 * down])

    def pressed(times, way, at):
        lower = RubberBlock(cells=(3, 2, 1), size=(1.0, 1.0, 0.5), held="bottom")
        upper = RubberBlock(way, cells=(2, 2, 1), size=(0.8, 0.8, 0.4), at=at)
        contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.3)
        return answers(coulomb.join(lower=lower.body, upper=upper.body), contact, times)

    beside, over, on, edge, off, gone = pressed([0.2, 1.0, 2.0, 2.3, 2.8, 3.0], way, (1.5, 0.1, 0.6))
    assert "no part of it is opposite to 'lower:top' yet" in caplog.text
    assert all(one.valid for one in (beside, over, on, edge, off, gone))
    assert not any(np.any(one.contact_force) for one in (beside, over, off, gone))
    (where_it_is,) = pressed([1.0], down(0.02), (0.1, 0.1, 0.5))
    assert force(on) == pytest.approx(force(where_it_is), abs=1e-6 * force(on)[2])
    assert 0.0 < force(edge)[2] < force(on)[2]
    assert len(gone.contact_force) == 0 and np.abs(gone.displacement[:, 2]).max() == pytest.approx(0.12)


def test_the_slave_of_a_pair_stays_the_slave():
    """The upper face is as fine as the lower one until it is stretched: chosen anew, contact points would change sides,
    and slip and friction would be lost."""
    lower = RubberBlock(cells=(2, 2, 1), held="bottom")
    upper = RubberBlock(
        lambda time, x: np.array([0.1 * time * x[0], 0.1 * time * x[1], 0.0 * x[0] - 0.05]),
        (2, 2, 1),
        size=(1.17, 1.17, 0.3),
        at=(-0.085, -0.085, 1.0),
    )
    contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.3)
    found = answers(coulomb.join(lower=lower.body, upper=upper.body), contact, [1.0, 2.0])
    assert all(force(one)[2] > 0.0 and one.at_nodes.faces == ("upper:bottom",) for one in found)


def test_facets_that_are_coarse_beside_the_contact_make_an_answer_invalid():
    """A narrow ridge between the nodes is inside the face; a smooth hill is not, but for the chord of the facets."""

    def facets(radius):
        ridge = coulomb.Cylinder((0.5, 0.0, -radius), (0.0, 1.0, 0.0), radius)
        one = RubberBlock(down(0.05), (3, 1, 2))
        (answer,) = answers(one.body, coulomb.Contact("bottom", friction=0.3, foundation=ridge), [1.0])
        assert answer.certificate.passed
        return answer

    narrow, wide = facets(0.3), facets(3.0)
    assert not narrow.valid and any("inside the foundation" in text for text in narrow.outside)
    assert wide.valid and wide.small_strain.chord == pytest.approx((1.0 / 3.0) ** 2 / (8.0 * 3.0) / 0.05, rel=1.0)


def test_a_surface_beside_the_contact_face_that_gets_inside_makes_an_answer_invalid():
    """The block is drawn aside until a bar stands in its left face, which is no contact face."""

    def drawn_left(way):
        bar = coulomb.Cylinder((-0.5, 0.0, 0.5), (0.0, 1.0, 0.0), 0.3)
        one = RubberBlock(lambda time, x: np.array([[-way], [0.0], [0.0]]) + 0.0 * x)
        (answer,) = answers(one.body, coulomb.Contact("bottom", friction=0.3, foundation=bar), [1.0])
        assert answer.certificate.passed
        return answer

    assert drawn_left(0.1).valid
    inside = drawn_left(0.3)
    assert not inside.valid and "the foundation of contact face 'bottom'" in inside.outside[0]


def test_elements_inside_out_are_seen():
    one = RubberBlock(cells=(2, 1, 1))
    u = np.zeros_like(one.body.reference)
    assert one.body.least_volume_ratio(u) == pytest.approx(1.0)
    u[:, 2] = -1.3 * one.body.reference[:, 2] * (one.body.reference[:, 0] > 0.9)
    assert one.body.least_volume_ratio(u) == pytest.approx(-0.3)


@pytest.mark.parametrize(("sign", "stretch", "passes"), [(1.0, 0.0, True), (1.0, 0.6, True), (-1.0, 0.0, False)])
def test_only_the_undeformed_body_must_be_stable(sign, stretch, passes):
    """Nearly incompressible rubber that is stretched on all sides has a tangent with a negative diagonal, where an
    iterate may be.  An energy of the wrong sign is refused before anything is deformed."""
    body = RubberBlock(energy=lambda u: sign * neo_hookean(u, MU, 40.0 * MU)).body
    there = body.linearised(stretch * body.reference, 0.0)
    if passes:
        assert (there.assembled().getDiagonal().min()[1] < 0.0) == (stretch > 0.0)
    else:
        with pytest.raises(ValueError, match="Body: a is not positive definite"):
            there.assembled()


def test_what_cannot_be_reached_ends_with_the_last_good_step():
    one = RubberBlock(down(1.1), (1, 1, 1))
    problem = LargeMotions(one.body, coulomb.Contact("bottom", friction=0.3))
    done = []
    with pytest.raises(
        StepFailed, match=r"the load step from 0\.\d+ s to .* s failed, halved twice: .*tried: .*; what may help: "
    ):
        for step in coulomb.LoadHistory([0.5, 1.0], halvings=2).steps(problem):
            done.append(step.state)
    assert done and done[-1].time < 1.0
    assert np.array_equal(one.u.x.array, done[-1].displacement.ravel())


def test_wrong_input():
    one = RubberBlock()
    with pytest.raises(ValueError, match="adjust, smooth and surface describe the undeformed place"):
        LargeMotions(one.body, coulomb.Contact("bottom", friction=0.3, against="top", adjust=0.1))
    with pytest.raises(ValueError, match="a, L and space, or energy or residual with displacement, not both"):
        coulomb.Body(1.0, energy=1.0)
    with pytest.raises(ValueError, match="large motions need NonlinearBody"):
        mesh = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1))
        LargeMotions(coulomb.Elasticity(mesh, coulomb.Material(1e6, 0.3), []), coulomb.Contact("bottom", friction=0.3))


def test_the_turn_of_a_body_is_that_of_its_cells():
    """A flat arch that snaps through has not turned, though the arch turned over by its span is nearer; one that turns
    by any angle has."""

    def arch(x):
        return np.column_stack([x[:, 0], 0.1 * x[:, 1], 0.05 * x[:, 2] + 0.2 * np.sin(np.pi * x[:, 0])])

    one = RubberBlock(cells=(8, 1, 1), shape=arch)
    x, over = one.body.reference, Reductions(MPI.COMM_WORLD)
    snapped = np.zeros_like(x)
    snapped[:, 2] = -0.4 * np.sin(np.pi * x[:, 0])
    still = rigid_part(one.body.linearised(snapped, 0.0), snapped, over)
    assert still == pytest.approx(np.tile(snapped.mean(axis=0), (len(x), 1)), abs=1e-12)
    turned = x @ rotation_matrix(np.array([0.0, np.radians(170.0), 0.0])).T - x
    assert rigid_part(one.body.linearised(turned, 0.0), turned, over) == pytest.approx(turned, abs=1e-12)
