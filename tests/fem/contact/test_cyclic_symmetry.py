"""One of several equal sectors around an axis."""

import numpy as np
import pytest

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    CyclicSymmetry,
    Cylinder,
    InteriorPoint,
    LoadHistory,
    Material,
    NeoHookean,
    NotConverged,
    Plane,
    PointLoad,
    PrescribedDisplacement,
    PrescribedRotation,
    RigidFace,
    SymmetryPlane,
    Traction,
    box,
)

E, NU = 2e11, 0.3
STEEL = Material(E, NU)


def sector(sectors, cells, degree):
    """Of a ring of inner radius 20 mm, outer 50 mm and thickness 10 mm, with curved cut faces."""

    def place(x):
        r = 0.02 + 0.03 * x[0]
        angle = 2.0 * np.pi / sectors * x[1] + 0.3 * x[0]
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0.01 * x[2]])

    return box((1.0, 1.0, 1.0), cells, place=place, degree=degree)


@pytest.mark.parametrize(("degree", "cells", "limit"), [(1, (12, 8, 1), 5e-3), (2, (3, 2, 1), 5e-4)])
def test_twisted_ring(degree, cells, limit):
    """A slice in plane strain, held inside, under a torque M per length outside: the plane formula
    u_t = r M/(4 pi G) (1/a^2 - 1/r^2), and nothing along the radius."""
    torque, sectors = 1e4, 8
    shear = torque / (2.0 * np.pi * 0.05**2)
    load = Traction("right", lambda x: shear / 0.05 * np.stack([-x[1], x[0], 0.0 * x[0]]))
    supports = [Clamp("left"), SymmetryPlane("bottom"), SymmetryPlane("top")]
    far = Contact("right", 0.1, foundation=Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.2, hollow=True))
    ties = [CyclicSymmetry("front", "back", sectors=sectors)]
    solution = ContactProblem(sector(sectors, cells, degree), STEEL, supports, far, [load], ties=ties).solve()
    assert solution.valid and solution.force_balance.balance <= 1e-12
    x, u = solution.problem.elasticity.x, solution.displacement
    r = np.hypot(x[:, 0], x[:, 1])
    around, outward = (x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0]) / r, (x[:, 0] * u[:, 0] + x[:, 1] * u[:, 1]) / r
    exact = r * torque * (1.0 + NU) / (2.0 * np.pi * E) * (1.0 / 0.02**2 - 1.0 / r**2)
    assert np.abs(around - exact).max() <= limit * exact.max()
    assert np.abs(outward).max() <= limit * exact.max()


def spun(whole, cells=(3, 3, 2), linear_solver=None):
    """A square block pressed on a rough plane and spun by its top, which contact alone holds: the whole one, or a
    quarter with the axis at an edge."""
    n, m, k = cells
    if whole:
        mesh = box((1.0, 1.0, 0.5), (2 * n, 2 * m, k), place=lambda x: np.stack([x[0] - 0.5, x[1] - 0.5, x[2]]))
    else:
        mesh = box((0.5, 0.5, 0.5), cells)
    turn = Traction("top", lambda x: np.stack([-4e5 * x[1], 4e5 * x[0], -1e6 + 0.0 * x[0]]), amplitude=lambda t: t)
    ties = [] if whole else [CyclicSymmetry("left", "front", sectors=4)]
    contact = Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    return ContactProblem(mesh, STEEL, [], contact, [turn], ties=ties, time=1.0, linear_solver=linear_solver)


def test_a_quarter_is_the_whole():
    """Pressure, slip and displacement of a block that spins on its base, with the axis at an edge of the quarter."""
    whole, quarter = spun(True), spun(False)
    assert len(whole.elasticity.free) == 6 and len(quarter.elasticity.free) == 2  # along the axis and about it
    one, part = (problem.solve(tolerance=1e-11) for problem in (whole, quarter))
    assert one.valid and part.valid and part.certificate["ties"].value <= 1e-10
    x, y = whole.elasticity.x, quarter.elasticity.x
    there = np.linalg.norm(y[:, None] - x, axis=2).argmin(axis=1)
    assert np.abs(part.displacement - one.displacement[there]).max() <= 1e-6 * np.abs(one.displacement).max()
    assert 4.0 * part.at_nodes.totals(0)["moment"][2] == pytest.approx(one.at_nodes.totals(0)["moment"][2], rel=1e-8)
    assert 4.0 * part.at_nodes.totals(0)["normal_force"] == pytest.approx(1e6, rel=1e-9)
    nodes = part.at_nodes.numbers()["nodes"]
    assert nodes["slip"] > 0 and nodes["stick"] > 0
    on_axis = np.hypot(y[:, 0], y[:, 1]) < 1e-9
    assert np.abs(part.displacement[on_axis][:, :2]).max() <= 1e-15


@pytest.mark.parametrize("wrong", [{"point": None}, {"translation": (0.0, None, None)}, {"rotation": (0.0, 1e-6, 0.0)}])
def test_a_rigid_face_of_a_sector(wrong):
    """That of the whole moves along the axis and turns about it; by default its point is the middle of the sector's
    face, about which a turn would part the sectors."""
    right = {"point": (0.0, 0.0, 0.5), "translation": (0.0, 0.0, None), "rotation": (0.0, 0.0, 1e-6)}
    mesh, pressed = box((0.5, 0.5, 0.5), (2, 2, 1)), PointLoad("top", (0.0, 0.0, -1e5), point=(0.0, 0.0, 0.5))
    contact, cut = Contact("bottom", 0.3), CyclicSymmetry("left", "front", sectors=4)

    def posed(given):
        rigid = [RigidFace("top", **given)]
        return ContactProblem(mesh, STEEL, [], contact, [pressed], ties=[cut], rigid_faces=rigid)

    with pytest.raises(ValueError, match=r"rigid face 'top': reaches the cut faces .* point on it, as \[0, 0, 0.5\]"):
        posed(right | wrong)
    if "point" in wrong:
        u = posed(right).solve().displacement
        x = posed(right).elasticity.x
        at = {tuple(np.round(place, 6)): moved for place, moved in zip(x, u, strict=True)}
        for (a, b, c), moved in at.items():  # (0, y, z) moves as (y, 0, z) does, turned
            if a == 0.0:
                other = at[b, 0.0, c]
                assert np.allclose(moved, [-other[1], other[0], other[2]], atol=1e-12)


def test_contact_across_the_cut_is_said():
    """Where a run ends: with nearly matching meshes both sides share forces that nothing determines."""
    with pytest.raises(NotConverged, match=r"contact goes across the cyclic symmetry of .* match to rounding there"):
        spun(False, (2, 2, 1)).solve(solver=InteriorPoint(max_iterations=2))


@pytest.mark.parametrize("sectors", [3, 4, 30])
def test_supports_that_reach_the_cuts(sectors):
    """Held along x in one sector is held along other directions in the next; around the axis or along it it is the
    same.  A sector of an annulus whose cut faces have equal nodes."""
    angle = 2.0 * np.pi / sectors

    def place(x):
        r = 1.0 + x[0]
        return np.stack([r * np.cos(angle * x[1]), r * np.sin(angle * x[1]), 0.5 * x[2]])

    def posed(*supports):
        mesh = box((1.0, 1.0, 1.0), (1, 4, 1), place=place)
        cut = CyclicSymmetry("front", "back", sectors=sectors)
        return ContactProblem(mesh, STEEL, list(supports), Contact("bottom", 0.3), ties=[cut])

    around = np.array([0.0, 0.0, 1.0])
    for even in (
        PrescribedRotation("top", (0.0, 0.0, 0.0), around, 1e-6),
        PrescribedDisplacement("top", lambda x: np.stack([1e-6 * x[0], 1e-6 * x[1], -1e-6 + 0.0 * x[2]])),
        PrescribedDisplacement("top", (0.0, 0.0, -1e-6), "z"),
        Clamp("left", "normal"),
    ):
        posed(Clamp("top", "z"), even).refuse_wrong_supports() if isinstance(even, Clamp) else posed(even).solve()
    for uneven in (
        PrescribedDisplacement("top", (1e-7, 0.0, -1e-6)),
        PrescribedDisplacement("top", lambda x: np.stack([0.0 * x[0], 0.0 * x[1], -1e-6 * x[0]]), "z"),
        Clamp("top", "x"),
    ):
        with pytest.raises(ValueError, match=r"'front' to 'back': at time 0 supports hold the node at \["):
            posed(Clamp("left", "z"), uneven).solve()


def test_a_history_of_a_sector():
    """Energies of a quarter are a quarter of those of the whole."""
    whole, quarter = (list(LoadHistory([0.5, 1.0]).steps(spun(one, (2, 2, 1)))) for one in (True, False))
    assert all(step.solution.valid for step in quarter)
    for name in ("loads", "elastic", "dissipated"):
        expected = getattr(whole[-1].state.energy, name)
        assert 4.0 * getattr(quarter[-1].state.energy, name) == pytest.approx(expected, rel=1e-5)
    assert "cyclic_symmetry_left_force_x" in quarter[-1].row


def test_a_quarter_is_the_whole_in_large_motions():
    """A rubber block whose top is pressed down by a tenth and turned by 40 degrees: the base slips."""

    def last(whole):
        n, corner = (4, 0.5) if whole else (2, 0.0)
        size = (1.0, 1.0, 0.5) if whole else (0.5, 0.5, 0.5)
        mesh = box(size, (n, n, 1), place=lambda x: np.stack([x[0] - corner, x[1] - corner, x[2]]))
        turn = PrescribedRotation("top", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.7, amplitude=[(1.0, 0.0), (2.0, 1.0)])
        gap = {"gap": -0.05, "gap_amplitude": [(0.0, 0.0), (1.0, 1.0)]}
        contact = Contact("bottom", 0.5, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), **gap)
        ties = [] if whole else [CyclicSymmetry("left", "front", sectors=4)]
        problem = ContactProblem(mesh, NeoHookean(1e6, 0.3), [turn], contact, ties=ties, kinematics="large")
        *_, step = LoadHistory([1.0, 1.5, 2.0]).steps(problem)
        return step

    one, part = last(True), last(False)
    assert one.solution.valid and part.solution.valid
    x, y = (step.solution.problem.elasticity.reference for step in (one, part))
    there = np.linalg.norm(y[:, None] - x, axis=2).argmin(axis=1)
    u, v = one.solution.displacement[there], part.solution.displacement
    assert np.abs(v - u).max() <= 1e-7 * np.abs(u).max()
    for name in ("moment_z", "normal_force", "energy_elastic", "energy_dissipated", "energy_prescribed"):
        assert 4.0 * part.row[name] == pytest.approx(one.row[name], rel=1e-6), name
    assert one.solution.at_nodes.numbers()["nodes"]["slip"] > 0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sectors": 1}, "a whole number of at least 2"),
        ({"sectors": 4, "axis": (0.0, 0.0, 0.0)}, "axis"),
        ({"sectors": 3}, "check axis, point and sectors"),
        ({"sectors": 4, "point": (0.1, 0.1, 0.0)}, "must face each other"),
    ],
)
def test_wrong_sectors_are_refused(given, words):
    with pytest.raises(ValueError, match=words):
        ties = [CyclicSymmetry("left", "front", **given)]
        ContactProblem(box((0.5, 0.5, 0.5), (2, 2, 2)), STEEL, [], Contact("bottom", 0.3), ties=ties)
