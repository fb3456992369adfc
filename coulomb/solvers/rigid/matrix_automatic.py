"""The default solver where A is a matrix: by cones where A has no full rank or is sparse, as rigid bodies make it, and
by regularised problems where it has no full rank and contacts are few."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse

from ...arrays import FloatArray
from ...linalg.compliance import MatrixCompliance
from ..automatic import Automatic
from ..dense_system import DenseSystem
from ..friction_problem import FrictionProblem, Solver
from ..interior_point import InteriorPoint
from ..results import Goal, NotConverged, ProgressCallback, SolverResult, Status
from ..settings import SolverSettings
from ..successive_tresca import SuccessiveTresca
from .cone_interior_point import ConeInteriorPoint
from .gauss_seidel import Sweeps, swept
from .regularised_newton import RegularisedNewton

_FEW = 150  # contacts up to which the cone method is the quicker one, whatever A
_FEWER = 30  # and for which, without full rank, regularised problems come before it, and less work is spent
_WORK = 1e9  # operations of the cone method per contact, of so few
_TRESCA = 300  # Newton steps of successive Tresca where A has no full rank and other methods have failed
_SPARSE = 0.25  # of the entries
_BY_SWEEPS = f"auto: {ConeInteriorPoint.name}"
_DEFINITE = 1e-8  # smallest eigenvalue of a definite A, over the mean diagonal


@dataclass(frozen=True)
class MatrixAutomatic(SolverSettings):
    """`ConeInteriorPoint` without cohesion if A is small, sparse, or not clearly definite; else `Automatic`, or
    `InteriorPoint` with given slip bounds.

    The cone method factorises sparse matrices, or small dense ones, needs no full rank, and ends after a given amount
    of work; where it fails the problem is refused, with the reason.  With a large, dense and definite A, that of an
    elastic body, the Krylov methods of `InteriorPoint` are quicker.

    Where A is not clearly positive definite and contacts are few, `RegularisedNewton` comes first, with given slip
    bounds for the forces of least norm; it also comes after the others, if they fail on another A.

    Attributes:
        tolerance: Residual at which to stop.

    Raises:
        ValueError: If the tolerance is not positive.
    """

    name = "auto"

    def solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None = None,
        *,
        gradient: FloatArray | None = None,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
        sweeps: Sweeps | None = None,
    ) -> SolverResult:
        """Solve a problem with friction; arguments and errors as those of `Solver.solve`.

        Args:
            sweeps: Those that `swept` has made for the problem.

        Raises:
            NotConverged: With the best answer of the methods, and the messages of all.
        """
        tolerance = self.tolerance if tolerance is None else tolerance
        cones, regularised = ConeInteriorPoint(tolerance), RegularisedNewton(tolerance)
        by_cones = cones.suits(problem) and (sweeps is not None or _for_cones(problem.A))
        few = regularised.suits(problem) and problem.A.nodes <= (_FEWER if by_cones else _FEW)
        singular = few and not _definite(_matrix(problem.A).toarray())
        if by_cones and singular:
            cones = replace(cones, work=_WORK * problem.A.nodes)

        def regularise() -> SolverResult:
            return regularised.solve(problem, progress=progress)

        def by(krylov: Solver) -> Callable[[], SolverResult]:
            return lambda: krylov.solve(problem, start, gradient=gradient, progress=progress)

        def by_cone_method() -> SolverResult:
            if sweeps is None:
                return cones.solve(problem, start, progress=progress)
            return cones.after(problem, sweeps, progress=progress)

        if by_cones:
            methods = [regularise, by_cone_method] if singular else [by_cone_method]
        elif singular:
            methods = [regularise, by(InteriorPoint(tolerance, newton=DenseSystem())), by(InteriorPoint(tolerance))]
            methods += [by(SuccessiveTresca(tolerance, newton_steps=_TRESCA))] if problem.sloped else []
        else:
            methods = [by(Automatic(tolerance) if problem.sloped else InteriorPoint(tolerance))]
            methods += [regularise] if few else []
        products, failed = problem.A.products, list[SolverResult]()
        for method in methods:
            try:
                result = method()
            except NotConverged as failure:
                failed.append(failure.result)
                if failure.result.status in (Status.INTERRUPTED, Status.NO_EQUILIBRIUM):
                    break
            else:
                return self._named(result, problem.A.products - products)
        decisive = failed[-1].status in (Status.INTERRUPTED, Status.NO_EQUILIBRIUM)
        best = failed[-1] if decisive else min(failed, key=lambda result: result.residual)
        message = failed[-1].message if decisive else ".  Then ".join(result.message for result in failed)
        raise NotConverged(message, replace(self._named(best, problem.A.products - products), message=message))

    def _named(self, result: SolverResult, products: int) -> SolverResult:
        """A result of one of the methods as that of this one."""
        method = result.method if result.method.startswith(self.name) else f"{self.name}: {result.method}"
        return replace(result, method=method, products=max(products, result.products))

    def swept(self, A: Any, b: Any, friction: Any) -> SolverResult | Sweeps | None:
        """The answer by sweeps, or what they reached; None where they are not tried, or an argument is not plain.

        All that a valid problem has to satisfy is checked, but not said: None for whatever does not.

        Args:
            A: As for `solve_coulomb`.
            b: Likewise.
            friction: Likewise.
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
        try:
            b = np.ascontiguousarray(b, dtype=np.float64)
            friction = np.asarray(friction, dtype=np.float64, order="C")
            if friction.ndim == 0:
                friction = float(friction)
        except (TypeError, ValueError, OverflowError):
            return None
        sweeps = swept(A, b, friction, self.tolerance)
        if sweeps is None or not sweeps.residual <= self.tolerance:
            return sweeps
        return sweeps.result(_BY_SWEEPS, Goal(self.tolerance, None))


def _for_cones(A: Any) -> bool:
    """Whether a matrix is small, sparse, or not clearly positive definite."""
    if not isinstance(A, MatrixCompliance):
        return False
    if A.nodes <= _FEW:
        return True
    matrix = _matrix(A)
    return bool(matrix.nnz <= _SPARSE * matrix.shape[0] ** 2 or not _definite(matrix.toarray()))


def _matrix(A: Any) -> Any:
    assert isinstance(A, MatrixCompliance)
    return A.sparse()


def _definite(matrix: FloatArray) -> bool:
    """Whether the smallest eigenvalue is clearly above zero, by a Cholesky factorisation."""
    n, a = len(matrix), float(np.mean(np.diag(matrix)))
    matrix[np.arange(n), np.arange(n)] -= _DEFINITE * a
    try:
        scipy.linalg.cholesky(matrix, overwrite_a=True, check_finite=False)
    except scipy.linalg.LinAlgError:
        return False
    return True
