"""Blocks whose contact nodes are moved by a support: T = F N, and friction acts on the support.

The block is pressed by a known pressure and held by soft springs in z.  Its end face is moved, with the edge on the
foundation, or its contact face itself.
"""

import math

import numpy as np
import pytest
from conftest import STEEL

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    InteriorPoint,
    LoadHistory,
    Plane,
    PrescribedDisplacement,
    Spring,
    SuccessiveTresca,
    Traction,
)
from coulomb.solvers import CondensedSystem, IterativeSolver

CELLS = ["hexahedron", "tetrahedron"]
FLOOR = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
SIZE, PRESSURE = (2.0, 1.0, 0.5), 1e7
AREA = SIZE[0] * SIZE[1]
LAWS = {
    "coulomb": {"friction": 0.3},
    "tresca": {"slip_stress": 2e6},
    "mohr-coulomb": {"friction": 0.2, "cohesion": 1e6},
    "orthotropic": {"friction": (0.3, 0.1), "direction": (1.0, 1.0, 0.0)},
}


def block(supports, cell="hexahedron", law="coulomb", motion=None, across=1e10, **options):
    return ContactProblem(
        coulomb.box(SIZE, (6, 3, 2), cell),
        STEEL,
        supports,
        Contact("bottom", foundation=FLOOR, motion=motion, **LAWS[law]),
        [Traction("top", (0.0, 0.0, -PRESSURE), amplitude=[(0.0, 0.0), (0.5, 1.0)])],
        springs=[Spring("top", (0.0, across, 1e9))],
        time=1.0,
        **options,
    )


def pulled(components, cell="hexahedron", law="coulomb", face="right", **options):
    """Pulled along x by a face; any other components are held."""
    return block([PrescribedDisplacement(face, (1e-3, 0.0, 0.0), components)], cell, law, **options)


def balanced(solution):
    """Loads, reactions and contact forces on the body add up to zero."""
    forces = [np.array(r.force) for r in (*solution.loads, *solution.reactions)]
    contact = np.array(solution.at_nodes.totals()["force"])
    assert np.abs(sum(forces) + contact).max() <= 1e-10 * PRESSURE * AREA
    return contact, dict(zip((r.kind for r in solution.reactions), [r.force for r in solution.reactions], strict=True))


@pytest.mark.parametrize(
    ("law", "components", "cell"), [(law, *held) for law in LAWS for held in (("x", CELLS[1]), ("xyz", CELLS[0]))]
)
def test_pulled_by_its_end_face(cell, components, law):
    """Every node slips along what its displacement says, at its bound; the grip pulls with what friction takes."""
    solution = pulled(components, cell, law).solve(1e-11)
    problem, x = solution.problem, solution.contact_force.reshape(-1, 3)
    assert solution.certificate.passed
    T, N = np.hypot(x[:, 1], x[:, 2]), x[:, 0].sum()
    assert T.sum() == pytest.approx(problem.law.cohesion.sum() + problem.law.friction @ x[:, 0], rel=1e-9)
    if law != "orthotropic":
        expected = LAWS[law].get("friction", 0.0) * N + sum(
            LAWS[law].get(name, 0.0) * problem.surface.area.sum() for name in ("cohesion", "slip_stress")
        )
        assert T.sum() == pytest.approx(expected, rel=1e-9)
    edge = problem.surface.x[:, 0] > SIZE[0] - 1e-9
    assert np.count_nonzero(edge) == (0 if components == "xyz" else 4)
    slip = solution.at_nodes.relative_displacement[:, 1:]
    if components == "x" and law != "orthotropic":
        assert np.allclose(slip[edge, 0], 1e-3, rtol=1e-15)
    along = np.einsum("ki,ki->k", x[:, 1:], slip) / (T * np.linalg.norm(slip, axis=1))
    assert np.all(along > 1.0 - 1e-12)
    contact, reaction = balanced(solution)
    assert reaction["prescribed_displacement"][0] == pytest.approx(-contact[0], rel=1e-10)
    assert contact[0] == pytest.approx(-sum(problem.surface.vectors(x * [0.0, 1.0, 1.0])[:, 0]), rel=1e-12)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("solver", ["factorised", "multigrid", "condensed", "successive Tresca"])
def test_friction_along_x_is_F_N(cell, solver):
    """All nodes are held in y: every slip is along x, and the force itself is F N to 1e-9."""
    sides = [Clamp(face, "y") for face in ("front", "back")]
    grip = PrescribedDisplacement("right", (1e-3, 0.0, 0.0), "xy")
    problem = ContactProblem(
        coulomb.box(SIZE, (6, 1, 3), cell),
        STEEL,
        [*sides, grip],
        Contact("bottom", foundation=FLOOR, friction=0.3),
        [Traction("top", (0.0, 0.0, -PRESSURE))],
        springs=[Spring("top", (0.0, 0.0, 1e9))],
        linear_solver=IterativeSolver if solver in ("multigrid", "condensed") else None,
    )
    assert np.any(problem.friction_problem.known_slip) and not np.all(problem.friction_problem.known_slip)
    chosen = {"condensed": InteriorPoint(1e-11, newton=CondensedSystem()), "successive Tresca": SuccessiveTresca(1e-11)}
    solution = problem.solve(1e-11, chosen.get(solver))
    assert solution.certificate.passed
    contact, reaction = balanced(solution)
    assert contact[0] == pytest.approx(-0.3 * contact[2], rel=1e-9)
    assert abs(contact[1]) <= 1e-12 * contact[2]
    assert contact[2] == pytest.approx(PRESSURE * AREA - reaction["spring"][2], rel=1e-10)


def test_to_and_fro():
    """Pressed, pulled, pushed back: F N in each direction once all slips, and the energies add up to first order."""
    table = [(0.5, 0.0), (1.5, 1.0), (3.5, -1.0)]
    grip = PrescribedDisplacement("right", (1e-3, 0.0, 0.0), "xy", amplitude=table)
    imbalance = []
    for count in (1, 2):
        times = [0.5, *(0.5 + k / (5 * count) for k in range(1, 15 * count + 1))]
        for step in LoadHistory(times, tolerance=1e-10).steps(block([grip])):
            assert step.solution.certificate.passed
            force, N = step.row["force_x"], step.row["normal_force"]
            balanced(step.solution)
            if step.state.time in (1.5, 3.5):
                way = -1.0 if step.state.time == 1.5 else 1.0
                assert force == pytest.approx(way * 0.3 * N, rel=1e-5)  # some slip sideways
        energy = step.state.energy
        imbalance.append(abs(energy.imbalance) / energy.dissipated)
    assert imbalance[1] < 0.6 * imbalance[0] < 0.06


def round_trip(t):
    """A circle of 1 mm, once round in 2 pi seconds."""
    return np.array([math.cos(t) - 1.0, math.sin(t), 0.0]) * 1e-3


def moved(by, cell, law, **options):
    """The whole contact face clamped in its plane and moved on a circle against its foundation."""
    clamp = [
        PrescribedDisplacement("bottom", (1.0, 0.0, 0.0), "x", amplitude=lambda t: round_trip(t)[0]),
        PrescribedDisplacement("bottom", (0.0, 1.0, 0.0), "y", amplitude=lambda t: round_trip(t)[1]),
    ]
    twice = [PrescribedDisplacement("bottom", tuple(2.0 * np.array(c.value)), c.components, c.amplitude) for c in clamp]
    return {
        "clamp": lambda: block(clamp, cell, law, across=0.0, **options),
        "foundation": lambda: block([Clamp("bottom", "xy")], cell, law, lambda t: -round_trip(t), 0.0, **options),
        "both": lambda: block(twice, cell, law, motion=round_trip, across=0.0, **options),
    }[by]()


@pytest.mark.parametrize(
    ("cell", "law"), [("hexahedron", "mohr-coulomb"), ("hexahedron", "orthotropic"), ("tetrahedron", "coulomb")]
)
def test_a_contact_face_moved_on_a_circle(cell, law):
    """Friction is exactly against the velocity; the same numbers whether clamp, foundation or both move."""
    times = [2.0 * math.pi * k / 6 for k in range(1, 7)]
    rows = {}
    for by in ("clamp", "foundation", "both"):
        rows[by] = []
        for step in LoadHistory(times, tolerance=1e-10).steps(moved(by, cell, law)):
            answer, t = step.solution.at_nodes, step.state.time
            assert step.solution.certificate.passed
            contact, _ = balanced(step.solution)
            rows[by].append([*contact, step.state.energy.dissipated, step.state.energy.imbalance])
            velocity = round_trip(t) - round_trip(t - times[0])
            velocity /= np.linalg.norm(velocity)
            if law != "orthotropic":
                T = answer.law.cohesion.sum() + answer.law.friction @ answer.force[:, 0]
                assert np.allclose(contact[:2], -T * velocity[:2], rtol=0.0, atol=1e-12 * T)
            clamp = sum(np.array(r.force) for r in step.solution.reactions if r.kind != "spring")
            inner = step.solution.problem.elasticity.internal_force(step.solution.displacement)
            inner = inner[step.solution.problem.surface.nodes].sum(axis=0)
            assert np.allclose(clamp[:2], (inner - contact)[:2], rtol=0.0, atol=1e-9 * PRESSURE * AREA)
            assert np.allclose(clamp[:2], -contact[:2], rtol=0.0, atol=1e-9 * PRESSURE * AREA)  # nothing else holds
        assert np.allclose(rows[by], rows["clamp"], rtol=1e-8, atol=1e-8 * PRESSURE * AREA)
    if law == "coulomb":
        # work of the mean of two forces: a half in the first step, (1 + cos 60)/2 in the others
        expected = -(0.5 + 5.0 * 0.5 * (1.0 - math.cos(math.pi / 3.0))) / 6.0
        elastic = 1e-2  # of pressing, and of the tilting by friction
        assert rows["clamp"][-1][4] / rows["clamp"][-1][3] == pytest.approx(expected, abs=elastic)


def test_a_clamp_that_stops_has_no_friction():
    """The law leaves friction undetermined where a prescribed slip is 0: it is set to 0, in one direction or both."""
    for components in ("x", "xy"):
        grip = PrescribedDisplacement("bottom", (1e-3, 0.0, 0.0), components, amplitude=[(0.5, 0), (1, 1)])
        for step in LoadHistory([0.5, 1.0, 1.5], tolerance=1e-10).steps(block([grip])):
            force = step.solution.contact_force.reshape(-1, 3)
            assert step.solution.certificate.passed
            if step.state.time == 1.0:
                assert force[:, 1].sum() == pytest.approx(0.3 * force[:, 0].sum(), rel=1e-4)
            else:
                assert np.all(force[:, 1] == 0.0)


def test_a_clamp_that_moves_with_its_foundation_has_no_friction():
    """The slip is 0 but for the rounding of two displacements: its direction must not count."""
    grip = PrescribedDisplacement("bottom", (0.1, 0.3, 0.0), "xy", amplitude=lambda t: 1e-2 * t / 3.0)
    problem = block([grip], motion=lambda t: (1e-2 * t / 30.0, 1e-2 * t / 10.0, 0.0), across=0.0)
    for step in LoadHistory([k / 7.0 for k in range(1, 8)]).steps(problem):
        force = step.solution.contact_force.reshape(-1, 3)
        assert step.solution.certificate.passed and force[:, 0].sum() > 0.1 * PRESSURE * AREA
        assert np.all(force[:, 1:] == 0.0)


def test_a_contact_face_that_opens():
    """With cohesion, friction of nodes that open is c a: exactly, also where the solver leaves a rest of pressure."""
    grip = PrescribedDisplacement("bottom", (1e-3, 0.0, 0.0), "xy")
    problem = ContactProblem(
        coulomb.box(SIZE, (6, 3, 2)),
        STEEL,
        [grip],
        Contact("bottom", foundation=FLOOR, friction=0.2, cohesion=1e6),
        [Traction("top", lambda x: np.array([0 * x[0], 0 * x[0], 4e7 * (x[0] - 1.0)]))],
        springs=[Spring("top", (0.0, 0.0, 1e11))],
    )
    solution = problem.solve()
    x = solution.contact_force.reshape(-1, 3)
    is_open = x[:, 0] == 0.0
    assert solution.certificate.passed and 0 < is_open.sum() < len(x)
    assert np.allclose(x[:, 1], problem.slip_bound(solution.contact_force), rtol=1e-14, atol=0.0)
    assert np.allclose(x[is_open, 1], 1e6 * problem.surface.area[is_open], rtol=1e-15) and np.all(x[:, 2] == 0.0)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_held_along_one_direction(angle):
    """The slip along the free direction obeys the law with the prescribed one: friction is along the whole slip."""
    h = np.array([math.cos(angle), math.sin(angle), 0.0])
    support = coulomb.PrescribedDisplacement("bottom", 1e-3 * h, direction=h) if angle else None
    support = support or PrescribedDisplacement("bottom", 1e-3 * h, "x")
    problem, condensed = block([support]), InteriorPoint(1e-11, newton=CondensedSystem())
    solutions = [problem.solve(1e-11, solver) for solver in (None, SuccessiveTresca(1e-11))]
    with np.errstate(divide="raise", invalid="raise"):
        solutions.append(block([support], linear_solver=IterativeSolver).solve(solver=condensed))
    for solution in solutions:
        slip, force = solution.at_nodes.slip, -solution.force_on_body
        assert np.allclose(slip @ h, 1e-3, rtol=1e-12)
        assert np.ptp(slip @ np.cross([0.0, 0.0, 1.0], h)) > 1e-6  # free across
        friction, N = force * [1.0, 1.0, 0.0], -force[:, 2]
        along = slip / np.linalg.norm(slip, axis=1)[:, None]
        assert np.allclose(friction, 0.3 * N[:, None] * along, rtol=0.0, atol=1e-9 * N.max())
        assert np.linalg.norm(solution.contact_force - solutions[0].contact_force) <= 1e-8 * np.linalg.norm(force)
