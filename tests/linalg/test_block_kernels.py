"""Products in small dense blocks, in C, against scipy's; multigrid with them against PETSc's."""

import ctypes
import gc
import os
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from benchmarks.block import block
from coulomb import Clamp, Material, box, native
from coulomb.fem.bodies.elasticity import Elasticity
from coulomb.linalg.compliance import stiffness
from coulomb.linalg.factors import NotPositiveDefinite
from coulomb.linalg.multigrid import block_matrix, recycled_cg
from coulomb.linalg.multigrid.block_matrix import (
    padded,
    symmetric_blocks,
)
from coulomb.linalg.multigrid.multigrid_cycle import Level, MultigridCycle
from coulomb.linalg.petsc_arrays import configured_ksp, distributed_entries
from coulomb.native import address


def petsc(matrix):
    csr = scipy.sparse.csr_matrix(matrix)
    csr.sort_indices()
    return PETSc.Mat().createAIJ(csr.shape, csr=(csr.indptr, csr.indices, csr.data), comm=PETSc.COMM_SELF)


def vector(values):
    v = padded(len(values))
    v[:] = values
    return v


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_multigrid_beside_petscs(cell, degree):
    """No more iterations than PETSc's multigrid, and a solution as accurate."""
    K = block(4, 0.3, cell, degree).elasticity.K
    f, u = K.createVecs()
    f.array[:] = np.random.default_rng(5).standard_normal(f.getLocalSize())
    petscs = configured_ksp(
        K, "cg", {"pc_type": "gamg", "pc_gamg_threshold": 0.02, "ksp_rtol": 1e-11, "ksp_norm_type": "unpreconditioned"}
    )
    petscs.solve(f, u)
    solver = stiffness.IterativeSolver(K, tolerance=1e-11)
    solver.solve(f, u)
    assert (K * u - f).norm() <= 2e-11 * f.norm()
    assert 5 < solver.iterations <= petscs.getIterationNumber()
    if degree == 2:  # with a grid of linear elements, which K carries: fewer than on the matrix alone
        matrix, other = K.copy(), f.duplicate()
        matrix.setNearNullSpace(K.getNearNullSpace())
        alone = stiffness.IterativeSolver(matrix, tolerance=1e-11)
        alone.solve(f, other)
        assert solver.iterations < alone.iterations
    product = f.duplicate()
    solver.multiply(u, product)
    assert (K * u - product).norm() <= 1e-14 * K.norm() * u.norm()
    solver.destroy()


def test_a_mesh_that_has_one_grid():
    """So small that it has no coarser one."""
    K = Elasticity(box((1.0, 1.0, 1.0), (1, 1, 1)), Material(1e9, 0.3), [Clamp("left")]).K
    f, u = K.createVecs()
    f.array[:] = np.arange(f.getLocalSize())
    solver = stiffness.IterativeSolver(K)
    solver.solve(f, u)
    assert (K * u - f).norm() <= 1e-10 * f.norm()
    solver.destroy()


def test_a_negative_diagonal_is_no_rounding_error():
    """As of a tangent beyond the load at which a body buckles: its smoother would take roots of it."""
    K = block(4, 0.3).elasticity.K
    diagonal = K.getDiagonal()
    diagonal.array[7] *= -1.0
    K.setDiagonal(diagonal)
    with pytest.raises(NotPositiveDefinite, match="not positive definite"):
        stiffness.IterativeSolver(K)


def test_threads_change_rounding_only(monkeypatch):
    """Of multigrid as a whole, with more threads than there are processors too."""
    K = block(6, 0.3).elasticity.K
    f, u = K.createVecs()
    f.array[:] = np.random.default_rng(5).standard_normal(f.getLocalSize())
    answers, iterations = [], []
    for count in (1, 3):
        for module in (block_matrix, recycled_cg):
            monkeypatch.setattr(module, "threads", lambda count=count: count)
            monkeypatch.setattr(module, "_ALONE", 0)
        solver = stiffness.IterativeSolver(K, tolerance=1e-8)
        solver.solve(f, u)
        answers.append(u.array.copy())
        iterations.append(solver.iterations)
        solver.destroy()
    assert iterations[0] == iterations[1]
    assert 0.0 < np.linalg.norm(answers[1] - answers[0]) <= 1e-10 * np.linalg.norm(answers[0])


@pytest.mark.parametrize(("given", "count"), [("", 1), ("1", 1), ("2,1", 2), ("64", 3), ("many", 1), ("0", 1)])
def test_threads_are_those_of_the_environment(monkeypatch, given, count):
    monkeypatch.setenv("OMP_NUM_THREADS", given)
    monkeypatch.setattr(native.os, "sched_getaffinity", lambda _: {0, 1, 2})
    assert native.threads.__wrapped__() == count
    assert os.environ["OMP_WAIT_POLICY"] == "passive"  # of the library of OpenMP, set before it is loaded
    assert os.environ["GOMP_SPINCOUNT"] == "1000"


@pytest.mark.parametrize(("compiler", "says"), [("absent", "needed as for DOLFINx's forms"), ("fails", "no such luck")])
def test_without_compiler(monkeypatch, tmp_path, compiler, says):
    """A compiler that is not there or fails is asked once."""
    script = tmp_path / "fails"
    script.write_text("#!/bin/sh\necho x >> $0.called\necho no such luck >&2\nexit 1\n")
    script.chmod(0o755)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("CC", str(tmp_path / compiler))
    native._loaded.cache_clear()
    try:
        for _ in range(2):
            with pytest.raises(ValueError, match=says):
                native.Kernels().order_along_space(0, None, None, 1)
    finally:
        native._loaded.cache_clear()
    if compiler == "fails":
        assert Path(f"{script}.called").read_text().count("x") == 2  # with threads and without


def test_a_cache_that_cannot_be_written(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    compiler = tmp_path / "compiler"  # its library is there already
    compiler.write_text(f'#!/bin/sh\nwhile [ "$1" != -o ]; do shift; done\ncp {native._loaded("factors")._name} "$2"\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setenv("CC", str(compiler))
    native._loaded.cache_clear()
    try:
        assert native.Kernels().order_along_space(0, None, None, 1) == 0
    finally:
        native._loaded.cache_clear()


def test_arguments_of_another_type_are_refused():
    with pytest.raises(ctypes.ArgumentError):
        native.kernels().order_along_space(native.address(np.zeros(3)), 3, None, 1.5)


def test_solves_start_from_earlier_solutions():
    """A combination of earlier right-hand sides costs nothing at their accuracy; older solutions than are kept do."""
    K = block(4, 0.3).elasticity.K
    solver = stiffness.IterativeSolver(K)
    rng, rhs = np.random.default_rng(6), []
    f, u = K.createVecs()
    for _ in range(25):
        f.array[:] = rng.standard_normal(f.getLocalSize())
        rhs.append(f.array.copy())
        solver.solve(f, u, 1e-3)
    costs = []
    for among in (rhs[5:], rhs[:5]):
        before = solver.iterations
        f.array[:] = sum(c * r for c, r in zip(rng.standard_normal(len(among)), among, strict=True))
        solver.solve(f, u, 1e-2)
        assert (K * u - f).norm() <= 1.01e-2 * f.norm()
        costs.append(solver.iterations - before)
    assert costs[0] == 0 and costs[1] > 0
    f.array[:] = rhs[-1]
    solver.solve(f, u)  # to full accuracy, although what is kept of earlier solutions is in single precision
    assert (K * u - f).norm() <= 2e-11 * f.norm()
    solver.destroy()


@pytest.mark.parametrize("unit", [1e-60, 1e60])
def test_earlier_solutions_are_used_in_any_unit(unit):
    """Their images are kept in single precision, which ends at 1e-38 and 1e38."""
    K = np.diag(np.arange(1.0, 31.0))

    def mult(x, y):
        y[:] = K @ x

    cg = recycled_cg.RecycledCG(MPI.COMM_SELF, 30, mult, lambda r: r.copy())
    rhs, u = unit * np.random.default_rng(8).standard_normal(30), np.empty(30)
    assert cg.solve(rhs, u, 1e-3) > 3 and cg.solve(-0.7 * rhs, u, 1e-2) == 0
    assert np.linalg.norm(K @ u + 0.7 * rhs) <= 1e-2 * np.linalg.norm(rhs)
    assert cg.solve(0.0 * rhs, u, 1e-2) == 0 and not u.any()


def test_dependent_directions_are_left_out():
    """Of solutions that differ by 1e-5 the images differ by their rounding errors: combinations of these, with large
    factors, would be a start whose residual is not what its images say, and the solve would end above its tolerance."""
    K, rng, u = np.diag(np.arange(1.0, 31.0)), np.random.default_rng(3), np.empty(30)

    def mult(x, y):
        y[:] = K @ x

    cg = recycled_cg.RecycledCG(MPI.COMM_SELF, 30, mult, lambda r: r / np.sqrt(np.diag(K)))
    first = rng.standard_normal(30)
    for _ in range(8):
        cg.solve(first + 1e-5 * rng.standard_normal(30), u, 1e-5)
    rhs = rng.standard_normal(30)
    cg.solve(rhs, u, 1e-4)
    assert np.linalg.norm(K @ u - rhs) <= 1.001e-4 * np.linalg.norm(rhs)


def test_a_second_cycle_is_for_the_residual_of_the_first():
    """A W-cycle on a grid without a coarser one: Jacobi twice, x + D^-1 (r - K x) with x = D^-1 r."""
    K = np.array([[4.0, 1.0, 0.0], [1.0, 3.0, -1.0], [0.0, -1.0, 5.0]])

    class Jacobi:
        """A level whose smoother is one step from zero."""

        size, blocks, interpolation = 3, property(lambda self: self), None

        def __init__(self):
            self.x, self.b = np.zeros(3), np.zeros(3)

        def mult(self, x, y):
            y[:3] = K @ x[:3]

        def smooth_from_zero(self):
            self.x[:] = self.b[:3] / np.diag(K)

        def smooth(self):
            """None after it."""

    r = np.array([1.0, -2.0, 3.0])
    once = r / np.diag(K)
    assert np.allclose(MultigridCycle(Jacobi())(r), once, rtol=1e-15)
    twice = once + (r - K @ once) / np.diag(K)
    assert np.allclose(MultigridCycle(Jacobi(), again=True)(vector(r))[:3], twice, rtol=1e-14)


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("n", [5, 8, 21])
def test_vectors_of_conjugate_gradients(n, threads):
    """Also of sizes that are no multiples of a vector register."""
    rng = np.random.default_rng(n)
    p, image, x, r, z = (vector(rng.standard_normal(n)) for _ in range(5))
    moved, left, direction = x + 0.3 * p, r - 0.3 * image, z + 0.7 * p
    square = native.kernels().advance(n, threads, 0.3, *map(address, (p, image, x, r)))
    assert square == pytest.approx(left @ left) and np.allclose(x, moved) and np.allclose(r, left)
    native.kernels().next_direction(n, threads, 0.7, address(z), address(p))
    assert np.allclose(p, direction)


def bytes_in_use():
    """Of this process's heap, by glibc."""
    names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()
    info = type("mallinfo2", (ctypes.Structure,), {"_fields_": [(name, ctypes.c_size_t) for name in names]})
    call = ctypes.CDLL(None).mallinfo2
    call.restype = info
    gc.collect()
    now = call()
    return now.uordblks + now.hblkhd


def array_bytes(thing, seen):
    """Of all arrays that an object of ours holds."""
    if id(thing) in seen or isinstance(thing, (type, PETSc.Object)):
        return 0
    seen[id(thing)] = thing
    if isinstance(thing, np.ndarray):
        return thing.nbytes if thing.base is None else array_bytes(thing.base, seen)
    parts = thing if isinstance(thing, (list, tuple)) else getattr(thing, "__dict__", {}).values()
    return sum(array_bytes(part, seen) for part in parts)


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_what_the_set_up_needs_is_freed(cell, degree):
    """Multigrid holds its own arrays, and K is referred to as often as before: neither matrices of the grids nor the
    linear elements of second order remain."""
    problem = block(8 // degree, 0.3, cell, degree)
    K = problem.elasticity.K
    stiffness.IterativeSolver(K).destroy()  # loads modules, and the space of linear elements
    before, references = bytes_in_use(), K.refcount
    solver = stiffness.IterativeSolver(K)
    held, own = bytes_in_use() - before, array_bytes(solver, {})
    assert own > 0.5 * K.getInfo()["nz_used"] * 12  # the count sees the blocks
    assert held <= own + 200_000
    assert K.refcount == references
    solver.destroy()
    del solver
    assert bytes_in_use() <= before + 200_000


def test_largest_eigenvalue_that_belongs_to_few_rows():
    """Of a chain of 100 000 nodes with eigenvalues up to 1.7 and one pair of nodes with 1.95.

    The smoother takes 1.05 times the estimate as its bound; where that is too small, multigrid is not definite.
    """
    count = 100_000
    beside = np.full(count - 1, 0.35)
    beside[:3] = 0.0, 0.95, 0.0
    K = scipy.sparse.kron(scipy.sparse.diags([beside, np.ones(count), beside], [-1, 0, 1]), np.eye(3)).tocsr()
    matrix = petsc(scipy.sparse.csr_matrix(K))
    level = Level(symmetric_blocks(distributed_entries(matrix), 3), 3)
    assert 1.94 <= level.largest <= 1.9501


# --- products in single precision: used where their errors are small beside the tolerance -----------------------------

N, ERROR = 64, 1e-5
CHAIN = 2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1)  # eigenvalues from 2e-3 to 4
SMOOTH, UNEVEN = np.ones(N), (-1.0) ** np.arange(N)


class Rough:
    """Products by CHAIN with errors of a part ERROR of its diagonal."""

    def __init__(self):
        self.products = 0

    def mult_roughly(self, x, y):
        y[:] = CHAIN @ x + ERROR * UNEVEN * 2.0 * x
        self.products += 1

    def rounding(self, x):
        return float(np.sum((ERROR * 2.0 * x) ** 2))


@pytest.mark.parametrize(
    ("rhs", "tolerance", "used"),
    [(UNEVEN * np.cos(np.arange(N) / 9.0), 0.03, True), (UNEVEN * np.cos(np.arange(N) / 9.0), 1e-6, False)]
    # smooth and large, but the start, a combination of earlier solutions, has little of it: accurate in the end
    + [(SMOOTH, 1e-3, True)],
    ids=["few digits", "many digits", "not seen at the start"],
)
def test_rough_products_where_they_are_accurate_enough(rhs, tolerance, used):
    rough, u = Rough(), padded(N)

    def mult(x, y):
        y[:] = CHAIN @ x

    cg = recycled_cg.RecycledCG(MPI.COMM_SELF, N, mult, lambda r: 0.5 * r, rough=rough)
    cg.solve(UNEVEN * (1.0 + np.arange(N) / N), u, tolerance)
    assert rough.products == 0  # nothing is known about the solution of a first solve
    cg.solve(rhs, u, tolerance)
    assert np.linalg.norm(rhs - CHAIN @ u) <= tolerance * np.linalg.norm(rhs) and (rough.products > 0) == used
