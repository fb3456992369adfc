"""Supports along any direction: guides along normals, planes of symmetry at any angle, prescribed rotations.

Expected values are formulas: states of uniform stress, which the elements represent exactly; Lame's ring; the torsion
of a circular bar; rigid rotations.
"""

import numpy as np
import pytest
from shared_problems import ring_mesh

import coulomb
from coulomb import (
    Clamp,
    Cylinder,
    Elasticity,
    Material,
    Plane,
    PrescribedDisplacement,
    PrescribedRotation,
    Pressure,
    Spring,
    SymmetryPlane,
    Traction,
)
from coulomb.solvers import DirectSolver, IterativeSolver

STEEL = Material(2.1e11, 0.3)
CELLS = ("hexahedron", "tetrahedron")
TURN = np.linalg.qr(np.random.default_rng(7).standard_normal((3, 3)))[0]
TURN *= np.linalg.det(TURN)


def solved(elasticity, solver=DirectSolver, time=0.0):
    """Displacement (k, 3) and the forces of every support and spring by itself, a list of `NodalForces`."""
    loading = elasticity.at(time)
    f, u = elasticity.f(loading), elasticity.K.createVecRight()
    solver(elasticity.K).solve(f, u)
    values = u.array.reshape(-1, 3).copy()
    residual = elasticity.internal_force(values) - elasticity.spring_force(values) - loading.load
    rounding = 1e-14 * STEEL.young * np.abs(values).max()
    forces = np.linalg.norm(elasticity.held.held_part(residual))
    assert np.linalg.norm(elasticity.held.free_part(residual)) <= 1e-8 * forces + rounding
    return values, list(elasticity.shares(elasticity.held.held_part(residual)))


def turned_box(cell, turn=TURN, size=(1.0, 0.8, 0.6), cells=(3, 3, 2)):
    return coulomb.box(size, cells, cell, place=lambda x: turn @ x)


@pytest.mark.parametrize("solver", [DirectSolver, IterativeSolver])
@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize(
    "support",
    [SymmetryPlane, lambda face: Clamp(face, "normal"), lambda face: Clamp(face, direction=tuple(TURN[:, AXIS[face]]))],
    ids=["symmetry", "normal", "direction"],
)
def test_uniform_stress_between_oblique_guides(support, cell, solver):
    """Three faces at right angles, turned in space, each guided along itself; tension on the face opposite to one."""
    s, (E, nu) = 1e7, (STEEL.young, STEEL.poisson)
    elasticity = Elasticity(
        turned_box(cell), STEEL, [support(face) for face in AXIS], [Traction("right", tuple(s * TURN[:, 0]))]
    )
    u, shares = solved(elasticity, solver)
    expected = elasticity.x @ TURN * np.array([s / E, -nu * s / E, -nu * s / E]) @ TURN.T
    assert np.abs(u - expected).max() <= 1e-9 * np.abs(expected).max()
    pull = -s * 0.8 * 0.6 * TURN[:, 0]
    assert np.allclose(shares[0].forces.sum(axis=0), pull, rtol=0.0, atol=1e-9 * s)
    for share in shares[1:]:
        assert np.abs(share.forces.sum(axis=0)).max() <= 1e-9 * s


AXIS = {"left": 0, "front": 1, "bottom": 2}


@pytest.mark.parametrize("cell", CELLS)
def test_only_the_normal_part_of_a_prescribed_displacement_counts(cell):
    """Pressed by 1 mm against a guide at an angle, sideways free: uniaxial strain, from the normal part alone."""
    n, aside = TURN[:, 0], 5e-3 * TURN[:, 1]
    sides = [SymmetryPlane(face) for face in ("left", "front", "back", "bottom", "top")]
    press = PrescribedDisplacement("right", tuple(-1e-3 * n + aside), "normal")
    elasticity = Elasticity(turned_box(cell), STEEL, [*sides, press])
    u, shares = solved(elasticity)
    assert np.abs(u + 1e-3 * (elasticity.x @ n)[:, None] * n).max() <= 1e-12
    E, nu = STEEL.young, STEEL.poisson
    stress = E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu)) * 1e-3
    assert np.allclose(shares[-1].forces.sum(axis=0), -stress * 0.48 * n, atol=1e-9 * stress)


@pytest.mark.parametrize("cell", CELLS)
def test_springs_along_an_axis_at_nodes_that_are_moved_obliquely(cell):
    """The spring's force has a part along the free directions of the nodes: `solved` checks the equilibrium there."""
    aside = TURN[:, 0] + TURN[:, 1]
    pulled = PrescribedDisplacement("right", tuple(1e-4 * aside), direction=tuple(aside))
    spring = Spring("right", (1e12, 0.0, 0.0))
    elasticity = Elasticity(turned_box(cell), STEEL, [Clamp("left"), pulled], springs=[spring])
    u, _ = solved(elasticity)
    right = elasticity.nodes("right", "test")
    assert np.allclose(u[right] @ aside, 2e-4, rtol=1e-12)
    assert np.abs(elasticity.held.free_part(elasticity.spring_force(u))).max() > 1e4


@pytest.mark.parametrize("cell", CELLS)
def test_tangential_holds_what_normal_leaves(cell):
    """Antisymmetry: a body in pure shear moves along the normal of the plane between its halves, not across it."""
    g = 1e-3

    def shear(x):
        return TURN @ (np.array([[0, g, 0], [g, 0, 0], [0, 0, 0]]) @ (TURN.T @ x))

    others = [PrescribedDisplacement(face, shear) for face in ("right", "front", "back", "bottom", "top")]
    elasticity = Elasticity(turned_box(cell), STEEL, [Clamp("left", "tangential"), *others])
    u, shares = solved(elasticity)
    assert np.abs(u - shear(elasticity.x.T).T).max() <= 1e-14
    inside = elasticity.nodes("left", "test")
    assert np.abs(shares[0].forces[inside] @ TURN[:, 0]).max() <= 1e-12 * np.abs(shares[0].forces).max()


def lame(x, p, inner=1.0, outer=2.0):
    """Displacement of a ring in plane strain under internal pressure p, at points (k, 3)."""
    r, (E, nu) = np.hypot(x[:, 0], x[:, 1]), (STEEL.young, STEEL.poisson)
    factor = p * inner**2 / (outer**2 - inner**2) * (1.0 + nu) / E
    radial = factor * ((1.0 - 2.0 * nu) * r + outer**2 / r)
    return np.column_stack([radial * x[:, 0] / r, radial * x[:, 1] / r, 0.0 * r])


def eighth(n, cell):
    mesh = ring_mesh(1.0, 2.0, (n, n, 1), np.pi / 4, 0.2, cell)
    symmetries = [SymmetryPlane(face) for face in ("front", "back", "bottom", "top")]
    elasticity = Elasticity(mesh, STEEL, symmetries, [Pressure("left", 1e8)])
    u, shares = solved(elasticity)
    exact = lame(elasticity.x, 1e8)
    return np.abs(u - exact).max() / np.abs(exact).max(), shares


@pytest.mark.parametrize("cell", CELLS)
def test_an_eighth_of_a_ring_under_pressure(cell):
    """Two planes of symmetry at 45 degrees; the error falls with the square of the size of the cells."""
    coarse, _ = eighth(6, cell)
    fine, shares = eighth(12, cell)
    assert fine <= {"hexahedron": 2e-3, "tetrahedron": 0.015}[cell] and coarse / fine >= 3.0
    force = np.array([share.forces.sum(axis=0) for share in shares])
    hoop = 1e8 * 0.2  # N: pressure * inner radius * height, along the outward normal of each cut
    assert np.allclose(force[0], [0.0, -hoop, 0.0], atol=1e-9 * hoop)
    assert np.allclose(force[1], hoop * np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0), atol=1e-9 * hoop)


@pytest.mark.parametrize("cell", CELLS)
def test_a_rotation_of_all_faces_strains_nothing(cell):
    point, axis, angle = (0.3, -0.1, 2.0), (1.0, 2.0, -2.0), 0.05
    faces = ("left", "right", "front", "back", "bottom", "top")
    supports = [PrescribedRotation(face, point, axis, angle, amplitude=[(0.0, 0.0), (2.0, 1.0)]) for face in faces]
    elasticity = Elasticity(turned_box(cell), STEEL, supports)
    u, _ = solved(elasticity, time=1.0)
    expected = 0.5 * angle * np.cross(np.array(axis) / 3.0, elasticity.x - np.array(point))
    assert np.abs(u - expected).max() <= 1e-14
    assert np.abs(elasticity.internal_force(expected)).max() <= 1e-12 * STEEL.young * np.abs(expected).max()


def bar(n, cell):
    """A circular bar along z of radius 0.5 and length 2: a square whose lines become a disc."""

    def place(x):
        a, b = 2.0 * x[0] - 1.0, 2.0 * x[1] - 1.0
        return np.array([0.5 * a * np.sqrt(1.0 - 0.5 * b**2), 0.5 * b * np.sqrt(1.0 - 0.5 * a**2), 2.0 * x[2]])

    return coulomb.box((1.0, 1.0, 1.0), (n, n, n), cell, place=place)


def torque(n, cell, axial):
    twist = PrescribedRotation("top", (0.0, 0.0, 7.0), (0.0, 0.0, 3.0), 0.01, axial=axial)
    elasticity = Elasticity(bar(n, cell), STEEL, [Clamp("bottom"), twist])
    _, shares = solved(elasticity)
    moments = [np.cross(elasticity.x, share.forces).sum(axis=0) for share in shares]
    assert np.allclose(moments[0], -moments[1], atol=1e-9 * np.abs(moments[0]).max())
    return moments[1][2]


@pytest.mark.parametrize(("cell", "axial"), [("hexahedron", "held"), ("tetrahedron", "free")])
def test_a_twisted_bar_has_the_torque_of_the_formula(cell, axial):
    """T = G J theta / L, J = pi r^4 / 2; the error falls with the square of the size of the cells."""
    exact = STEEL.young / (2.0 * 1.3) * np.pi * 0.5**4 / 2.0 * 0.01 / 2.0
    coarse, fine = (abs(torque(n, cell, axial) / exact - 1.0) for n in (6, 12))
    assert fine <= {"hexahedron": 0.01, "tetrahedron": 0.2}[cell] and coarse / fine >= 3.0


def test_press_and_twist_are_two_supports_of_one_face():
    """A displacement along the axis and, later, a rotation that leaves it free."""
    supports = [
        Clamp("bottom"),
        PrescribedDisplacement("top", (9.0, 9.0, -1e-3)),
        PrescribedRotation("top", (0.5, 0.5, 0.0), (0, 0, 1), 1e-3, axial="free"),
    ]
    elasticity = Elasticity(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)), STEEL, supports)
    top, prescribed = elasticity.nodes("top", "test"), elasticity.at(0.0).prescribed
    x, y = elasticity.x[top, 0] - 0.5, elasticity.x[top, 1] - 0.5
    assert np.allclose(prescribed[top], np.column_stack([-1e-3 * y, 1e-3 * x, np.full(len(top), -1e-3)]))


def test_the_later_support_holds_where_they_meet():
    """A clamp and an oblique plane of symmetry on one edge: the plane takes its own direction, the clamp the rest."""
    turn = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, np.sqrt(2.0)]]) / np.sqrt(2.0)
    mesh = turned_box("hexahedron", turn)
    elasticity = Elasticity(mesh, STEEL, [Clamp("bottom"), SymmetryPlane("left")], [Traction("top", (0.0, 1e6, 2e6))])
    _, shares = solved(elasticity)
    across = shares[1].forces @ turn[:, 1:]
    assert np.abs(across).max() <= 1e-9 * np.abs(shares[1].forces).max()
    both = np.intersect1d(elasticity.nodes("left", "test"), elasticity.nodes("bottom", "test"))
    assert np.abs(shares[0].forces[both] @ turn[:, 0]).max() <= 1e-9 * np.abs(shares[0].forces).max()
    assert np.allclose(sum(share.forces.sum(axis=0) for share in shares), [0.0, -0.8e6, -1.6e6])


def shaft(cell):
    """A bar with a mesh that is not symmetric: its nodes are shifted along the circles, by different amounts."""
    straight = bar(6, cell)
    x = straight.domain.geometry.x
    r, phi = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
    phi = phi + 0.07 * np.sin(3.0 * phi + x[:, 2]) * r
    x[:, 0], x[:, 1] = r * np.cos(phi), r * np.sin(phi)
    side = [straight.faces[name] for name in ("left", "right", "front", "back")]
    faces = {**straight.faces, "side": np.unique(np.concatenate(side))}
    return coulomb.NamedMesh(straight.domain, faces)


@pytest.mark.parametrize("cell", CELLS)
def test_a_shaft_turns_freely_in_a_bearing_with_its_exact_surface(cell):
    """The side is guided, one end is turned: no stress. With normals of the mesh the bearing resists."""
    bearing = Cylinder((0.0, 0.0, 5.0), (0.0, 0.0, 1.0), 0.5, hollow=True)
    forces = {}
    for surface in (bearing, None):
        turned = PrescribedRotation("top", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.01)
        elasticity = Elasticity(shaft(cell), STEEL, [turned, Clamp("side", "normal", surface=surface)])
        u, shares = solved(elasticity)
        forces[surface is not None] = np.abs(shares[1].forces).max()
        if surface is not None:
            assert np.abs(u - 0.01 * np.cross([0.0, 0.0, 1.0], elasticity.x)).max() <= 1e-12
    assert forces[True] <= 1e-9 * forces[False]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Clamp("left", "nor"), "components must be letters of 'xyz', 'normal' or 'tangential', but are 'nor'"),
        (lambda: Clamp("left", "x", direction=(1, 0, 0)), "clamp on 'left': give components or a direction, not both"),
        (lambda: Clamp("left", surface=Plane((0, 0, 0), (1, 0, 0))), "a surface goes with the components 'normal' or"),
        (
            lambda: on_box(Clamp("left", "normal", surface=Plane((0, 0, 0), (0, 1, 0)))),
            "no part of the surface: at x =",
        ),
        (lambda: on_box(Clamp("left", direction=(0, 0, 0))), "clamp on 'left': direction: must not be zero"),
        (
            lambda: Elasticity(bent(2e-5), STEEL, [SymmetryPlane("left")]),
            "its nodes are up to 10 um off its mean plane",
        ),
        (lambda: on_box(SymmetryPlane("ends")), "symmetry plane on 'ends': the face must be plane"),
        (lambda: on_box(SymmetryPlane("lefd")), "symmetry: there is no face 'lefd'"),
        (lambda: PrescribedRotation("left", (0, 0, 0), (0, 0, 0), 1.0), "rotation on 'left': axis must not be zero"),
        (lambda: PrescribedRotation("left", (0, 0, 0), (0, 0, 1), np.nan), "angle must be a finite number of radians"),
        (lambda: PrescribedRotation("left", (0, 0, 0), (0, 0, 1), 1.0, axial="x"), 'axial must be "held" or "free"'),
    ],
)
def test_wrong_supports_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def bent(sag):
    """A box whose left face sags in its middle line."""
    return coulomb.box(
        (1.0, 1.0, 1.0), (2, 2, 2), place=lambda x: np.array([x[0] - 4.0 * sag * x[1] * (1.0 - x[1]), x[1], x[2]])
    )


def test_a_face_that_is_plane_but_for_single_precision_is_a_plane_of_symmetry():
    Elasticity(bent(1e-6), STEEL, [Clamp("right"), SymmetryPlane("left")])


def on_box(*supports):
    box = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2))
    faces = dict(box.faces)
    faces["all"] = np.unique(np.concatenate(list(box.faces.values())))
    faces["ends"] = np.unique(np.concatenate([box.faces["left"], box.faces["right"]]))
    return Elasticity(coulomb.NamedMesh(box.domain, faces), STEEL, supports)
