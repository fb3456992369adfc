"""Contact problems without a mesh: any symmetric positive definite or semidefinite A with b and slip bounds or
friction.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
import scipy.linalg
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from ...linalg.compliance import Compliance, MatrixCompliance
from ...linalg.reductions import Reductions
from ..automatic import DECISIVE, FINISH, Automatic, outcome
from ..friction_problem import FrictionProblem, Solver, SolverSettings, Task, contact_solver
from ..interior_point import InteriorPoint, smallest_force
from ..laws import FrictionLaw
from ..newton_systems import DenseSystem
from ..results import Goal, SolverResult, Status
from ..rigid_motions import RigidMotions
from ..successive_tresca import SuccessiveTresca
from .cone_interior_point import ConeInteriorPoint
from .gauss_seidel import Sweeps, sweep
from .own_units import OwnUnits
from .regularised_newton import RegularisedNewton

_log = logging.getLogger(__name__)

_FEW: Final = 150
"""Contacts up to which the cone method is the quicker one, whatever A, and its eigenvalues are checked."""

_FEWER: Final = 30  # and for which, without full rank, regularised problems come before it, and less work is spent
_WORK: Final = 1e9  # operations of the cone method per contact, of so few
_TRESCA: Final = 300
"""Newton steps of successive Tresca where other methods have failed, without full rank or on so few."""

_SPARSE: Final = 0.25  # of the entries
_BY_SWEEPS = f"auto: {ConeInteriorPoint.name}"
_DEFINITE: Final = 1e-8  # smallest eigenvalue of a definite A, over the mean diagonal
_ROUNDED: Final = 1e-6  # size of a negative eigenvalue, over that of A, that entries of six digits may cause


@dataclass(frozen=True)
class MatrixAutomatic(SolverSettings):
    """`ConeInteriorPoint` without cohesion if A is small, sparse, or not clearly definite; else `Automatic`, or
    `InteriorPoint` with given slip bounds.

    The cone method factorises sparse matrices, or small dense ones, needs no full rank, and ends after a given amount
    of work; where it fails the problem is refused, with the reason.  With a large, dense and definite A, that of an
    elastic body, the Krylov methods of `InteriorPoint` are quicker.

    Where A is not clearly positive definite and contacts are few, `RegularisedNewton` comes first, with given slip
    bounds for the forces of least norm; it also comes after the others, if they fail on another A.

    If no method converges, NotConverged has the best answer, and the messages of all.

    Attributes:
        tolerance: Residual at which to stop.
        sweeps: Those that `sweep` has made for the problem.

    Raises:
        ValueError: If the tolerance is not positive.
    """

    sweeps: Sweeps | None = None

    name = "auto"

    def _solved(self, problem: FrictionProblem, task: Task) -> SolverResult:
        least = smallest_force(problem, task.goal)
        if least is not None and least.residual == 0.0:
            return replace(least, method=f"{self.name}: no forces")
        own = OwnUnits.of(problem)
        if own is None:
            return self._by_methods(problem, task)
        first = self._in_own_units if problem.sloped else self._by_methods  # least norm is in these
        second = self._by_methods if problem.sloped else self._in_own_units
        attempt = first(problem, task)
        if attempt.status in (Status.CONVERGED, *DECISIVE):
            return attempt
        other = second(problem, task)
        decided = other.status in (Status.CONVERGED, *DECISIVE)
        return other if decided else min((attempt, other), key=lambda result: result.residual)

    def _in_own_units(self, problem: FrictionProblem, task: Task) -> SolverResult:
        """`_by_methods` in units of force of each contact, if these are not alike."""
        own = OwnUnits.of(problem)
        assert own is not None
        posed = own.problem(task.goal.tolerance)
        found = own.result(replace(self, sweeps=None)._by_methods(posed, own.task(task)))
        return replace(found, products=found.products + posed.A.products)

    def _by_methods(self, problem: FrictionProblem, task: Task) -> SolverResult:
        tolerance = task.goal.tolerance
        cones, regularised = ConeInteriorPoint(tolerance, self.sweeps or True), RegularisedNewton(tolerance)
        ending = SuccessiveTresca(tolerance, newton_steps=_TRESCA)

        def matrix() -> Any:
            assert isinstance(problem.A, MatrixCompliance)
            return problem.A.sparse()

        by_cones = cones.suits(problem) and (self.sweeps is not None or _for_cones(matrix()))
        few = regularised.suits(problem) and problem.A.nodes <= (_FEWER if by_cones else _FEW)
        singular = few and not _definite(matrix().toarray())
        methods: list[Solver] = [regularised] if singular else []
        if by_cones:
            methods += [replace(cones, work=_WORK * problem.A.nodes) if singular else cones]
        elif singular:
            path = InteriorPoint(tolerance, finish=FINISH)
            methods += [replace(path, newton=DenseSystem()), path]
            methods += [ending] if problem.sloped else []
        else:
            both = Automatic(tolerance, successive_tresca=ending if problem.A.nodes <= _FEWER else None)
            methods += [both, *([regularised] if few else [])]
        products, tried = problem.A.products, list[SolverResult]()
        for method in methods:
            solve = partial(method.solve, problem, task.start, gradient=task.gradient, progress=task.progress)
            best = outcome(solve)
            tried.append(best)
            if best.status in (Status.CONVERGED, *DECISIVE):
                break
        else:
            best = min(tried, key=lambda result: result.residual)
            best = replace(best, message=".  Then ".join(result.message for result in tried))
        others = max(best.products - (problem.A.products - products), 0)  # sweeps, and products by the scaled A
        return replace(best, products=others, method=f"{self.name}: {best.method.removeprefix(f'{self.name}: ')}")

    def by_sweeps(self, A: Any, b: Any, friction: Any) -> SolverResult | Sweeps | None:
        """The answer by sweeps, or what they reached; None where they are not tried, or an argument is not plain.

        All that a valid problem has to satisfy is checked, but not said: None for whatever does not.  Arguments as of
        `solve_coulomb`.
        """
        few = 3 * _FEW
        if type(A) is np.ndarray:
            if A.ndim != 2 or len(A) > few:
                return None
        elif scipy.sparse.issparse(A):
            if A.shape[0] > few and A.nnz > _SPARSE * A.shape[0] ** 2:
                return None
            if A.format != "csr" or A.dtype != np.float64:
                A = scipy.sparse.csr_matrix(A, dtype=np.float64)
        else:
            return None
        if np.iscomplexobj(A) or np.iscomplexobj(b) or np.iscomplexobj(friction):
            return None
        try:
            b = np.ascontiguousarray(b, dtype=np.float64)
            friction = np.asarray(friction, dtype=np.float64, order="C")
            if friction.ndim == 0:
                friction = float(friction)
        except (TypeError, ValueError, OverflowError):
            return None
        sweeps = sweep(A, b, friction, self.tolerance)
        if sweeps is None or not sweeps.residual <= self.tolerance:
            return sweeps
        return sweeps.result(_BY_SWEEPS, Goal(self.tolerance, None))


def _for_cones(matrix: Any) -> bool:
    """Whether a matrix is small, sparse, or not clearly positive definite."""
    n = matrix.shape[0]
    return n <= 3 * _FEW or matrix.nnz <= _SPARSE * n**2 or not _definite(matrix.toarray())


def _definite(matrix: FloatArray) -> bool:
    """Whether the smallest eigenvalue is clearly above zero, by a Cholesky factorisation."""
    n, a = len(matrix), float(np.mean(np.diag(matrix)))
    matrix[np.arange(n), np.arange(n)] -= _DEFINITE * a
    try:
        scipy.linalg.cholesky(matrix, overwrite_a=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        return False
    return True


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
    return (contact_solver(solver) or MatrixAutomatic()).solve(replace(qp, rigid=_motions(rigid)))


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

    Examples:
        One contact, pressed with 10 N and pulled with 5 N: it slips, and friction bears 0.3 of 10 N.

        >>> import numpy as np
        >>> from coulomb import solve_coulomb
        >>> A, b = 1e-6 * np.eye(3), 1e-6 * np.array([10.0, 5.0, 0.0])
        >>> solve_coulomb(A, b, friction=0.3).x.round(6)
        array([10.,  3.,  0.])
    """
    sweeps: Sweeps | None = None
    if solver is None and rigid is None and isinstance(cohesion, float | int) and cohesion == 0:
        answer = MatrixAutomatic().by_sweeps(A, b, friction)
        if isinstance(answer, SolverResult):
            return answer
        sweeps = answer
    compliance = _compliance(A)
    coefficient = _for_each("friction", friction, compliance.nodes)
    law = FrictionLaw(_for_each("cohesion", cohesion, compliance.nodes), coefficient)
    problem = FrictionProblem(compliance, _numbers("b", b), law, rigid=_motions(rigid))
    return (contact_solver(solver) or MatrixAutomatic(sweeps=sweeps)).solve(problem)


def _motions(rigid: RigidMotions | None) -> RigidMotions | None:
    return rigid and replace(rigid, G=_numbers("rigid.G", rigid.G), e=_numbers("rigid.e", rigid.e))


def _numbers(name: str, values: Any) -> FloatArray:
    if np.iscomplexobj(values):
        raise ValueError(f"{name} must be made of real numbers, but is complex")
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
        if np.iscomplexobj(A):
            raise ValueError("A must be made of real numbers, but is complex")
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
    """Refuse a small A on one rank with a negative eigenvalue: Tresca's problem would have no minimum.  One as small as
    rounded entries cause is a warning: an answer has its residual for A as given."""
    if A.comm.size > 1 or A.nodes > _FEW:
        return
    matrix = A.sparse().toarray()
    try:
        scipy.linalg.cholesky(matrix + 1e-8 * size * np.eye(len(matrix)), overwrite_a=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        least = float(np.linalg.eigvalsh(matrix)[0])
        if least < -_ROUNDED * size:
            raise ValueError(f"A must be positive semidefinite, but has an eigenvalue of {least:.3g}") from None
        if least < -1e-8 * size:
            _log.warning(
                "A has an eigenvalue of %.3g, %.1e of its norm: its entries are taken for rounded", least, least / size
            )


def _square(A: Any) -> Any:
    if A.ndim != 2 or A.shape[0] != A.shape[1] or A.shape[0] % 3 or A.shape[0] == 0:
        raise ValueError(f"A must be square with three rows per contact, but has shape {A.shape}")
    return A
