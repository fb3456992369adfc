"""Load histories on any number of ranks: ranks without contact nodes, rotating foundations, nodes moved by supports."""

import numpy as np
import pytest
from conftest import STEEL
from mpi4py import MPI
from ranks import by_place, everywhere
from rotating_foundations import CELLS, puck, shoe, steps

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    HistoryFiles,
    InteriorPoint,
    LoadHistory,
    Material,
    Plane,
    PrescribedDisplacement,
    Rotation,
    Traction,
    box,
)
from coulomb.linalg.reductions import Reductions
from coulomb.solvers import CondensedSystem


@pytest.mark.parametrize("clamped", [("left",), ()], ids=["clamped", "floating"])
def test_ranks_without_contact_nodes(clamped):
    """A tall column on a plane: the ranks that own its upper part have no contact nodes; the resultant is the load."""
    problem = ContactProblem(
        box((0.2, 0.2, 2.0), (1, 1, 12)),
        Material(2e11, 0.3),
        clamps=[Clamp(face, components="y") for face in clamped],
        tractions=[Traction("top", (0.0, 0.0, -1e7)), Traction("top", (2e5, 0.0, 0.0), amplitude=np.sin)],
        contact=Contact("bottom", friction=0.5),
    )
    taken = list(LoadHistory([1.0, 1.5, 2.0]).steps(problem))
    assert all(step.solution.valid for step in taken)
    assert [step.row["normal_force"] for step in taken] == pytest.approx([0.04 * 1e7] * 3, rel=1e-8)


@pytest.mark.parametrize("cell", CELLS)
def test_friction_of_a_disc_is_against_the_rotation(cell):
    """The table takes each node along, with friction along axis x r; the torque is F times the sum of N r, and 2/3 F N
    R up to the mesh."""
    *_, last = steps(puck(cell=cell), [1.0, 1.2, 2.0])
    at = last.solution.at_nodes
    r = at.x * [1, 1, 0]
    away = np.linalg.norm(r, axis=1) > 1e-6
    along = np.cross([0, 0, 1], r[away]) / np.linalg.norm(r[away], axis=1)[:, None]
    friction = at.on_body[away] * [1, 1, 0]
    use = 0.3 * at.force[away, 0]
    over = Reductions(MPI.COMM_WORLD)
    assert over.max(np.abs(friction - use[:, None] * along)) < 1e-3 * over.max(use)
    normal = over.sum(at.force[:, 0])
    expected = -0.3 * over.sum(at.force[:, 0] * np.linalg.norm(r, axis=1))
    assert last.row["bottom_torque"] == pytest.approx(expected, rel=1e-6)
    assert last.row["bottom_torque"] == pytest.approx(-2 / 3 * 0.3 * normal * 0.05, rel=0.02)
    assert last.row["bottom_power"] == pytest.approx(last.row["bottom_torque"] * 4.0, rel=1e-12)
    assert last.row["bottom_angle"] == 4.5


def test_a_drum_keeps_frames_and_compliance():
    rotation = Rotation((0.05, 9.0, -0.5), (0, 1, 0), [(0, 0), (1, 0), (2, 6.0)])
    problem = shoe(rotation)
    taken = steps(problem, [0.5, 1.0, 1.5, 2.0])
    for step in taken:
        assert step.solution.problem.A is problem.A
        assert step.solution.problem.surface.frames is problem.surface.frames
        assert step.solution.valid and step.solution.small_strain.gap_error < 0.01
    # a short pad on a drum: F N r with the nodes' radii
    at = taken[-1].solution.at_nodes
    over = Reductions(MPI.COMM_WORLD)
    radius = np.linalg.norm((at.x - [0.05, 0.0, -0.5]) * [1, 0, 1], axis=1)
    row = taken[-1].row
    assert row["slip"] + row["open"] == 7 * 4
    assert row["bottom_torque"] == pytest.approx(-0.3 * over.sum(at.force[:, 0] * radius), rel=1e-6)
    assert row["bottom_torque"] == pytest.approx(-0.3 * row["normal_force"] * 0.5, rel=0.01)
    assert row["force_x"] > 0.0  # the top of the drum goes towards +x, and takes the block along


comm = MPI.COMM_WORLD
END = 2e-3


def pulled(comm, cell, face, friction, motion=None, **options):
    """A block pulled by its end face, or by its contact face, or held there while its foundation moves."""
    grip = PrescribedDisplacement(face, (0.0 if motion else END, 0.0, 0.0), "xy", amplitude=[(1.0, 0.0), (2.0, 1.0)])
    return ContactProblem(
        coulomb.box((2.0, 1.0, 0.5), (6, 3, 2), cell, comm=comm),
        STEEL,
        [grip],
        Contact("bottom", foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), motion=motion, **friction),
        [coulomb.Traction("top", (0.0, 0.0, -1e7))],
        springs=[coulomb.Spring("top", (0.0, 0.0, 1e10))],
        **options,
    )


def motion(t):
    return (-END * max(t - 1.0, 0.0), 0.0, 0.0)


@pytest.mark.parametrize("newton", ["default", "condensed"])
@pytest.mark.parametrize(
    ("cell", "face", "friction", "moved"),
    [
        ("hexahedron", "right", {"friction": 0.3}, None),
        ("tetrahedron", "right", {"slip_stress": 2e6}, None),
        ("tetrahedron", "bottom", {"friction": (0.3, 0.1), "direction": (1.0, 1.0, 0.0)}, None),
        ("hexahedron", "bottom", {"friction": 0.3}, motion),
    ],
    ids=["Coulomb", "Tresca", "orthotropic, all held", "moving foundation"],
)
@pytest.mark.ranks
def test_pulled_on_any_number_of_ranks(cell, face, friction, moved, newton):
    """Multigrid on the ranks to 1e-8 of the factorised problem on one (each rank solves that for itself)."""
    solver = InteriorPoint(1e-10, newton=CondensedSystem()) if newton == "condensed" else None
    alone = pulled(MPI.COMM_SELF, cell, face, friction, moved)
    together = pulled(comm, cell, face, friction, moved, linear_solver=coulomb.solvers.IterativeSolver, explicit=False)
    one, many = (
        list(LoadHistory([1.0, 2.0], tolerance=1e-10, solver=chosen).steps(problem))
        for problem, chosen in ((alone, None), (together, solver))
    )
    for expected, step in zip(one, many, strict=True):
        solution, surface = step.solution, step.solution.problem.surface
        known = expected.solution.contact_force.reshape(-1, 3)
        known = known[np.lexsort(expected.solution.problem.surface.x.round(9).T)]
        force = everywhere(solution.contact_force.reshape(-1, 3))[np.lexsort(everywhere(surface.x).round(9).T)]
        assert solution.certificate.passed
        assert np.linalg.norm(force - known) <= 1e-8 * np.linalg.norm(known)
        row, reference = step.row, expected.row
        reaction = f"prescribed_displacement_{face}_force_x"
        for name in ("force_x", reaction, "energy_foundation", "energy_dissipated"):
            assert row[name] == pytest.approx(reference[name], rel=1e-7, abs=1e-7 * reference["energy_elastic"])
        assert row[reaction] == pytest.approx(-row["force_x"], rel=1e-8, abs=1e-8 * row["normal_force"])
    assert many[-1].row["slip"] == len(alone.surface.nodes)


@pytest.mark.ranks
def test_a_history_of_one_rank_goes_on_with_what_was_accumulated(tmp_path):
    """From the files of its first step, on all ranks."""
    folder, history, last = comm.bcast(tmp_path), LoadHistory([1.0, 2.0, 3.0], tolerance=1e-10), []
    given = ("tetrahedron", "right", {"friction": 0.3, "cohesion": 1e5}, motion)
    *_, whole = history.steps(pulled(MPI.COMM_SELF, *given))
    if comm.rank == 0:
        stop = iter([False, True])
        history.run(pulled(MPI.COMM_SELF, *given), HistoryFiles(folder), on_step=lambda _: next(stop))
    comm.barrier()
    history.run(pulled(comm, *given), HistoryFiles(folder, resume=True), on_step=last.append)
    (step,) = last
    known, found = whole.state.accumulated, step.state.accumulated
    x, own = everywhere(step.solution.problem.surface.x), whole.solution.problem.surface.x
    for name in ("slip", "friction_work", "pressure"):
        expected = by_place(own, getattr(known, name))
        assert by_place(x, everywhere(getattr(found, name))) == pytest.approx(expected, rel=1e-6), name
        assert expected.min() > 0.0
    assert step.state.energy.dissipated == pytest.approx(whole.state.energy.dissipated, rel=1e-7)
