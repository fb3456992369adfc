"""A semismooth Newton method for problems near to one that has been solved: the next step of a load history.

It solves the equations of contact (contact_equations.py) from the forces of the step before, or from these
extrapolated, whichever leave the smaller residual.  Where few nodes open, close, stick or slip anew it takes 2 to 6
full steps, in place of the 15 of the interior-point method, which has to begin inside the cones and to follow a path to
their surface anew.  It has no safeguard of its own: if the residual does not fall fast, it ends, and `Automatic` takes
the interior-point method.  CONVERGED is earned as there, by the natural residual computed afresh with the most accurate
product, and by the certificate.

The Newton systems are solved by FGMRES with products by A, preconditioned by the nodal derivative with A ~ diag(rest) -
V V^T + U U^T (low_rank.py) in place of A; U is that of earlier steps of the history.  With rigid motions w = A x - b -
G^T alpha, and G x = e are further equations.

By multigrid a product by A takes several V-cycles.  Where supports hold the bodies, u is then carried along with x, and
a step is the solution of the equations of contact and of K u + B^T x = f together, by V-cycles of K with springs in
place of contact (`CoupledKrylov`), one for each iteration; no A x is computed but at the end, for the residual that
decides.  From the end of the path of the block of 128,000 unknowns steps take 43 V-cycles in place of 111.

Which of several solutions of a Coulomb problem it finds is not known, as for the interior-point method; it stays near
the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from petsc4py import PETSc

from ..arrays import FloatArray
from ..linalg.compliance import (
    BodyCompliance,
    CarryingKrylov,
    ConstraintPreconditioner,
    CoupledKrylov,
    Elimination,
    LowRankApproximation,
    MatrixFreeCompliance,
    NodalMap,
)
from .contact_equations import ContactDerivative, ContactEquations
from .contact_preconditioner import ContactPreconditioner, FormedInverse, SprungInverse
from .driver import Answer, drive, result_of
from .friction_problem import FrictionProblem, SolverSettings, Task
from .results import SemismoothStep, SolverResult, Status
from .rigid_motions import NO_MOTION
from .scaled_problem import IterateProducts, ScaledCompliance
from .settings import within

_FORMED: Final = 600
"""Contact unknowns up to which Newton systems of one problem in a sequence, each with its own A, are factorised on one
rank: that takes less time than the calls of a Krylov method."""

_HEAVY: Final = 10.0
"""Weight of what is out of balance at unknowns, times the root of their number, over the largest contact force: what is
left over by all together moves contact points far more than each by itself."""

_HEAVIER: Final = 1e3
"""Largest factor by which this grows where w of the balanced displacement is farther from an answer than before."""

_SHARE = (0.3, 0.01)
"""Largest and least relative residual of a system over those of steps by products."""

_MOST: Final = 60
"""Iterations of a system that is solved, at most: usual are 10 to 30."""

_CHANGED: Final = 0.05
"""Part of the contact points from which on springs are replaced if these have another status."""


@dataclass(frozen=True)
class SemismoothNewton(SolverSettings):
    """The semismooth Newton method as a value.

    It is not among the public names of `coulomb`: without a start near the answer it fails on most problems, and it
    has no safeguard.  `Automatic`, the default of `LoadHistory`, takes it where it is useful, from the second load step
    on, with the interior-point method as its safeguard.

    The start may be several forces, shape (c, 3 m), of which it takes the best; without any it starts from 0.  The
    gradient is A x - b of a single start, without rigid motions, from the last product of A.  `history` has a
    SemismoothStep per step.  It fails if the residual does not fall fast, or a tangent of a node is partly prescribed.

    Attributes:
        tolerance: Natural residual at which to stop (`FrictionProblem.residual`).
        max_iterations: Newton steps before it gives up.
        patience: Steps without a residual below `falls` times the best before it gives up.
        falls: See `patience`.
        refused: Residual over the tolerance below which it gives up if the certificate refuses the answer.
        forcing: Largest relative residual of a Newton system; it falls with the residual of the problem,
        sharpest: and is at least this.
        rank: Columns of the low-rank approximation of A in the preconditioner, with exact products and where a product
            is a solve: with fewer a step takes less time and needs a few more products.
        updated_from: Krylov iterations of a step from which on the approximation is brought up to date, likewise.
        product: If a product is a solve, its accuracy at iterates, relative to the change, and the best in a Krylov
            method.
        finer: With exact products, steps are computed to this part of the tolerance, and a start is an answer only
            below it: nodes that stick then have no slip beyond rounding, and no work of either sign.
        settled: An answer is one only after a step that has changed no force by more than this part of the largest on
            its body.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    max_iterations: int = within("[1, inf)", 20)
    patience: int = within("[1, inf)", 4)
    falls: float = within("(0, 1]", 0.9)
    refused: float = within("[0, inf)", 0.0)
    forcing: float = within("(0, 1)", 0.1)
    sharpest: float = within("(0, forcing]", 1e-6)
    rank: tuple[int, int] = within("[0, inf)", (60, 100))
    updated_from: tuple[int, int] = within("[1, inf)", (16, 12))
    product: float = within("(0, 1)", 1e-3)
    finer: float = within("(0, 1]", 1e-3)
    settled: float = within("(0, inf]", math.inf)

    name = "semismooth Newton"

    def _solved(self, problem: FrictionProblem, task: Task) -> SolverResult:
        starts = np.atleast_2d(np.zeros_like(problem.b) if task.start is None else task.start)
        iteration = SemismoothIteration if _sprung(problem) is None else _SprungIteration
        return iteration(self, problem, task).run(starts, task.gradient)


class Direction(NamedTuple):
    """A step: dx and A dx (m, 3), dalpha (r,), scaled, and its Krylov iterations."""

    dx: FloatArray
    A_dx: FloatArray
    dalpha: FloatArray
    iterations: int


class SemismoothIteration:
    """The steps from one start, a `driver.Iteration`.

    Forces in newtons; A, b, w in units of the mean diagonal a of A, newtons as well.
    """

    def __init__(self, settings: SemismoothNewton, problem: FrictionProblem, task: Task):
        self._settings, self._problem, self._goal, self._progress = settings, problem, task.goal, task.progress
        self._history: list[SemismoothStep] = []
        self._x: FloatArray
        self._A_x: FloatArray
        self._rows: FloatArray
        self._alpha: FloatArray
        self._at: ContactDerivative
        self._over, self._a, m = problem.reductions, problem.mean_diagonal, problem.A.nodes
        self._T: FloatArray = np.empty((0, 0))
        self._e: FloatArray = NO_MOTION
        G: FloatArray = np.empty((m, 3, 0))
        if problem.rigid is not None:
            basis = problem.motion_basis
            self._T, self._e = basis.T, basis.T @ problem.rigid.e
            G = basis.rows.T.reshape(m, 3, len(basis.T))
        self._scaled = ScaledCompliance(problem.A, np.ones((m, 3)), self._a, 1.0, G)
        self._images = IterateProducts(self._scaled)
        self._scaled.recalls = True
        self._b = problem.b.reshape(-1, 3) / self._a
        self._scaled.diagonal = d = _without_zeros(self._scaled.diagonal)
        lower = np.broadcast_to(np.asarray(problem.lower, dtype=np.float64), (m,))
        self._equations = ContactEquations(problem.law, lower, problem.frictional, d[:, 0], 0.5 * (d[:, 1] + d[:, 2]))
        costly = 0 if problem.A.exact else 1
        self._updated_from = settings.updated_from[costly]
        self._A: LowRankApproximation | None = None
        self._inverse: ContactPreconditioner | FormedInverse
        formed = None
        if problem.together and problem.A.exact and 3 * m <= _FORMED and isinstance(problem.A, BodyCompliance):
            formed = problem.A.formed()
        if formed is None:
            self._inverse = self._prepared(settings.rank[costly])
            self._A = self._inverse.A
        else:
            self._inverse = FormedInverse(formed / formed.dtype.type(self._a), d)
        self._constraints = self._scaled.constraints
        self._accuracy = settings.forcing
        self._finer = settings.finer if problem.A.exact else 1.0

    def _prepared(self, rank: int) -> ContactPreconditioner:
        """That of the problem before, if A has stayed as it was; else from what is known of A; collective."""
        A, d, known = self._problem.A, self._scaled.diagonal, self._problem.A.learnt.prepared
        if isinstance(known, ContactPreconditioner) and known.A.fits(d, rank, A.exact):
            return known
        learnt, rigid = self._scaled.known(), self._scaled.rigid
        return ContactPreconditioner(A.comm, LowRankApproximation(A.comm, d, rank, A.exact, known=learnt, rigid=rigid))

    def run(self, starts: FloatArray, gradient: FloatArray | None = None) -> SolverResult:
        """From the best of the starts (c, 3 m) to the answer, or to where the residual stalls; collective."""
        d, frictional = self._scaled.diagonal, self._problem.frictional
        if not self._over.all(bool(np.all(d[:, 0] > 0.0) and np.all(d[frictional, 1:] > 0.0))):
            self._x, self._alpha = starts[0].reshape(-1, 3), np.zeros(len(self._e))
            self._A_x = self._scaled.mult(self._x)
            return self._result(Status.STAGNATED)
        self._krylov = self._new_krylov(self._product)
        try:
            self._x, self._A_x, self._alpha = (
                self._best(starts) if gradient is None else self._from(starts[0], gradient)
            )
            settings, start = self._settings, self._begin()
            status = drive(self, self._goal, self._history, settings.max_iterations, self._progress, start)
            if status is not None:
                self._A_x = self._images.exact(self._x)
            return self._result(status)
        finally:
            if self._A is not None:
                self._A.forget_new()
                self._scaled.keep(self._A.learnt, self._inverse)
            self._krylov.free()

    def _new_krylov(self, product: NodalMap) -> CarryingKrylov:
        return CarryingKrylov(
            self._constraints,
            3,
            product,
            lambda p, A_p: self._rows * self._at.apply(p, A_p),
            lambda r, r3: self._bordered(r / self._rows, r3),
            PETSc.KSP.Type.FGMRES,
        )

    def _best(self, starts: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The start with the smallest residual: x, A x, alpha; collective."""
        candidates: list[tuple[float, FloatArray, FloatArray]] = []
        for forces in starts:
            x = forces.reshape(-1, 3).copy()
            x[~self._problem.frictional, 1:] = 0.0
            A_x = self._scaled.mult(x, self._settings.product)
            candidates.append((self._residual(x, A_x, self._closing(x, A_x)), x, A_x))
        _, x, A_x = min(candidates, key=lambda one: one[0] if one[0] == one[0] else math.inf)
        if not self._problem.A.exact:
            A_x = self._images.first(x, self._settings.product)
        return x, A_x, self._closing(x, A_x)

    def _from(self, forces: FloatArray, gradient: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A start with its A x - b in metres, shape (3 m,): x, A x, alpha; collective."""
        x = forces.reshape(-1, 3).copy()
        x[~self._problem.frictional, 1:] = 0.0
        A_x: FloatArray = gradient.reshape(-1, 3) / self._a + self._b
        return x, A_x, self._closing(x, A_x)

    def _closing(self, x: FloatArray, A_x: FloatArray) -> FloatArray:
        """The alpha that closes the contact best under x, scaled."""
        if not len(self._e):
            return NO_MOTION
        alpha = self._problem.rigid_motion(x.ravel(), self._a * (A_x - self._b).ravel())
        return np.linalg.lstsq(self._T.T, alpha / self._a, rcond=None)[0]

    def _w(self, A_x: FloatArray, alpha: FloatArray) -> FloatArray:
        """A x - b - G^T alpha in newtons."""
        return self._constraints.without(A_x - self._b, alpha)

    def _residual(self, x: FloatArray, A_x: FloatArray, alpha: FloatArray) -> float:
        return self._problem.residual(self._problem.completed(x.ravel()), self._a * self._w(A_x, alpha).ravel())

    def _of_bodies(self, x: FloatArray, A_x: FloatArray, alpha: FloatArray) -> float:
        """The residual by bodies, which falls in every step while single contacts open and close."""
        forces = self._problem.completed(x.ravel())
        return self._problem.residual_of_bodies(forces, self._a * self._w(A_x, alpha).ravel())

    def _product(self, x: FloatArray) -> FloatArray:
        y = self._scaled.mult(x, self._krylov.allowed(self._accuracy))
        if self._A is not None:
            self._A.record(x, y)
        return y

    def _begin(self) -> float:
        """To the start; its residual if it may be the answer, else inf."""
        residual = self._residual(self._x, self._A_x, self._alpha)
        self._left = self._sharp(residual, self._finer)
        self._at = self._equations.at(self._x, self._w(self._A_x, self._alpha))
        self._fallen, self._since = self._of_bodies(self._x, self._A_x, self._alpha), 0
        may_be = residual <= self._finer * self._goal.residual and self._settings.settled == math.inf
        return self._left if may_be else math.inf

    def _sharp(self, residual: float, part: float = 1.0) -> float:
        """The residual; with the most accurate product where it decides, and without rounding errors at open nodes."""
        if not residual <= part * self._goal.residual:
            return residual
        self._x = self._equations.opened(self._x, self._w(self._A_x, self._alpha))
        self._A_x = self._images.exact(self._x)
        return self._residual(self._x, self._A_x, self._alpha)

    def step(self) -> SemismoothStep | None:
        settings, before = self._settings, self._at.status
        if self._goal.refused and self._left < settings.refused * self._goal.tolerance:
            return None
        direction = self._direction(self._at, self._x, self._A_x, self._alpha, self._left)
        if direction is None:
            return None
        dx, A_dx, dalpha, iterations = direction
        self._x, self._alpha = self._x + dx, self._alpha + dalpha
        self._A_x = self._moved(A_dx)
        self._left = self._sharp(self._residual(self._x, self._A_x, self._alpha))
        self._at = self._equations.at(self._x, self._w(self._A_x, self._alpha))
        changed = int(self._over.sum((self._at.status != before).astype(float)))
        moved, residual = self._problem.scales.moved(dx, self._x), self._left
        if not moved <= settings.settled:
            residual = max(residual, math.nextafter(self._goal.residual, math.inf))
        return SemismoothStep(len(self._history) + 1, residual, iterations, changed, moved)

    def _moved(self, A_dx: FloatArray) -> FloatArray:
        """A x after a step."""
        return self._images.advance(self._x, self._A_x + A_dx, 1.0, self._settings.product)

    def answer(self) -> Answer:
        without = (self._a * (self._A_x - self._b)).ravel()
        return Answer(self._problem.completed(self._x.ravel()), without, self._motion(self._alpha))

    def stop(self) -> Status | None:
        fallen = self._of_bodies(self._x, self._A_x, self._alpha)
        self._since += 1
        if fallen < self._settings.falls * self._fallen:
            self._fallen, self._since = fallen, 0
        stalled = self._since >= self._settings.patience or not math.isfinite(self._left)
        return Status.STAGNATED if stalled else None

    def _direction(
        self, derivative: ContactDerivative, x: FloatArray, A_x: FloatArray, alpha: FloatArray, residual: float
    ) -> Direction | None:
        """The step; None if its system is not solved."""
        settings, over = self._settings, self._over
        scale = self._problem.force_scale(x.ravel(), self._a * self._w(A_x, alpha).ravel())
        self._rows = (1.0 / np.where(scale > 1e-290, scale, 1.0))[:, None]
        self._inverse.move(derivative)
        self._bordered = ConstraintPreconditioner(self._inverse, self._constraints, 3, derivative.Q @ self._scaled.G)
        r3 = NO_MOTION if not len(self._e) else self._e - self._constraints.resultant(x)
        size = math.hypot(over.norm(self._rows * derivative.value), float(np.linalg.norm(r3)))
        share = min(settings.forcing, max(residual, settings.sharpest))
        enough = max(share * size, 0.1 * min(self._goal.residual, residual))
        if settings.settled < math.inf:  # forces that the residual hardly feels are a small part of it
            enough = settings.sharpest * size
        self._accuracy = min(max(enough / size, settings.product), settings.forcing) if size > 0.0 else settings.forcing
        dx, moved, dalpha, iterations = self._krylov.solve(-self._rows * derivative.value, np.zeros_like(x), enough, r3)
        if self._A is not None and (iterations >= self._updated_from or self._A.U.shape[1] == 0):
            self._A.update()
            self._inverse = ContactPreconditioner(self._scaled.comm, self._A)
        return Direction(dx, self._constraints.without(moved, -dalpha), dalpha, iterations)

    def _motion(self, alpha: FloatArray) -> FloatArray:
        """alpha (q,) in the user's units."""
        if self._problem.rigid is None:
            return NO_MOTION
        return self._a * (self._T.T @ alpha)

    def _result(self, status: Status | None) -> SolverResult:
        return result_of(self._problem, self._goal, self.answer(), None, status, self._history)


def _sprung(problem: FrictionProblem) -> MatrixFreeCompliance | None:
    """The compliance of a problem whose Newton systems may have springs."""
    free = problem.A.matrix_free
    return free if free is not None and free.stiffened and problem.rigid is None else None


class _SprungIteration(SemismoothIteration):
    """The iteration with displacements; K is that of `_sprung`."""

    _free: MatrixFreeCompliance
    _springs: SprungInverse
    _body: Elimination | None = None
    _du: FloatArray
    _weight = 0.0

    def run(self, starts: FloatArray, gradient: FloatArray | None = None) -> SolverResult:
        free = _sprung(self._problem)
        assert free is not None
        self._free, self._springs = free, SprungInverse.at_points(free, self._a, self._scaled.diagonal[:, 0])
        return super().run(starts, gradient)

    def _from(self, forces: FloatArray, gradient: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, _, alpha = super()._from(forces, gradient)
        return x, self._scaled.image(self._free.latest_product()), alpha

    def _sharp(self, residual: float, part: float = 1.0) -> float:
        sharp = super()._sharp(residual, part)
        if sharp > self._goal.residual >= residual > 0.0:
            self._weight *= min(sharp / residual, _HEAVIER)
        return sharp

    def _direction(
        self, derivative: ContactDerivative, x: FloatArray, A_x: FloatArray, alpha: FloatArray, residual: float
    ) -> Direction | None:
        settings, over, free, at = self._settings, self._over, self._free, derivative
        self._springs.move(at)
        if self._body is None or self._changed(at) > _CHANGED:
            self._body, self._status = free.elimination(self._springs.springs(at) / self._a), at.status
            self._weight = self._weight or _HEAVY * math.sqrt(over.sum(float(self._body.size)))
        scale = self._problem.force_scale(x.ravel(), self._a * self._w(A_x, alpha).ravel())
        scale = np.where(scale > 1e-290, scale, 1.0)
        rows = 1.0 / (scale[:, None] * np.maximum(np.abs(at.P).sum(axis=2), np.abs(at.Q).sum(axis=2)))
        weight = self._weight * over.min(1.0 / scale)
        f, g = free.left_over(x.ravel()), -at.value
        size = math.hypot(over.norm(rows * g), weight * over.norm(f))
        most, least = (part * of for part, of in zip(_SHARE, (settings.forcing, settings.sharpest), strict=True))
        enough = max(min(most, max(residual, least)) * size, 0.1 * min(self._goal.residual, residual))
        if settings.settled < math.inf:
            enough = settings.sharpest * size
        inverse = ConstraintPreconditioner(self._springs, self._constraints, 3)
        krylov = CoupledKrylov(
            self._body, self._a, self._constraints, lambda z: z, at.apply, inverse, rows, weight, most=_MOST
        )
        (self._du,), (dx,), _, (left,) = krylov.solve(f[None], g[None], NO_MOTION[None], np.array([enough]))
        if not left <= max(enough, most * size):
            return None
        return Direction(dx, -self._body.rows(self._du).reshape(-1, 3) / self._a, NO_MOTION, krylov.iterations)

    def _changed(self, at: ContactDerivative) -> float:
        """The part of the contact points that have another status than when springs were made."""
        changed, points = self._over.total(np.array([np.count_nonzero(at.status != self._status), len(at.status)]))
        return float(changed / max(points, 1.0))

    def _moved(self, A_dx: FloatArray) -> FloatArray:
        self._free.move(self._x.ravel(), self._du)
        return self._A_x + A_dx


def _without_zeros(diagonal: FloatArray) -> FloatArray:
    """A nodal diagonal (m, 3) with the other tangent's entry where a tangent has 0: where a point is held along it, as
    in a plane of symmetry, a tangential force there moves nothing, and any positive number preconditions its row."""
    tangents = diagonal[:, 1:]
    return np.column_stack([diagonal[:, 0], np.where(tangents > 0.0, tangents, tangents[:, ::-1])])
