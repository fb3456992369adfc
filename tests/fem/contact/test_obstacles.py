"""Rigid foundations: their distances and normals by formula, and the gaps and frames they give a face."""

import numpy as np
import pytest
from conftest import STEEL

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Cylinder, Plane, PrescribedDisplacement, SignedDistance, Sphere
from coulomb.fem.bodies.elasticity import Elasticity
from coulomb.fem.contact.surface import contact_surface
from coulomb.fem.geometry.obstacles import Moved, RigidMotion

POINTS = np.random.default_rng(5).uniform(-1.0, 1.0, (50, 3)) + [0.0, 0.0, 4.0]


def by_formula(foundation):
    """The same foundation as a function of place."""
    if isinstance(foundation, Sphere):
        centre = np.array(foundation.centre)[:, None]
        distance = lambda x: np.linalg.norm(x - centre, axis=0) - foundation.radius  # noqa: E731
    elif isinstance(foundation, Cylinder):  # its axis here is y
        distance = lambda x: np.hypot(x[0] - foundation.point[0], x[2] - foundation.point[2]) - foundation.radius  # noqa: E731
    else:
        distance = lambda x: x[2] - foundation.point[2]  # noqa: E731
    sign = -1.0 if getattr(foundation, "hollow", False) else 1.0
    return SignedDistance(lambda x: sign * distance(x))


@pytest.mark.parametrize(
    "foundation",
    [
        Plane((0, 0, 0.5), (0, 0, 2)),
        Sphere((0.1, 0.2, 0.3), 2.0),
        Sphere((0.1, 0.2, 0.3), 9.0, hollow=True),
        Cylinder((0.1, 0.0, 0.3), (0, 3, 0), 2.0),
        Cylinder((0.1, 0.0, 0.3), (0, -1, 0), 9.0, hollow=True),
    ],
    ids=repr,
)
def test_distance_and_normal(foundation):
    other = by_formula(foundation)
    distance, normal = foundation.signed_distance(POINTS), foundation.normal(POINTS)
    assert np.allclose(distance, other.signed_distance(POINTS), rtol=1e-9)
    assert np.allclose(normal, other.normal(POINTS), atol=1e-8)
    assert np.allclose(np.linalg.norm(normal, axis=1), 1.0)
    ahead = foundation.signed_distance(POINTS + 1e-3 * normal)
    assert np.allclose(ahead - distance, 1e-3, rtol=1e-9)  # its gradient, and out of the foundation
    moved = Moved(foundation, RigidMotion(np.array([1.0, 2.0, 3.0])))
    assert np.allclose(moved.signed_distance(POINTS + [1.0, 2.0, 3.0]), distance)
    assert np.allclose(moved.normal(POINTS + [1.0, 2.0, 3.0]), normal)


def test_a_function_need_not_be_a_distance():
    """z - h scaled as it likes has the distance right to first order, and the sign and the normal exactly."""
    gradient = np.array([[-5.0], [0.0], [50.0]])
    slope = SignedDistance(lambda x: 50.0 * (x[2] - 0.1 * x[0]), lambda x: gradient + 0 * x)
    plane = Plane((0, 0, 0), (-0.1, 0, 1))
    assert np.allclose(slope.signed_distance(POINTS), plane.signed_distance(POINTS))
    assert np.allclose(slope.normal(POINTS), plane.normal(POINTS))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sphere((0, 0, 0), 0.0), "sphere: radius must be a positive number of metres, but is 0.0"),
        (lambda: Sphere((0, 0, np.nan), 1.0), "sphere: centre must be three finite numbers"),
        (lambda: Cylinder((0, 0, 0), (0, 0, 0), 1.0), "cylinder: axis must not be zero"),
        (lambda: surface(Sphere((1.5, 0.5, 0.0), 2.0)), "no normal at its centre|turned away"),
        (lambda: surface(SignedDistance(lambda x: x[:2])), r"foundation: the function must return \d+ numbers"),
        (lambda: surface(SignedDistance(lambda x: np.zeros(x.shape[1]))), "has no normal at x = "),
        (lambda: surface(SignedDistance(lambda x: x[5])), "'bottom': foundation: index 5 is out of bounds"),
        (lambda: surface(Plane((0, 0, 0), (0, 0, 1)), "faces"), 'normals must be "foundation" or "body"'),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def surface(foundation, normals="foundation"):
    mesh = coulomb.box((3.0, 1.0, 1.0), (6, 2, 2))
    return contact_surface(Elasticity(mesh, STEEL, [Clamp("left")]), "bottom", foundation, normals)


def test_frames_of_a_sphere():
    ball = Sphere((1.5, 0.5, -10.0), 9.9)
    found = surface(ball)
    towards = (np.array(ball.centre) - found.x) / np.linalg.norm(ball.centre - found.x, axis=1)[:, None]
    assert np.allclose(found.frames[:, 0], towards)
    assert np.allclose(found.gap, np.linalg.norm(found.x - ball.centre, axis=1) - 9.9)
    assert np.allclose(np.einsum("kij,klj->kil", found.frames, found.frames), np.eye(3), atol=1e-14)


def test_gaps_along_the_normals_of_the_body():
    """Down to the ball along z where a node stands over it, else to the tangent plane."""
    ball = Sphere((1.5, 0.5, -2.0), 1.0)
    found = surface(ball, "body")
    assert np.allclose(found.frames[:, 0], [0.0, 0.0, -1.0])
    r2 = np.sum((found.x[:, :2] - ball.centre[:2]) ** 2, axis=1)
    over = r2 < 0.9
    assert over.any() and not over.all()
    assert np.allclose(found.gap[over], 2.0 - np.sqrt(1.0 - r2[over]))
    beside = r2 > 1.0
    distance = np.sqrt(r2 + 4.0)
    assert np.allclose(found.gap[beside], (distance - 1.0)[beside] * distance[beside] / 2.0)


def test_leaving_the_theory_is_reported():
    """A cap pressed 5 mm into a ball of 50 mm: gap error, turn of the normals and strain exceed their limits."""
    mesh = coulomb.box((0.1, 0.1, 0.05), (8, 8, 4))
    contact = Contact("bottom", 0.1, foundation=Sphere((0.05, 0.05, -0.05), 0.05))
    press = PrescribedDisplacement("top", (0.01, 0.0, -0.02))
    solution = ContactProblem(mesh, coulomb.Material(1e6, 0.3), [press], contact).solve()
    surface, u, measured = solution.problem.surface, solution.displacement, solution.small_strain
    place = (surface.x + u[surface.nodes])[solution.contact_force[0::3] > 1e-6 * solution.contact_force.max()]
    off = np.abs(np.linalg.norm(place - [0.05, 0.05, -0.05], axis=1) - 0.05).max()
    internal = solution.problem.elasticity.internal_force(u)
    mean_way = 2.0 * np.vdot(u, internal) / np.linalg.norm(internal, axis=1).sum()
    assert measured.gap_error == pytest.approx(off / mean_way, rel=1e-9)
    said = " ".join(measured.warnings)
    assert "curvature" in said and "turns by" in said and "no longer small" in said
