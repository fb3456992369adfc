"""Contact nodes moved by supports, on any number of ranks: `mpirun -n 3 python -m pytest` with this file."""

import numpy as np
import pytest
from conftest import STEEL
from mpi4py import MPI
from test_parallel import everywhere

import coulomb
from coulomb import CondensedSystem, Contact, ContactProblem, InteriorPoint, LoadHistory, Plane, PrescribedDisplacement

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
def test_pulled_on_any_number_of_ranks(cell, face, friction, moved, newton):
    """Multigrid on the ranks to 1e-8 of the factorised problem on one (each rank solves that for itself)."""
    solver = InteriorPoint(1e-10, newton=CondensedSystem()) if newton == "condensed" else None
    alone = pulled(MPI.COMM_SELF, cell, face, friction, moved)
    together = pulled(comm, cell, face, friction, moved, linear_solver=coulomb.IterativeSolver, explicit=False)
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
