"""Acceptance of a solver's iterate: the solver stops once its answer passes the certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from ..solvers.results import NotConverged, Status
from ..solvers.rigid_motions import NO_MOTION
from .certificate import Certificate, judge
from .equilibrium import running_away
from .posed_problem import PosedProblem
from .provenance import timed
from .settled import settled

CERTIFIED_FROM = 1e-8
"""Largest tolerance (the default) at which the answer must pass the certificate; above it only the residual counts."""

_FAR = 10.0
"""Displacements beyond this many times the extent of the bodies are worth a word where a solver fails."""


@dataclass(frozen=True)
class Judged:
    """The result of a solver's forces.

    Attributes:
        contact_force: The forces with exact zeros (`settled`), newtons, shape (3 m,).
        displacement: In metres, this rank's nodes, shape (k, 3).
        certificate: Their certificate.
    """

    contact_force: FloatArray
    displacement: FloatArray
    certificate: Certificate


class Acceptance:
    """Displacement and certificate of a solver's forces; the last ones are kept.

    Args:
        problem: The contact problem.
    """

    def __init__(self, problem: PosedProblem):
        self._problem = problem
        self._last: tuple[FloatArray, FloatArray, Judged] | None = None
        self._displaced: tuple[FloatArray, FloatArray] | None = None

    def __call__(self, x: FloatArray, alpha: FloatArray = NO_MOTION) -> bool:
        """Whether the forces x in newtons, shape (3 m,), pass, with the amounts alpha (q,) of free motions;
        collective."""
        return self.answer(x, alpha).certificate.passed

    def answer(self, x: FloatArray, alpha: FloatArray = NO_MOTION) -> Judged:
        """Displacement and certificate of the forces x in newtons, shape (3 m,), and amounts alpha (q,) of free
        motions; collective."""
        problem, over = self._problem, Reductions(self._problem.comm)
        last = self._last
        if last is None or not over.all(np.array_equal(last[0], x) and np.array_equal(last[1], alpha)):
            force, u = self._settled_by_product(x, alpha) or self._settled_by_displacement(x, alpha)
            with timed(problem.seconds, "certificate"):
                last = (x.copy(), alpha.copy(), Judged(force, u, judge(problem.evidence(force, u, problem.before))))
            self._last = last
        return last[2]

    def _settled_by_product(self, x: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """The forces with exact zeros, and their displacement; None if a product by A does not decide the zeros."""
        problem, over = self._problem, Reductions(self._problem.comm)
        with timed(problem.seconds, "displacement"):
            closed = problem.known_closure(x, alpha)
            if closed is None:
                return None
            force = settled(problem, x, closed)
            u = problem.moved(problem.displacement(force), alpha)
            same = np.array_equal(settled(problem, x, problem.closure(u)), force)
        return (force, u) if over.all(same) else None

    def _settled_by_displacement(self, x: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The forces with exact zeros, and their displacement."""
        problem, over = self._problem, Reductions(self._problem.comm)
        u = problem.moved(self._displacement(x), alpha)
        with timed(problem.seconds, "displacement"):
            force = settled(problem, x, problem.closure(u))
            if not over.all(np.array_equal(force, x)):
                u = problem.moved(problem.displacement(force), alpha)
        return force, u

    def gradient(self, x: FloatArray) -> FloatArray:
        """A x - b in metres of the forces x in newtons, shapes (3 m,): remaining gap and slip, before free motions;
        collective."""
        remaining = -self._problem.closure(self._displacement(x))
        remaining[:, 0] += self._problem.surface.gap
        return remaining.ravel()

    def _displacement(self, x: FloatArray) -> FloatArray:
        """Displacement under the forces x in newtons, shape (3 m,), before free motions, the last one kept; metres,
        shape (k, 3)."""
        over = Reductions(self._problem.comm)
        if self._displaced is None or not over.all(np.array_equal(self._displaced[0], x)):
            with timed(self._problem.seconds, "displacement"):
                self._displaced = x.copy(), self._problem.displacement(x)
        return self._displaced[1]

    def explained(self, failure: NotConverged, tolerance: float) -> NotConverged:
        """The failure; if only the certificate does not pass, with its conditions and possible remedies."""
        problem, result = self._problem, failure.result
        if result.status is Status.INTERRUPTED:
            return failure
        if not result.residual <= tolerance:
            texts = [text for text in (running_away(problem, result), str(failure), far_moved(problem)) if text]
            return NotConverged("; ".join(texts), result) if len(texts) > 1 else failure
        certificate = self.answer(result.x, result.rigid).certificate
        remedies = ["a check of the units of lengths, forces and stiffnesses"]
        if problem.elasticity.ground is not None:
            remedies.insert(0, "a clamp or stiffer springs, to prevent the rigid motion")
        if problem.stiffness.solver.tolerance > 0.0:
            remedies.insert(0, 'K factorised (linear_solver = "direct")')
        said = f"{failure}; failing conditions: {what_fails(certificate)}; what may help: {', or '.join(remedies)}"
        return NotConverged(said, result)


def far_moved(problem: PosedProblem) -> str:
    """That what is prescribed is much larger than the bodies, as from another unit, in words; empty if it is not;
    collective."""
    over, x = Reductions(problem.comm), problem.elasticity.x
    size = float(np.linalg.norm([over.max(axis) + over.max(-axis) for axis in x.T]))
    prescribed = over.max(np.linalg.norm(problem.loading.prescribed, axis=1))
    given = {"prescribed displacements reach": prescribed}
    given["foundations move by"] = float(np.max(np.linalg.norm(problem.motions, axis=1)))
    given["initial gaps reach"] = over.max(np.abs(problem.surface.gap))
    said = [f"{what} {value:g} m" for what, value in given.items() if value > _FAR * size]
    return (
        f"{' and '.join(said)}, and the bodies together are {size:.3g} m long: check values and units" if said else ""
    )


def left_open(certificate: Certificate, tolerance: float) -> str:
    """Conditions that a tolerance above CERTIFIED_FROM leaves unsatisfied, as a message; empty if there are none."""
    if certificate.passed or tolerance <= CERTIFIED_FROM:
        return ""
    return (
        f"the tolerance {tolerance:g} is reached, but these conditions fail: {what_fails(certificate)}; with "
        f"{CERTIFIED_FROM:g}, the default, or less a run continues until the certificate passes"
    )


def what_fails(certificate: Certificate) -> str:
    """The conditions of a certificate that fail, as text."""
    return ", ".join(f"{c.name} {c.value:.1e} (limit {c.limit:.0e})" for c in certificate.checks if not c.passed)
