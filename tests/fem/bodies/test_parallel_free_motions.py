"""Bodies that contact alone holds, on several ranks: the same motions, answers and messages as on one.

Run alone, or as `mpirun -n 3 python -m pytest tests/fem/bodies/test_parallel_free_motions.py`.
"""

import numpy as np
import pytest
from mpi4py import MPI

import coulomb
from coulomb import Contact, ContactProblem, Material, TotalForce
from coulomb.fem.bodies.elasticity import Elasticity
from coulomb.fem.meshes.meshes import distributed
from coulomb.model.equilibrium import NoEquilibrium

STEEL = Material(young=2.1e11, poisson=0.3)
WEIGHT = 1e6


def stack(push, comm=MPI.COMM_WORLD):
    """Two blocks on a floor, pressed by WEIGHT, the upper one pushed; neither is clamped."""
    lower = coulomb.box((2.0, 1.0, 0.5), (3, 2, 1), comm=comm)
    upper = coulomb.moved(coulomb.box((1.0, 1.0, 0.5), (2, 2, 1), "tetrahedron", comm), translate=(0.5, 0.0, 0.5))
    contacts = [Contact("lower:bottom", 0.5), Contact("upper:bottom", 0.3, against="lower:top")]
    loads = [TotalForce("upper:top", (0.0, 0.0, -WEIGHT)), TotalForce("upper:bottom", (0.6 * push, 0.8 * push, 0.0))]
    return ContactProblem(coulomb.join(lower=lower, upper=upper), STEEL, [], contacts, loads)


def test_the_same_answer_as_on_one_rank():
    together, alone = stack(0.25 * WEIGHT), stack(0.25 * WEIGHT, MPI.COMM_SELF)
    assert [str(motion) for motion in together.elasticity.free.motions] == [
        str(motion) for motion in alone.elasticity.free.motions
    ]
    found, expected = together.solve(tolerance=1e-10), alone.solve(tolerance=1e-10)
    assert found.certificate.passed and "of every body" in found.certificate["force balance"].meaning
    for part in range(2):
        force, known = (np.array(one.at_nodes.totals(part)["force"]) for one in (found, expected))
        assert np.abs(force - known).max() <= 1e-8 * WEIGHT
        assert np.abs(known) == pytest.approx([0.15 * WEIGHT, 0.2 * WEIGHT, WEIGHT], rel=1e-8)
    places, moved = (np.concatenate(together.comm.allgather(part)) for part in (by_body(together), found.displacement))
    order, own = np.lexsort(places.T), np.lexsort(by_body(alone).T)
    off = np.abs(moved[order] - expected.displacement[own]).max()
    assert off <= 1e-7 * np.abs(expected.displacement).max()


def by_body(problem):
    """Rounded places of this rank's nodes, and the number of their body, shape (k, 4)."""
    body = problem.elasticity
    return np.column_stack([np.round(body.x, 9), body.free.component])


def test_all_ranks_refuse_alike():
    with pytest.raises(NoEquilibrium) as failure:
        stack(0.4 * WEIGHT).solve()
    said = MPI.COMM_WORLD.allgather(str(failure.value))
    expected = 'loads push body "upper" along (0.6, 0.8, 0) with 400 kN; friction holds at most 300 kN'
    assert set(said) == {f"there is no equilibrium: {expected}"}


def test_components_of_a_mesh_are_found_across_ranks():
    """Two bars of eight cubes each, given on one rank: each has six motions about its own centre."""
    comm = MPI.COMM_WORLD
    shape = (5, 3, 3)
    grid = np.stack(np.meshgrid(*(np.arange(float(n)) for n in shape), indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.array([np.ravel_multi_index(c, shape) for c in np.ndindex(4, 2, 2)])
    offsets = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
    cells = corner[:, None] + np.ravel_multi_index(offsets.T, shape)
    points = np.concatenate([grid, grid + [10.0, 0.0, 0.0]])
    cells = np.concatenate([cells, cells + len(grid)])
    if comm.rank:
        points, cells = np.empty((0, 3)), np.empty((0, 8), dtype=cells.dtype)
    body = Elasticity(coulomb.NamedMesh(distributed(comm, points, cells), {}), STEEL, [])
    assert len(body.free) == 12
    assert np.array_equal(body.free.component, np.where(body.x[:, 0] < 5.0, 0, 1))
    assert body.free.motions[6].part.centre == pytest.approx([12.0, 1.0, 1.0])
    assert body.free.bodies[1] == "component 2 of the body, around (12, 1, 1)"
