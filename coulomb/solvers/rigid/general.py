"""Contact problems without a mesh: any symmetric positive definite or semidefinite A with b and slip bounds or
friction.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ...linalg.compliance import Compliance, MatrixCompliance
from ...linalg.reductions import Reductions
from ..friction_problem import FrictionProblem, Solver
from ..laws import FrictionLaw
from ..results import SolverResult
from ..rigid_motions import RigidMotions
from .gauss_seidel import Sweeps
from .matrix_automatic import MatrixAutomatic

_FEW = 150  # contacts up to which the eigenvalues of A are checked


def solve_tresca(
    A: Any,
    b: Any,
    slip_bound: Any,
    lower: Any = 0.0,
    solver: Solver | None = None,
    *,
    rigid: RigidMotions | None = None,
) -> SolverResult:
    """min 1/2 x^T A x - b^T x  subject to  x_n >= lower,  |x_t| <= slip_bound  at every contact.

    Args:
        A: Symmetric positive definite or semidefinite, shape (3 m, 3 m): a numpy array, a scipy sparse matrix, or an
            assembled PETSc matrix (whose rows on this rank belong to whole contacts); in any consistent units.  Its
            diagonal is positive, except that rows along tangents may be zero, with their columns: there the slip is
            known, that of b.
        b: Shape (3 m,), contact by contact (n, t1, t2); with a PETSc matrix, this rank's part.
        slip_bound: Radius of every friction disc, >= 0; a number or shape (m,).
        lower: Lower bound of the normal forces; a number or shape (m,).
        solver: By default MatrixAutomatic(): InteriorPoint() where A is definite, RegularisedNewton() where it is not
            and contacts are few; or KPRGP().
        rigid: Rigid motions with their equilibrium G x = e, if contact alone holds a body; G and e are those of this
            rank. A is then that of any generalised inverse of the stiffness.

    Returns:
        The answer, x contact by contact.  Where A is semidefinite several x may have the same displacements A x and the
        same objective: RegularisedNewton() gives that of least norm.

    Raises:
        ValueError: If A is not square, symmetric and made of blocks of three, or other arguments are inconsistent with
            it.
        NotConverged: If the residual stays above the solver's tolerance, or if rigid motions have no equilibrium.
    """
    compliance = _compliance(A)
    bound = _for_each("slip_bound", slip_bound, compliance.nodes)
    qp = FrictionProblem.tresca(compliance, _numbers("b", b), bound, _numbers("lower", lower))
    return (solver or MatrixAutomatic()).solve(replace(qp, rigid=_motions(rigid)))


def solve_coulomb(
    A: Any,
    b: Any,
    friction: Any,
    solver: Solver | None = None,
    *,
    cohesion: Any = 0.0,
    rigid: RigidMotions | None = None,
) -> SolverResult:
    """As `solve_tresca` with slip_bound = cohesion + friction x_n at the solution.

    Args:
        A: As for `solve_tresca`.
        b: As for `solve_tresca`.
        friction: Coefficient of every contact, >= 0; a number or shape (m,).
        solver: By default MatrixAutomatic(): the cone method where A is small, sparse or without full rank, with
            cohesion RegularisedNewton() where it has no full rank, else Automatic(); or InteriorPoint(),
            SuccessiveTresca(), ConeInteriorPoint() or RegularisedNewton().
        cohesion: Cohesion of every contact, >= 0, in units of force; a number or (m,).
        rigid: As for `solve_tresca`.

    Raises:
        ValueError: As `solve_tresca`.
        NotConverged: If the Coulomb residual stays above the solver's tolerance.
    """
    sweeps: Sweeps | None = None
    if solver is None and rigid is None and isinstance(cohesion, float | int) and cohesion == 0:
        found = MatrixAutomatic().swept(A, b, friction)
        if isinstance(found, SolverResult):
            return found
        sweeps = found
    compliance = _compliance(A)
    coefficient = _for_each("friction", friction, compliance.nodes)
    law = FrictionLaw(_for_each("cohesion", cohesion, compliance.nodes), coefficient)
    problem = FrictionProblem(compliance, _numbers("b", b), law, rigid=_motions(rigid))
    return MatrixAutomatic().solve(problem, sweeps=sweeps) if solver is None else solver.solve(problem)


def _motions(rigid: RigidMotions | None) -> RigidMotions | None:
    return rigid and replace(rigid, G=_numbers("rigid.G", rigid.G), e=_numbers("rigid.e", rigid.e))


def _numbers(name: str, values: Any) -> FloatArray:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be made of numbers") from None


def _for_each(name: str, values: Any, nodes: int) -> FloatArray:
    """One number per contact."""
    numbers = _numbers(name, values)
    return np.full(nodes, float(numbers)) if numbers.ndim == 0 else numbers


def _compliance(A: Any) -> Compliance:
    sparse = None
    if isinstance(A, PETSc.Mat):
        matrix = A
    elif scipy.sparse.issparse(A):
        sparse = _square(scipy.sparse.csr_matrix(A, dtype=np.float64))
        if not sparse.has_canonical_format:  # else PETSc does not add up entries of the same place
            sparse = sparse.copy()
            sparse.sum_duplicates()
        rows = (sparse.indptr.astype(PETSc.IntType), sparse.indices.astype(PETSc.IntType), sparse.data)
        matrix = PETSc.Mat().createAIJ(sparse.shape, csr=rows, comm=MPI.COMM_SELF)
    else:
        dense = np.asfortranarray(_square(_numbers("A", A)))
        matrix = PETSc.Mat().createDense(dense.shape, array=dense, comm=MPI.COMM_SELF)
    matrix.assemble()
    size = matrix.norm(PETSc.NormType.FROBENIUS)
    (rows, columns), over = matrix.getSize(), Reductions(matrix.getComm().tompi4py())
    if rows != columns or not over.all(matrix.getLocalSize()[0] % 3 == 0):
        raise ValueError(f"A must be square with three rows per contact on its rank, but is {rows} x {columns}")
    if not np.isfinite(size):
        raise ValueError("A has entries that are not finite")
    if not (matrix.isSymmetric(1e-8 * size) if sparse is None else abs(sparse - sparse.T).max() <= 1e-8 * size):
        raise ValueError("A must be symmetric")
    compliance = MatrixCompliance(matrix, sparse)
    diagonal = compliance.diagonal()
    zero = np.flatnonzero(diagonal == 0.0)
    first = matrix.getOwnershipRange()[0]
    known = bool(np.all(zero % 3 > 0)) and not any(np.any(matrix.getRow(first + int(row))[1]) for row in zero)
    if not (over.min(diagonal) >= 0.0 and over.all(known)):
        raise ValueError(
            "A must be positive semidefinite, but has a diagonal entry that is not positive (only zero rows along "
            "tangents, where the slip is known, may have a zero)"
        )
    _refuse_indefinite(compliance, size)
    return compliance


def _refuse_indefinite(A: MatrixCompliance, size: float) -> None:
    """Refuse a small A on one rank with a negative eigenvalue: Tresca's problem would have no minimum."""
    if A.comm.size > 1 or A.nodes > _FEW:
        return
    matrix = A.sparse().toarray()
    try:
        scipy.linalg.cholesky(matrix + 1e-8 * size * np.eye(len(matrix)), overwrite_a=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        least = float(np.linalg.eigvalsh(matrix)[0])
        if least < -1e-8 * size:
            raise ValueError(f"A must be positive semidefinite, but has an eigenvalue of {least:.3g}") from None


def _square(A: Any) -> Any:
    if A.ndim != 2 or A.shape[0] != A.shape[1] or A.shape[0] % 3 or A.shape[0] == 0:
        raise ValueError(f"A must be square with three rows per contact, but has shape {A.shape}")
    return A
