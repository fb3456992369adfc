"""Gradients along fields and changes of whole problems, places of nodes among them: against differences of answers."""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from drawn_block import OVER, TIMES, backwards, drawn, shifted, summed, weights
from user_forms import Script

import coulomb
from coulomb.fem import compat

SMALLER = (
    coulomb.box((1.0, 1.0, 0.5), (1, 1, 1)),
    coulomb.Material(1e9, 0.3),
    [coulomb.Clamp("top")],
    coulomb.Contact("bottom", friction=0.3),
)


def weights_like(answer):
    """Of a function of an answer."""
    surface, body = answer.problem.surface, answer.problem.elasticity
    return np.sin(surface.x * [31.0, 17.0, 23.0]).ravel(), 1e8 * np.cos(body.x * [13.0, 29.0, 19.0])


def on_each_other(change=0.0):
    """A block, moved node by node, on another one, whose Poisson's ratio changes."""
    upper = coulomb.moved(coulomb.box((0.8, 0.8, 0.4), (2, 3, 1)), translate=(0.13, 0.11, 0.5))
    return coulomb.ContactProblem(
        coulomb.join(lower=coulomb.box((1.0, 1.0, 0.5), (2, 2, 1)), upper=coulomb.moved(upper, shifted(change))),
        {"lower": coulomb.Material(3e6, 0.3 + change), "upper": coulomb.Material(1e6, 0.3)},
        [coulomb.Clamp("lower:bottom"), coulomb.PrescribedDisplacement("upper:top", (8e-3, 0.0, -1e-2))],
        coulomb.Contact("upper:bottom", friction=0.2, against="lower:top"),
        small_strain="warn",
    )


def on_a_ball(change=0.0):
    """A body of forms, pressed on a ball, all of which changes."""
    script = Script(coulomb.moved(coulomb.box((1.0, 1.0, 0.5), (3, 2, 1)), shifted(change)), 1)
    load = ufl.dot(script.constant((1e5, 0.0, -1e6 * (1.0 + change))), script.v) * script.ds("top")
    held, stiffness = script.bc((0.0, 0.0, 0.0), "right"), script.elasticity(1e7, script.constant(0.3 + change))
    ball = coulomb.Sphere((0.5, 0.5, -3.0 + 0.5 * change), 3.0 + change)
    contact = coulomb.Contact("bottom", friction=0.3 + change, foundation=ball)
    body = coulomb.Body(stiffness, load, [held], faces=script.mesh.faces)
    return coulomb.ContactProblem(body, contact, small_strain="warn")


def reshaped(change=0.0):
    return drawn(shape=change)


@pytest.mark.parametrize(
    ("make", "times", "h"), [(on_a_ball, [1.0], 1e-5), (on_each_other, [1.0], 1e-4), (reshaped, TIMES, 1e-6)]
)
def test_along_a_change_of_the_problem_the_remainder_is_of_second_order(make, times, h):
    """Of places of nodes, foundations, materials and forms, without solving the changed problem; in a history too."""

    def answers(change=0.0):
        return [one.solution for one in coulomb.LoadHistory(times, tolerance=1e-12).steps(make(change))]

    present = answers()
    at = [weights(one) for one in present]

    changed = make(h), make(-h)
    along = sum(gradient.between(*changed) for _, gradient in backwards(present)) / (2.0 * h)
    value, more, less, half = (summed(at, answers(change)) for change in (0.0, h, -h, 0.5 * h))
    assert (more - less) / (2.0 * h) == pytest.approx(along, rel=1e-6)
    remainders = abs(more - value - h * along), abs(half - value - 0.5 * h * along)
    assert np.log2(remainders[0] / remainders[1]) == pytest.approx(2.0, abs=0.05)
    with pytest.raises(ValueError, match="other nodes"):
        present[0].gradient().between(*[coulomb.ContactProblem(*SMALLER)] * 2)


@pytest.mark.parametrize("aside", [0.0, 1e-4])
def test_on_a_border_there_is_one_on_either_side(aside):
    """A body that just touches: along what presses it every point closes, or opens, and the gradients are those."""
    answer = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (2, 2, 1)),
        coulomb.Material(1e9, 0.0),
        [coulomb.PrescribedDisplacement("top", (aside, 0.0, -1e-3))],
        coulomb.Contact("bottom", friction=0.02, gap=1e-3),
    ).solve()
    (one,) = (one for one in answer.sensitivities() if one.name == "prescribed displacements")
    x, u = weights_like(answer)
    found = answer.gradient(x, u)
    assert found.border == 9
    for gradient, side in ((found, one), (found.loose, one.falling)):
        expected = np.sum(x * side.contact_force) + np.sum(u * side.displacement)
        assert np.sum(gradient.prescribed * answer.problem.prescribed) == pytest.approx(expected, rel=1e-8)


def test_at_its_bound_a_point_sticks_or_slips():
    """One point sticks at its bound: with more friction it sticks, with less it slips."""

    def sheared(friction):
        return coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (3, 2, 2)),
            coulomb.Material(1e9, 0.3),
            [coulomb.PrescribedDisplacement("top", (2e-3, 3e-4, -4e-3))],
            coulomb.Contact("bottom", friction=friction),
            [coulomb.Pressure("right", 1e7), coulomb.Pressure("back", 3e6)],
        ).solve(tolerance=1e-13)

    force = sheared(10.0).contact_force.reshape(-1, 3)
    answer = sheared(float(np.max(np.hypot(force[:, 1], force[:, 2]) / force[:, 0])))
    one = answer.sensitivities()[0]
    x, u = weights_like(answer)
    found = answer.gradient(x, u)
    assert found.border == one.border == 1
    for gradient, side in ((found, one), (found.loose, one.falling)):
        expected = np.sum(x * side.contact_force) + np.sum(u * side.displacement)
        assert np.sum(gradient.friction * answer.problem.law.friction) == pytest.approx(expected, rel=1e-6, abs=1e-3)
    with pytest.raises(ValueError, match="border of two states in the load step after"):
        answer.gradient(x, u, later=replace(found, before=u))


@pytest.mark.parametrize("field", ["rough", "stiff"])
def test_along_a_field_the_remainder_is_of_second_order(field):
    """Of friction, or of Young's modulus, at each point or cell: against central differences of whole histories."""

    def answers(**given):
        return [step.solution for step in coulomb.LoadHistory(TIMES, tolerance=1e-12).steps(drawn(**given))]

    present, h = answers(), 1e-3
    found = backwards(present)
    along = 0.0
    for one, gradient in found:
        if field == "rough":
            x = one.problem.surface.x
            along += np.sum(gradient.friction * one.problem.law.friction * np.cos(3.0 * x[:, 0] + 2.0 * x[:, 1]))
        else:
            body = one.problem.elasticity.members[0].body
            x = body.domain.geometry.x[compat.cell_geometry(body.domain)[: len(gradient.young[""])]].mean(axis=1)
            along += np.sum(gradient.young[""] * np.sin(5.0 * x[:, 0] + x[:, 2]))
    changed = drawn(**{field: h}), drawn(**{field: -h})
    assert sum(gradient.between(*changed) for _, gradient in found) / (2.0 * h) == pytest.approx(along, rel=1e-5)
    at = [weights(one) for one in present]
    value, more, less, half = (summed(at, answers(**{field: change})) for change in (0.0, h, -h, 0.5 * h))
    assert (more - less) / (2.0 * h) == pytest.approx(along, rel=1e-5)
    remainders = abs(more - value - h * along), abs(half - value - 0.5 * h * along)
    assert np.log2(remainders[0] / remainders[1]) == pytest.approx(2.0, abs=0.05)


def waves(size):
    """A displacement of nodes that is another one at every node, without order."""
    return lambda x: size * np.array([np.sin(91.0 * x[0] + k * x[1] + 7.0 * x[2] + k) for k in (37.0, 53.0, 71.0)])


def loaded_pair(change=0.0):
    """Two bodies, of which one has mean dilatations, under loads of all kinds; of their faces only those that touch are
    plane."""
    lower, upper = coulomb.box((1.0, 1.0, 0.5), (1, 1, 1)), coulomb.box((0.8, 0.8, 0.4), (1, 1, 1))
    lower = coulomb.moved(lower, lambda x: 0.1 * (0.5 - x[2]) * np.sin([x[1], x[0], x[0] * x[1]]))
    upper = coulomb.moved(upper, lambda x: 0.1 * x[2] * np.sin([x[1], x[0], x[0] * x[1]]))
    upper = coulomb.moved(upper, (0.13, 0.11, 0.54), coulomb.Rotation((0.0, 0.0, 0.0), (1.0, 2.0, 0.0), 0.02))
    bodies = coulomb.join(lower=coulomb.moved(lower, waves(change)), upper=coulomb.moved(upper, waves(change)))
    return coulomb.ContactProblem(
        bodies,
        {"lower": coulomb.Material(3e6, 0.3, density=1e3), "upper": coulomb.Material(1e6, 0.48, density=2e3)},
        [coulomb.Clamp("lower:bottom"), coulomb.PrescribedDisplacement("upper:top", (8e-2, 0.0, -0.1))],
        coulomb.Contact("upper:bottom", friction=0.2, cohesion=300.0, against="lower:top"),
        [
            coulomb.Pressure("upper:right", 1e4),
            coulomb.TotalForce("upper:left", (200.0, 300.0, 1000.0)),
            coulomb.Traction("lower:right", (1e4, 2e3, -4e3)),
        ],
        body_force=(10.0, 200.0, 3.0),
        gravity=(0.0, 1.0, -9.81),
        springs=[coulomb.Spring("upper:front", (1e5, 2e5, 3e5))],
        small_strain="warn",
    )


def second_order(change=0.0):
    """Tetrahedra of second order, on a ball, warm, with normals of the body."""
    box = coulomb.moved(coulomb.box((1.0, 1.0, 0.5), (1, 1, 1), cell="tetrahedron", degree=2), shifted(0.01))
    return coulomb.ContactProblem(
        coulomb.moved(box, waves(change)),
        coulomb.Material(1e7, 0.3, expansion=1e-5),
        [coulomb.Clamp("right")],
        coulomb.Contact("bottom", 0.3, foundation=coulomb.Sphere((0.5, 0.5, -3.0), 3.0), normals="body"),
        [coulomb.Traction("top", (1e5, 0.0, -1e6))],
        temperature=30.0,
        small_strain="warn",
    )


def of_forms(change=0.0):
    """A body of forms on the ball, with coordinates and normals in them."""
    box = coulomb.box((1.0, 1.0, 0.5), (2, 2, 1), cell="tetrahedron")
    script = Script(coulomb.moved(box, waves(change)), 1)
    x, n = ufl.SpatialCoordinate(script.mesh.domain), ufl.FacetNormal(script.mesh.domain)
    load = ufl.dot(script.constant((1e5, 0.0, -1e6)) * x[1] - 1e5 * n, script.v) * script.ds("top")
    held, stiffness = script.bc((0.0, 0.0, 0.0), "right"), script.elasticity(1e7, 0.3 + 0.1 * x[0])
    contact = coulomb.Contact("bottom", friction=0.3, foundation=coulomb.Sphere((0.5, 0.5, -3.0), 3.0))
    body = coulomb.Body(stiffness, load, [held], faces=script.mesh.faces)
    return coulomb.ContactProblem(body, contact, small_strain="warn")


def flat(change=0.0, cells=(3, 3, 1), shape=waves):
    """A plate on a larger block, of which the facet in the middle is opposite."""
    block = coulomb.moved(coulomb.box((3.0, 3.0, 0.5), cells), shape(change))
    plate = coulomb.moved(coulomb.box((1.0, 1.0, 0.7), (1, 1, 1)), translate=(1.0, 1.0, 0.5))
    return coulomb.ContactProblem(
        coulomb.join(block=block, plate=coulomb.moved(plate, shape(change))),
        coulomb.Material(1e9, 0.3),
        [coulomb.Clamp("block:bottom"), coulomb.PrescribedDisplacement("plate:top", (3e-3, 1e-3, -1e-2))],
        coulomb.Contact("plate:bottom", friction=0.3, against="block:top"),
        small_strain="warn",
    )


def waved(change=0.0):
    problem = drawn()
    return problem.on(coulomb.moved(problem.given["mesh"], waves(change)))


@pytest.mark.parametrize(
    ("make", "times", "accuracy"),
    [
        (loaded_pair, [1.0], 1e-5),
        (second_order, [1.0], 1e-8),
        (of_forms, [1.0], 1e-8),
        (flat, [1.0], 1e-5),
        (waved, TIMES[:2], 1e-8),
    ],
)
def test_along_places_of_all_nodes_it_is_that_along_any_shape(make, times, accuracy):
    """One gradient for all nodes, against the change of the whole problem along a field without order, of which
    differences over h and 2 h give h^4; that is the derivative of answers (above).  Gaps of pairs have kinks where
    facets are plane, since warped ones have other rules."""
    found = backwards([one.solution for one in coulomb.LoadHistory(times, tolerance=1e-12).steps(make())])
    parts = sum(gradient.places() * waves(1.0)(one.problem.elasticity.x.T).T for one, gradient in found)
    h = 1e-4
    less, more = (
        sum(gradient.between(make(size), make(-size)) for _, gradient in found) / (2.0 * size) for size in (h, 2.0 * h)
    )
    size = OVER.sum(np.abs(parts).ravel())
    assert (4.0 * less - more) / 3.0 == pytest.approx(OVER.sum(parts.ravel()), abs=accuracy * size)
    assert abs(less) > 100.0 * accuracy * size


def test_where_flat_facets_do_not_match_it_is_the_mean_of_both_sides(caplog):
    """The larger of average and interpolant of the distance is the gap: answers have one derivative on either side."""

    def bumps(size):
        return lambda x: size * np.array([0.0 * x[0], 0.0 * x[0], np.sin(2.0 * x[0] + x[1]) * (0.5 + x[2])])

    def posed(change=0.0):
        return flat(change, (2, 2, 1), bumps)

    present, h = posed().solve(tolerance=1e-12), 1e-5
    x = weights_like(present)[0]
    found = present.gradient(x)
    sides = [found.between(posed(h), posed()) / h, found.between(posed(), posed(-h)) / h]
    along = np.sum(found.places() * bumps(1.0)(present.problem.elasticity.x.T).T)
    assert "the gradient is the mean of both sides" in caplog.text
    assert along == pytest.approx(np.mean(sides), rel=1e-4)
    assert abs(sides[0] - sides[1]) > 0.01 * abs(along)
    value, more, less = (np.sum(x * posed(change).solve(tolerance=1e-12).contact_force) for change in (0.0, h, -h))
    assert [(more - value) / h, (value - less) / h] == pytest.approx(sides, rel=1e-3)


def test_changes_of_a_foundation_within_rounding_errors_of_coordinates_are_refused():
    """A plane that tilts about the middle of a flat face: by nanoradians no gap changes, by more they all do."""

    def tilted(angle=0.0):
        plane = coulomb.Plane((0.5, 0.5, 0.0), (np.sin(angle), 0.0, np.cos(angle)))
        return coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (2, 2, 1)),
            coulomb.Material(1e9, 0.3),
            [coulomb.PrescribedDisplacement("top", (1e-5, 0.0, -1e-4))],
            coulomb.Contact("bottom", friction=0.3, foundation=plane),
        )

    answer, h = tilted().solve(tolerance=1e-12), 1e-6
    of_force = np.sin(answer.problem.surface.x * [31.0, 17.0, 23.0]).ravel()
    found, more, less = answer.gradient(of_force), tilted(h), tilted(-h)
    change = of_force @ (more.solve(tolerance=1e-12).contact_force - less.solve(tolerance=1e-12).contact_force)
    assert found.between(more, less) == pytest.approx(change, rel=1e-5) and abs(change) > 1.0
    with pytest.raises(ValueError, match=r"'bottom' from its foundation change by up to 5e-10 m.*take a larger change"):
        found.between(tilted(1e-9), tilted(-1e-9))


def test_where_they_are_not_known_it_says_so():
    """Along places: with ties, with moments at points, of bodies flat on each other whose finer facets are covered in
    part."""
    block = coulomb.box((1.0, 1.0, 0.5), (1, 1, 1))
    plate = coulomb.moved(block, translate=(0.0, 0.0, 0.5))
    tied = coulomb.ContactProblem(
        coulomb.join(block=block, plate=plate),
        coulomb.Material(1e9, 0.3),
        [coulomb.PrescribedDisplacement("plate:top", (0.0, 0.0, -1e-3))],
        coulomb.Contact("block:bottom", friction=0.3),
        ties=[coulomb.Tied("plate:bottom", "block:top")],
    )
    mesh, material, clamps, contact = SMALLER
    turned = coulomb.ContactProblem(
        mesh, material, clamps, contact, [coulomb.PointLoad("right", moment=(0.0, 1e3, 0.0))], small_strain="warn"
    )
    flat = coulomb.ContactProblem(
        coulomb.join(block=coulomb.box((1.2, 1.1, 0.5), (2, 2, 1)), plate=plate),
        coulomb.Material(1e9, 0.3),
        [coulomb.Clamp("block:bottom"), coulomb.PrescribedDisplacement("plate:top", (0.0, 0.0, -1e-3))],
        coulomb.Contact("plate:bottom", friction=0.3, against="block:top"),
    )
    for problem, why in ((tied, "with ties"), (turned, "point load"), (flat, "flat on each other")):
        answer = problem.solve()
        with pytest.raises(ValueError, match=why):
            answer.gradient(np.sin(np.arange(len(answer.contact_force)))).places()
