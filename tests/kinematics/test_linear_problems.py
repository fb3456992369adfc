"""Linear problems that load steps of large motions take, and what makes their tangents consistent."""

import numpy as np
import pytest
from rubber_blocks import RubberBlock

import coulomb
from coulomb.fem.bodies import local_rows
from coulomb.fem.contact import springs_at
from coulomb.kinematics import LargeMotions, neo_hookean
from coulomb.model import newton_step, pair_checks
from coulomb.model.geometric_terms import GeometricTerms
from coulomb.model.large_motions import LoadStepLoop


def drawn(down, along):
    """Down until time 1, then along x."""
    return lambda time, x: np.array(
        [along * max(time - 1.0, 0.0) + 0.0 * x[0], 0.0 * x[0], -down * min(time, 1.0) + 0.0 * x[0]]
    )


def solutions(body, contact, times, remedy=0):
    """With springs where contact presses from the first linear problem on, if the remedy is 1."""
    history, problem = coulomb.LoadHistory(times, halvings=0), LargeMotions(body, contact)
    problem.large.remedy = remedy
    return [step.solution for step in history.steps(problem)]


def counts(found):
    assert all(one.valid for one in found)
    return [one.outer_iterations for one in found]


@pytest.mark.parametrize(
    ("cell", "degree", "most"),
    [("hexahedron", 1, [3, 3, 3, 4]), ("tetrahedron", 2, [3, 4, 4, 4])],
)
def test_a_block_pressed_by_a_fifth_and_drawn_over_a_plane(cell, degree, most):
    """Quadratic in all cells, also where the tangent is positive definite on the springs of contact alone: with springs
    at nodes alone 10-node tetrahedra took up to 15, with weights of the deformed face 7."""
    one = RubberBlock(drawn(0.2, 0.5), (3, 2, 2), cell=cell, degree=degree)
    found = solutions(one.body, coulomb.Contact("bottom", friction=0.3), [0.5, 1.0, 1.2, 1.4])
    assert np.all(np.array(counts(found)) <= most)
    assert "definite" in found[0].methods and not any("definite" in step.methods for step in found[1:])
    for step in found:
        before, after = np.array(step.residuals[1:-1]), np.array(step.residuals[2:])
        near = before < 1e-2
        assert np.any(near) and np.all(after[near] < np.maximum(30.0 * before[near] ** 2, 1e-9))


def test_a_block_that_only_contact_with_friction_keeps_stable():
    """Of 27-node hexahedra near incompressibility by an own energy, all of it at points, pressed by 30 %: with the
    positive parts of cells alone it took 12, each nearer by a factor of 0.2."""
    mu, lame = 1e6 / 2.98, 0.49e6 / (1.49 * 0.02)  # of E = 1 MPa, nu = 0.49
    way, size = drawn(0.015, 0.0), (0.1, 0.1, 0.05)
    one = RubberBlock(way, (2, 2, 1), size, degree=2, energy=lambda u: neo_hookean(u, mu, lame))
    found = solutions(one.body, coulomb.Contact("bottom", friction=0.3), [0.5, 1.0])
    assert max(counts(found)) <= 6
    before, after = np.array(found[1].residuals[-3:-1]), np.array(found[1].residuals[-2:])
    assert np.all(after < 0.01 * before)


def test_tetrahedra_over_waves():
    """What turns of normals leave out is linear in the curvature over the size of a facet."""
    waves = coulomb.SignedDistance(lambda x: x[2] + 0.1 - 0.1 * np.sin(np.pi * x[0]))
    one = RubberBlock(drawn(0.3, 1.5), (4, 1, 2), cell="tetrahedron", degree=2)
    contact = coulomb.Contact("bottom", friction=0.3, foundation=waves)
    assert max(counts(solutions(one.body, contact, [0.25, 0.5, 0.75]))) <= 6


def test_bodies_that_are_stable_on_each_other_alone():
    """Pressed to half of their height; without springs between them the second step took 17."""
    lower = RubberBlock(cells=(4, 2, 2), size=(1.2, 1.0, 0.5), held="bottom")
    upper = RubberBlock(drawn(0.5, 0.0), cells=(2, 2, 2), size=(0.8, 0.8, 0.5), at=(0.1, 0.1, 0.5))
    contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.6)
    found = solutions(coulomb.join(lower=lower.body, upper=upper.body), contact, [0.5, 1.0])
    assert max(counts(found)) <= 6 and "definite" not in found[1].methods


@pytest.mark.parametrize("remedy", [0, 1])
def test_a_block_drawn_over_a_block(remedy):
    """What the linear problem leaves out, that forces move along the lower face, has the factor 0.5 between iterates,
    and took up to 23; springs that stand for contact are no part of the exact step: with their forces in it, it took 9.
    """
    lower = RubberBlock(cells=(6, 1, 2), size=(1.6, 0.4, 0.5), held="bottom")
    upper = RubberBlock(drawn(0.1, 0.6), cells=(3, 1, 2), size=(0.6, 0.4, 0.4), at=(0.1, 0.0, 0.5))
    contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.3)
    found = solutions(coulomb.join(lower=lower.body, upper=upper.body), contact, [0.5, 1.0, 1.25, 1.5, 1.75], remedy)
    assert max(counts(found)) <= 6
    for step in found:
        before, after = np.array(step.residuals[1:-1]), np.array(step.residuals[2:])
        near = before < 1e-2
        assert np.all(after[near] < np.maximum(0.05 * before[near], 1e-9))


def test_what_faces_contradict_is_no_answer_in_more_linear_problems(monkeypatch):
    """As in a boot whose folds are before each other: 21 more linear problems, and the words were of a balance of
    1e-12."""
    count, findings, linear = [], pair_checks.findings, LoadStepLoop._linear

    def planted(*given):
        found = findings(*given)
        found.worst[3] = 0.5, 0.1, 0.2, 0.3
        return found

    monkeypatch.setattr(pair_checks, "findings", planted)
    monkeypatch.setattr(LoadStepLoop, "_linear", lambda *given: count.append(0) or linear(*given))
    lower = RubberBlock(cells=(2, 1, 1), size=(1.0, 0.5, 0.5), held="bottom")
    upper = RubberBlock(drawn(0.1, 0.0), cells=(1, 1, 1), size=(0.6, 0.5, 0.5), at=(0.1, 0.0, 0.5))
    contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.3)
    with pytest.raises(coulomb.StepFailed, match=r"pair weights 5\.0e-01 .* at x = 0\.1, 0\.2, 0\.3\); tried"):
        solutions(coulomb.join(lower=lower.body, upper=upper.body), contact, [1.0])
    assert len(count) <= 12


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_differences_of_pairs_alone_are_those_of_the_whole_problem(cell, degree, monkeypatch):
    """Also at facets that are in part beyond the edge of the face opposite, and with springs where contact presses."""
    compared = []

    class Both(GeometricTerms):
        def along(self, way):
            slid, self._slid = self._slid, None
            whole = super().along(way)
            self._slid = slid
            found = super().along(way)
            stress = np.abs(self._problem.elasticity.internal_force(way.u)).max()
            rounding = {"load": 1e-5 * stress, "c": 1e-7 * np.abs(way.u).max(), "bound": 1e-7}
            for name, error in rounding.items():
                different = np.abs(getattr(found, name) - getattr(whole, name))
                assert different.max() <= 2e-4 * np.abs(getattr(whole, name)).max() + error
            compared.append(slid is not None and np.any(whole.load))
            return found

    monkeypatch.setattr(newton_step, "GeometricTerms", Both)
    lower = RubberBlock(cells=(3, 1, 1), size=(0.8, 0.4, 0.4), held="bottom", cell=cell, degree=degree)
    where = {"size": (0.6, 0.4, 0.4), "at": (0.3, 0.0, 0.4), "cell": cell, "degree": degree}
    upper = RubberBlock(drawn(0.1, 0.2), cells=(2, 1, 1), **where)
    contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.3)
    counts(solutions(coulomb.join(lower=lower.body, upper=upper.body), contact, [0.5, 1.0, 1.5]))
    assert compared and all(compared)


def sharp_punch(cells, depth, sides=()):
    """A punch with sharp edges: down until time 1, then along x by a quarter of its width."""
    block, punch = coulomb.box((1.0, 0.5, 0.5), (8, cells, 4)), coulomb.box((0.4, 0.5, 0.2), (4, cells, 2))
    bodies = coulomb.join(block=block, punch=coulomb.moved(punch, translate=(0.1, 0.0, 0.5)))
    rubber = {"block": coulomb.NeoHookean(1e6, 0.4), "punch": coulomb.NeoHookean(1e8, 0.3)}
    down = coulomb.PrescribedDisplacement("punch:top", (0.0, 0.0, -depth), "yz", [(0.0, 0.0), (1.0, 1.0)])
    along = coulomb.PrescribedDisplacement("punch:top", (0.1, 0.0, 0.0), "x", [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)])
    contact = coulomb.Contact("block:top", against="punch:bottom", friction=0.3)
    supports = [coulomb.Clamp("block:bottom"), down, along, *(coulomb.Clamp(face, "y") for face in sides)]
    return coulomb.ContactProblem(bodies, rubber, supports, contact, kinematics="large")


def test_a_sharp_edge_that_comes_over_nodes_opposite_to_it():
    """Gaps by interpolants between nodes that the punch is above jumped there, and no step however small had an
    answer."""
    steps = coulomb.LoadHistory([0.1, 0.2], halvings=0).steps(sharp_punch(4, 0.1))
    assert max(counts([step.solution for step in steps])) <= 6


def test_changes_that_alternate_by_linear_problems():
    """Behind a punch that is drawn along: their ratio is -0.75."""
    sides = "block:front", "block:back", "punch:front", "punch:back"
    steps = coulomb.LoadHistory([1.0, 1.75], halvings=0).steps(sharp_punch(2, 0.05, sides))
    assert max(counts([step.solution for step in steps])) <= 6


@pytest.mark.parametrize(("cells", "cell", "degree"), [(2, "hexahedron", 1), (1, "tetrahedron", 2)])
def test_a_pressure_that_follows_the_surface(cells, cell, degree):
    """Its tangent is not symmetric where the face ends, of which the stiffness has no part: steps took up to 21."""
    clamp, pressure = coulomb.Clamp("bottom"), coulomb.Pressure("top", 3e5, [(0.0, 0.0), (1.0, 1.0)])
    wall = coulomb.Contact("right", 0.3, foundation=coulomb.Plane((1.3, 0.0, 0.0), (-1.0, 0.0, 0.0)))
    mesh, rubber = coulomb.box((1.0, 1.0, 1.0), 3 * (cells,), cell, degree=degree), coulomb.NeoHookean(1e6, 0.3)
    problem = coulomb.ContactProblem(mesh, rubber, [clamp], wall, [pressure], kinematics="large")
    steps = coulomb.LoadHistory([0.5, 1.0], halvings=0).steps(problem)
    found = [step.solution for step in steps]
    assert max(counts(found)) <= 4
    before, after = np.array([one.residuals[1:3] for one in found]).T
    assert np.all(after < 30.0 * before**2)


def on_a_plane():
    return LargeMotions(
        RubberBlock(cells=(1, 1, 1), cell="tetrahedron", degree=2).body, coulomb.Contact("bottom", friction=0.3)
    )


def on_a_body():
    lower = RubberBlock(cells=(2, 1, 1), held="bottom", cell="tetrahedron", degree=2)
    upper = RubberBlock(cells=(1, 1, 1), at=(0.2, 0.0, 1.0))
    contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.3)
    return LargeMotions(coulomb.join(lower=lower.body, upper=upper.body), contact)


@pytest.mark.parametrize("make", [on_a_plane, on_a_body])
def test_springs_at_contact_points_couple_the_nodes_of_their_averages(make):
    """W^T S W and W^T f, W the weights, beside springs at nodes."""
    problem = make()
    points, rng = problem.surface.points, np.random.default_rng(7)
    S, own = (rng.standard_normal((count, 3, 3)) for count in (len(points.nodes), len(points.space.x)))
    S, own = S + S.transpose(0, 2, 1), own + own.transpose(0, 2, 1)
    forces = rng.standard_normal((len(points.nodes), 3))
    W = points.difference.toarray()
    found = springs_at(points, S, forces, own)
    expected = np.einsum("mk,mij,ml->kilj", W, S, W).reshape(3 * W.shape[1], -1)
    for node, block in enumerate(own):
        expected[3 * node : 3 * node + 3, 3 * node : 3 * node + 3] += block
    assert local_rows(found.stiffness).toarray() == pytest.approx(expected, abs=1e-12)
    assert found.force == pytest.approx(W.T @ forces, abs=1e-12) and not found.inside
    of_rows = np.einsum("mk,k,mk->m", W, np.arange(W.shape[1]), W) / np.sum(W**2, axis=1) ** 2
    assert points.diagonal(np.arange(W.shape[1], dtype=np.float64)) == pytest.approx(of_rows)
