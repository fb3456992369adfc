"""Bodies that come to touch exactly: the gap is closed at the end of a load step, as of a round way in round steps."""

import numpy as np
import pytest

import coulomb

RUBBER = coulomb.Material(1e9, 0.3)
HALFWAY = [(0.0, 0.0), (1.0, 1.0)]


def pressed(mesh, way, contact, **options):
    """Moved down by its top, in two load steps."""
    top = coulomb.PrescribedDisplacement("top", way, amplitude=HALFWAY)
    return coulomb.ContactProblem(mesh, RUBBER, [top], contact, **options)


def over_a_gap(cells=(3, 3, 2), **options):
    box = coulomb.box((1.0, 1.0, 0.5), cells)
    return pressed(box, (0.0, 0.0, -2e-3), coulomb.Contact("bottom", friction=0.3, gap=1e-3), **options)


def over_a_plane_far_away():
    box = coulomb.moved(coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)), translate=(100.0, 50.0, 1e-3))
    plane = coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    return pressed(box, (0.0, 0.0, -2e-3), coulomb.Contact("bottom", friction=0.3, foundation=plane))


def tilted():
    """By 30 degrees about x."""
    n = np.array([0.0, -0.5, np.sqrt(0.75)])
    box = coulomb.moved(
        coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)), rotate=coulomb.Rotation((0, 0, 0), (1, 0, 0), np.pi / 6)
    )
    plane = coulomb.Plane(tuple(-1e-3 * n), tuple(n))
    return pressed(box, tuple(-2e-3 * n), coulomb.Contact("bottom", friction=0.3, foundation=plane))


def on_a_block():
    upper = coulomb.moved(coulomb.box((0.7, 0.7, 0.5), (3, 3, 2)), translate=(0.1, 0.1, 0.501))
    return coulomb.ContactProblem(
        coulomb.join(a=coulomb.box((1.0, 1.0, 0.5), (4, 4, 2)), b=upper),
        {"a": RUBBER, "b": coulomb.Material(2e11, 0.3)},
        [coulomb.Clamp("a:bottom"), coulomb.PrescribedDisplacement("b:top", (0.0, 0.0, -2e-3), amplitude=HALFWAY)],
        coulomb.Contact("b:bottom", against="a:top", friction=0.3),
    )


def by_multigrid():
    """With cells enough for solves that are not exact."""
    return over_a_gap((6, 6, 3), linear_solver="iterative")


def in_large_motions():
    plane = coulomb.Plane((0.0, 0.0, -1e-2), (0.0, 0.0, 1.0))
    box = coulomb.box((1.0, 1.0, 0.5), (3, 3, 2))
    contact = coulomb.Contact("bottom", friction=0.3, foundation=plane)
    return pressed(box, (0.0, 0.0, -2e-2), contact, kinematics="large")


@pytest.mark.parametrize(
    "make",
    [over_a_gap, over_a_plane_far_away, tilted, on_a_block, by_multigrid, in_large_motions],
    ids=lambda f: f.__name__,
)
def test_the_step_that_closes_the_gap_has_no_forces(make):
    """And none is halved; the next presses as if the gap were not closed by a step."""
    first, last = (step.solution for step in coulomb.LoadHistory([0.5, 1.0], halvings=0).steps(make()))
    assert first.valid and last.valid
    assert not np.any(first.contact_force)
    (whole,) = (step.solution for step in coulomb.LoadHistory([1.0], halvings=0).steps(make()))
    assert last.forces["normal_force"] == pytest.approx(whole.forces["normal_force"], rel=1e-4)


@pytest.mark.parametrize(("cells", "method"), [((2, 2, 1), "auto"), ((6, 6, 3), "iterative"), ((8, 8, 4), "iterative")])
def test_beside_a_body_that_is_pressed(cells, method):
    """Each body by itself: the one that just touches has no forces, and takes multigrid no more steps than factors."""
    one, other = (coulomb.box((1.0, 1.0, 0.5), cells) for _ in range(2))
    problem = coulomb.ContactProblem(
        coulomb.join(a=one, b=coulomb.moved(other, translate=(2.0, 0.0, 0.0))),
        {"a": RUBBER, "b": RUBBER},
        [
            coulomb.PrescribedDisplacement("a:top", (0.0, 0.0, -2e-3)),
            coulomb.PrescribedDisplacement("b:top", (0.0, 0.0, -1e-3)),
        ],
        [coulomb.Contact("a:bottom", friction=0.3), coulomb.Contact("b:bottom", friction=0.3, gap=1e-3)],
        linear_solver=method,
    )
    answer = problem.solve()
    assert answer.valid and answer.result.newton_steps <= 25
    assert answer.forces["b:bottom"]["normal_force"] == 0.0 < answer.forces["a:bottom"]["normal_force"]


def test_forces_are_in_proportion_to_loads_that_are_small():
    """Of a micronewton on a body of a metre the way is below the rounding errors of coordinates, and not those of a gap
    that is exactly 0: forces are those of a meganewton, by the load."""

    def pressed_by(load):
        problem = coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)),
            coulomb.Material(2e11, 0.3),
            [coulomb.Clamp("left")],
            coulomb.Contact("bottom", friction=0.3),
            [coulomb.TotalForce("top", (0.2 * load, 0.0, -load))],
        )
        answer = problem.solve()
        assert answer.valid
        return answer.contact_force / load

    large = pressed_by(1e6)
    assert np.abs(large).max() > 0.01
    assert pressed_by(1e-6) == pytest.approx(large, abs=1e-7)


@pytest.mark.parametrize("kinematics", ["small", "large"])
def test_a_body_that_comes_along_and_is_pressed_straight_down_has_no_friction_along(kinematics):
    """Its motion along the foundation has ended when it touches: what came before, in the air, is no slip."""
    material = RUBBER if kinematics == "small" else coulomb.NeoHookean(1e9, 0.3)
    along = coulomb.PrescribedDisplacement("top", (1e-3, 0.0, 0.0), "xy", amplitude=[(0.0, 0.0), (1.0, 1.0)])
    down = coulomb.PrescribedDisplacement("top", (0.0, 0.0, -1e-3), "z", amplitude=[(0.0, 0.0), (1.0, 0.5), (2.0, 2.0)])
    contact, box = coulomb.Contact("bottom", friction=0.3, gap=1e-3), coulomb.box((1.0, 1.0, 0.5), (4, 4, 2))
    problem = coulomb.ContactProblem(box, material, [along, down], contact, kinematics=kinematics)
    *_, last = (step.solution for step in coulomb.LoadHistory([1.0, 2.0]).steps(problem))
    force = last.at_nodes.totals()["force"]
    assert last.valid and force[2] > 0.0
    assert np.abs(force[:2]).max() <= 1e-6 * force[2]
