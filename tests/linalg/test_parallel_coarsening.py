"""Coarse grids of multigrid on any number of ranks: run alone, or as `mpirun -n 3 python -m pytest ...`."""

import numpy as np
import pytest
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc
from ranks import by_place, everywhere

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Elasticity,
    Material,
    NamedMesh,
    Spring,
    SymmetryPlane,
    Traction,
    box,
)
from coulomb.fem.bodies.materials import midpoints
from coulomb.linalg.compliance import stiffness
from coulomb.linalg.multigrid import coarsening, multigrid_cycle
from coulomb.linalg.multigrid.block_matrix import PADDING, padded, symmetric_blocks
from coulomb.linalg.multigrid.coarsening import WholeRows, whole
from coulomb.linalg.multigrid.recycled_cg import RecycledCG
from coulomb.linalg.petsc_arrays import distributed_entries
from coulomb.linalg.reductions import concatenated

COMM = MPI.COMM_WORLD


def dense(matrix, size):
    """All rows, on every rank."""
    return multigrid_cycle.entries_of(whole(matrix).own, size).toarray()


def dense_interpolation(P, shape):
    """All rows, on every rank."""
    mine = np.zeros((shape[0] * (len(P.own.pointers) - 1), shape[1] * int(P.starts[-1])))
    for part, numbers in ((P.own, np.arange(*P.starts[COMM.rank : COMM.rank + 2])), (P.others, P.columns)):
        if part is not None:
            blocks = part.values[:-PADDING].reshape(-1, *shape)
            for row in range(len(part.pointers) - 1):
                for k in range(part.pointers[row], part.pointers[row + 1]):
                    column = shape[1] * numbers[part.columns[k]]
                    mine[shape[0] * row : shape[0] * (row + 1), column : column + shape[1]] = blocks[k]
    return concatenated(COMM, mine)


def next_grid(matrix, size, motions):
    K = dense(matrix, size)
    largest = scipy.linalg.eigh(K, np.diag(np.diag(K)), eigvals_only=True)[-1]
    first = size * matrix.starts[COMM.rank]
    inverse = 1.0 / np.diag(K)[first : first + len(motions)]
    return K, coarsening.coarser(matrix, size, motions, inverse, largest)


@pytest.mark.parametrize("team", [1, 3])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_two_coarse_grids(monkeypatch, cell, team):
    """P^T K P is that of the interpolation, which makes rigid motions and moves nothing that is held."""
    monkeypatch.setattr(coarsening, "threads", lambda: team)
    monkeypatch.setattr(coarsening, "_ALONE", 0)
    mesh = box((3.0, 1.0, 1.0), (9, 3, 3), cell, comm=COMM)
    body = Elasticity(mesh, Material(1e9, 0.3), [Clamp("left"), SymmetryPlane("front")])
    matrix, size = symmetric_blocks(distributed_entries(body.K), 3), 3
    motions = np.column_stack([v.array_r for v in body.K.getNearNullSpace().getVecs()])
    for _ in range(2):
        K, coarse = next_grid(matrix, size, motions)
        P = dense_interpolation(coarse.P, (size, 6))
        product, expected = dense(coarse.matrix, 6), P.T @ K @ P
        none = np.diag(expected) == 0.0
        assert np.all(np.diag(product)[none] > 0.0)
        product[none, none] = 0.0
        assert np.abs(product - expected).max() <= 1e-12 * np.abs(expected).max()
        held = np.count_nonzero(K, axis=1) == 1
        assert np.all(P[held] == 0.0)
        if size == 3:
            made = P @ concatenated(COMM, coarse.motions)
            wanted = concatenated(COMM, motions) * ~held[:, None]
            still = np.abs(K @ wanted).max(axis=1) <= 1e-9 * np.abs(K).max()
            assert still.sum() > 0.2 * len(K) and held.any()
            assert np.abs(made - wanted)[still].max() <= 1e-6
        matrix, size, motions = coarse.matrix, 6, coarse.motions
    assert len(product) < 0.2 * body.K.getSize()[0]


def test_rows_that_are_coupled_with_another_rank_only_are_not_held():
    """Two nodes per rank; the last one of a rank is coupled with the first of the next, and with none of its own."""
    nodes = 2 * COMM.size
    K = np.kron(np.eye(nodes), 4.0 * np.eye(3))
    for a in range(1, nodes - 1, 2):
        K[3 * a : 3 * a + 3, 3 * a + 3 : 3 * a + 6] = K[3 * a + 3 : 3 * a + 6, 3 * a : 3 * a + 3] = np.ones((3, 3))
    mine = scipy.sparse.csr_matrix(K[6 * COMM.rank : 6 * COMM.rank + 6])
    matrix = PETSc.Mat().createAIJ(((6, None), (6, None)), csr=(mine.indptr, mine.indices, mine.data), comm=COMM)
    blocks = WholeRows(symmetric_blocks(distributed_entries(matrix), 3), 3)
    loose = concatenated(COMM, coarsening._aggregates(blocks, 1)[2])
    np.testing.assert_array_equal(loose, np.count_nonzero(K, axis=1) > 1)


@pytest.mark.parametrize("last", [0, COMM.size - 1])
def test_ranks_without_nodes_or_without_aggregates(last):
    """Three nodes that belong together and one that hardly does, on the first rank; the fifth, coupled with that one
    only, on another, where it has no aggregate beside it; ranks between them, or all others, have no nodes."""
    K = np.kron(np.eye(5), 6.0 * np.eye(3))
    for a, size in enumerate((1.0, 1.0, 1e-3, 1e-3)):
        K[3 * a : 3 * a + 3, 3 * a + 3 : 3 * a + 6] = K[3 * a + 3 : 3 * a + 6, 3 * a : 3 * a + 3] = size * np.ones(
            (3, 3)
        )
    first, end = 15 * (COMM.rank > last), 15 * (last <= COMM.rank)
    if last > 0:
        first, end = 12 * (COMM.rank > 0), 12 + 3 * (last <= COMM.rank)
    mine, sizes = scipy.sparse.csr_matrix(K[first:end]), (end - first, None)
    matrix = PETSc.Mat().createAIJ((sizes, sizes), csr=(mine.indptr, mine.indices, mine.data), comm=COMM)
    rng, blocks = np.random.default_rng(5), symmetric_blocks(distributed_entries(matrix), 3)
    motions, forces = rng.standard_normal((15, 6))[first:end], rng.standard_normal((2, 15))
    coarse = next_grid(blocks, 3, motions)[1]
    P = dense_interpolation(coarse.P, (3, 6))
    assert P.shape == (15, 6) and np.any(P[9:12]) and not np.any(P[12:])
    np.testing.assert_allclose(dense(coarse.matrix, 6), P.T @ K @ P, atol=1e-12)
    cycle = multigrid_cycle._cycle(blocks, 3, motions)
    cg, u = RecycledCG(COMM, cycle.size, cycle.mult, cycle, rough=cycle), padded(end - first)
    for f in forces:
        cg.solve(f[first:end], u, 1e-9)
        assert np.linalg.norm(K @ concatenated(COMM, u) - f) <= 1.1e-9 * np.linalg.norm(f)
    cycle.destroy()


@pytest.mark.parametrize("springs", [False, True])
def test_few_iterations(springs):
    """On any number of ranks, some without nodes; the same where soft springs hold the body."""
    mesh = box((3.0, 1.0, 1.0), (12, 4, 4), comm=COMM)
    clamps, spring = ([], [Spring("left", 1e6)]) if springs else ([Clamp("left")], [])
    K = Elasticity(mesh, Material(1e9, 0.3), clamps, springs=spring).K
    f, u = K.createVecs()
    f.array[:] = np.sin(np.arange(*K.getOwnershipRange()))
    solver = stiffness.IterativeSolver(K, tolerance=1e-8)
    solver.solve(f, u)
    assert (K * u - f).norm() <= 1.1e-8 * f.norm()
    assert solver.iterations <= 12  # 13 to 16 where the interpolation is hardly smoothed
    solver.destroy()


@pytest.mark.parametrize("cells", [2, 5])
def test_corners_between_supports(cells):
    """10-node tetrahedra whose edges from a corner all lie on supports: on the grid of vertices nothing moves there.
    One coarse grid, and several."""
    mesh = box((1.0, 1.0, 1.0), (cells, cells, cells), "tetrahedron", degree=2, comm=COMM)
    body = Elasticity(mesh, Material(1e9, 0.3), [Clamp("right"), Clamp("front")])
    K = body.K
    f, u = K.createVecs()
    f.array[:] = np.sin(np.arange(*K.getOwnershipRange()))
    solver = stiffness.IterativeSolver(K, tolerance=1e-8)
    solver.solve(f, u)
    assert (K * u - f).norm() <= 1.1e-8 * f.norm() and solver.iterations <= 30
    solver.destroy()


def test_materials_far_apart():
    """Rubber with mean dilatations under steel, held by friction alone: as if the stiffness were factorised.

    To 1e-9: rounding errors of the steel leave about 1e-10 (`MEAN_ABOVE`).
    """

    def solved(comm, solver):
        whole = box((0.08, 0.06, 0.028), (6, 4, 7), comm=comm)
        z = midpoints(whole.domain)[: whole.domain.topology.index_map(3).size_local, 2]
        low, high = (np.flatnonzero(part).astype(np.int32) for part in (z < 0.02, z > 0.02))
        materials = {"lower": Material(2e7, 0.45), "upper": Material(2.1e11, 0.3)}
        loads = [Traction("top", (1.2e5, 0.0, -3e5))]
        mesh = NamedMesh(whole.domain, whole.faces, {"lower": low, "upper": high})
        return ContactProblem(mesh, materials, [], Contact("bottom", 0.6), loads, linear_solver=solver).solve(1e-9)

    expected, found = solved(MPI.COMM_SELF, stiffness.DirectSolver), solved(COMM, stiffness.IterativeSolver)
    assert found.certificate.passed
    assert found.problem.linear.stiffness.solver.name.startswith("iterative")
    known = by_place(expected.problem.surface.x, expected.force_on_body)
    off = by_place(everywhere(found.problem.surface.x), everywhere(found.force_on_body)) - known
    assert np.linalg.norm(off) <= 1e-7 * np.linalg.norm(known)
