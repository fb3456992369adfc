"""The stopping criterion of a solve: the solver stops once its answer passes the certificate.

An interior-point method leaves forces of rounding size at open nodes, a projection method slightly larger ones.  Where
the law requires it they are set to exactly zero before displacement and certificate are computed, so that the certified
answer is the written one.  The change is below the requested residual:

- The natural residual |x - P(x - (A x - b)/a)| is the force itself where P sets it to zero.
- Where neither force nor gap is significant, P does not decide: a force up to `OPEN_BELOW` of the largest on its body
  is zero.
- Where the slip bound is zero (Coulomb friction at open nodes, or F = 0), a small friction force is zero.
- Where a support prescribes the displacement in a tangential direction, and there is no slip in it, the law leaves
  friction in that direction undetermined, and it acts on the support alone: it is zero.
- A node that sticks and is held obliquely to its normal is wedged between support and foundation: the law leaves open
  how much each of them carries.  Friction in that plane is zero, if the friction that remains is within its bound.

Where supports prescribe all of the slip, friction is set by the law from the final normal force.  Larger forces are
kept as faults for the certificate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ..arrays import FloatArray
from ..fem.contact import row_products
from ..linalg.reductions import Reductions
from ..solvers.results import NotConverged, SolverResult, Status
from ..solvers.rigid_motions import NO_MOTION
from ..units import amount
from .certificate import LIMIT, RESOLUTION, Certificate, Evidence, judge
from .certificate_scales import place_of_largest
from .discrete_problem import DiscreteProblem
from .equilibrium import running_away
from .nodal_answer import OPEN_BELOW
from .provenance import timed
from .state import State

ROUNDING: Final = 1e-13
"""Relative size of rounding errors of slips and of projections on free directions."""

SMALL: Final = 1e-6
"""Fraction of the norm of all contact forces on a body: the largest residual that can be requested."""


def zero_open_forces(problem: DiscreteProblem, x: FloatArray, closed: FloatArray) -> FloatArray:
    """Contact forces x of a solver in newtons, shape (3 m,), with exact zeros, where `closed` (m, 3) is
    `DiscreteProblem.relative_displacement` of the displacement under them; collective."""
    force, scales = x.reshape(-1, 3).copy(), problem.friction_problem.scales
    normal, gap = force[:, 0], problem.surface.gap - closed[:, 0]
    loads = problem.b if problem.rigid is None else np.column_stack([gap, closed[:, 1:]]).ravel()
    largest = scales.of_bodies(x, loads)[scales.body]
    small = SMALL * np.maximum(scales.norms(force)[scales.body], largest)
    grazing = np.abs(normal) <= OPEN_BELOW * largest
    opened = (np.abs(normal) <= small) & (scales.compliance[:, 0] * normal <= gap)
    normal[grazing | opened] = 0.0
    frictionless = (problem.slip_bound(force.ravel()) == 0.0) & (np.hypot(force[:, 1], force[:, 2]) <= small)
    force[frictionless, 1:] = 0.0
    if problem.surface.slip_prescribed:
        products = row_products(problem.surface.free_B, problem.surface.points)
        _set_friction_on_supports(problem, force, closed[:, 1:], products[:, 1:, 1:])
        _unload_wedged(problem, force, products)
    return force.ravel()


def _set_friction_on_supports(problem: DiscreteProblem, force: FloatArray, slip: FloatArray, free: FloatArray) -> None:
    """Set friction (m, 2) at nodes whose slip is prescribed, or has a prescribed component of 0; slips that are
    rounding errors of places are 0; collective.

    Friction v, along t1 and t2, acts on the support alone if P (t1, t2)^T v = 0, P the projection on the free
    directions of the node.  `free` (m, 2, 2) are the `row_products` of t1 and t2.
    """
    places = ROUNDING * np.abs(problem.surface.x).max(axis=1, initial=0.0)
    slip = np.where(np.abs(slip) <= places[:, None], 0.0, slip)
    v = directions_on_supports(free)
    still = np.abs(np.einsum("ki,ki->k", v, slip)) <= ROUNDING * np.abs(slip).max(axis=1, initial=0.0)
    force[:, 1:] -= np.where(still, np.einsum("ki,ki->k", v, force[:, 1:]), 0.0)[:, None] * v
    known = np.all(free == 0.0, axis=(1, 2))
    force[known, 1:] = problem.law.at(known).against(slip[known], force[known, 0])


def directions_on_supports(free: FloatArray) -> FloatArray:
    """The unit vectors along t1 and t2 in which friction acts on supports alone, from the `row_products` of t1 and t2
    (m, 2, 2); 0 where there is none; shape (m, 2)."""
    sizes, directions = np.linalg.eigh(free)
    return directions[:, :, 0] * (sizes[:, 0] <= ROUNDING * sizes[:, 1])[:, None]


def _unload_wedged(problem: DiscreteProblem, force: FloatArray, gram: FloatArray) -> None:
    """Change forces (m, 3) of sticking nodes that are held obliquely, by forces v, along n, t1, t2, on supports alone.

    These have P (n, t1, t2)^T v = 0, P the projection on the free directions of the node.  `gram` (m, 3, 3), the
    `row_products`, is changed.
    """
    diagonal = np.einsum("kii->ki", gram)
    diagonal[diagonal == 0.0] = 1.0  # friction along such rows is determined by itself
    sizes, directions = np.linalg.eigh(gram)
    v = directions[:, :, 0]
    across = np.sum(v[:, 1:] ** 2, axis=1)
    wedged = (sizes[:, 0] <= ROUNDING) & (sizes[:, 1] > ROUNDING) & (across > ROUNDING) & (np.abs(v[:, 0]) > ROUNDING)
    along = np.einsum("ki,ki->k", v[:, 1:], force[:, 1:]) / np.where(wedged, across, 1.0)
    moved = force - along[:, None] * v
    sticks = _friction(force) < (1.0 - SMALL) * problem.slip_bound(force.ravel())
    within = (moved[:, 0] > 0.0) & (_friction(moved) < (1.0 - SMALL) * problem.slip_bound(moved.ravel()))
    change = wedged & sticks & within
    force[change] = moved[change]


def _friction(force: FloatArray) -> FloatArray:
    return np.hypot(force[:, 1], force[:, 2])


CERTIFIED_FROM: Final = 1e-8
"""Largest tolerance (the default) at which the answer must pass the certificate; above it only the residual counts."""

_NEAR: Final = 1e-2
"""Residual up to which the rounding errors of an iterate are those of an answer."""

_FAR: Final = 10.0
"""Displacements beyond this many times the extent of the bodies are worth a word where a solver fails."""


@dataclass(frozen=True, eq=False)
class CertifiedAnswer:
    """The result of a solver's forces.

    Attributes:
        contact_force: The forces with exact zeros (`zero_open_forces`), newtons, shape (3 m,).
        displacement: In metres, this rank's nodes, shape (k, 3).
        evidence, certificate: By which they are judged, and the judgement.
    """

    contact_force: FloatArray
    displacement: FloatArray
    evidence: Evidence
    certificate: Certificate


class StoppingCriterion:
    """Displacement and certificate of a solver's forces x (3 m,) and amounts alpha (q,) of free motions; the last ones
    are kept."""

    def __init__(self, problem: DiscreteProblem):
        self._problem = problem
        self._last: tuple[FloatArray, FloatArray, CertifiedAnswer] | None = None
        self._displaced: tuple[FloatArray, FloatArray] | None = None

    def __call__(self, x: FloatArray, alpha: FloatArray = NO_MOTION) -> bool:
        return self.answer(x, alpha).certificate.passed

    def answer(self, x: FloatArray, alpha: FloatArray = NO_MOTION) -> CertifiedAnswer:
        problem, over = self._problem, Reductions(self._problem.comm)
        last = self._last
        if last is None or not over.all(np.array_equal(last[0], x) and np.array_equal(last[1], alpha)):
            force, u = self.with_zeros(x, alpha)
            with timed(problem.seconds, "certificate"):
                evidence = problem.evidence(force, u, problem.before, alpha)
                last = x.copy(), alpha.copy(), CertifiedAnswer(force, u, evidence, judge(evidence))
            self._last = last
        return last[2]

    def with_zeros(self, x: FloatArray, alpha: FloatArray = NO_MOTION) -> tuple[FloatArray, FloatArray]:
        """The forces with exact zeros, newtons, shape (3 m,), and their displacement, metres, shape (k, 3);
        collective."""
        return self._zeros_by_product(x, alpha) or self._zeros_by_displacement(x, alpha)

    def _zeros_by_product(self, x: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """The forces with exact zeros, and their displacement; None if a product by A does not decide the zeros."""
        problem, over = self._problem, Reductions(self._problem.comm)
        with timed(problem.seconds, "displacement"):
            closed = problem.linear.known_relative_displacement(x, alpha)
            if closed is None:
                return None
            force = zero_open_forces(problem, x, closed)
            u = problem.moved(problem.displacement(force), alpha)
            same = np.array_equal(zero_open_forces(problem, x, problem.relative_displacement(u, alpha)), force)
        return (force, u) if over.all(same) else None

    def _zeros_by_displacement(self, x: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
        problem, over = self._problem, Reductions(self._problem.comm)
        u = problem.moved(self._displacement(x), alpha)
        with timed(problem.seconds, "displacement"):
            force = zero_open_forces(problem, x, problem.relative_displacement(u, alpha))
            if not over.all(np.array_equal(force, x)):
                u = problem.moved(problem.displacement(force), alpha)
        return force, u

    def by_contacts(self, x: FloatArray, alpha: FloatArray = NO_MOTION) -> bool:
        """Whether the residual of every contact, by its own force, is within the limit of the certificate, or else the
        certificate passes, as where all forces are rounding errors; collective.

        For linear problems on the way to an answer, of which the next place is certified.
        """
        problem, gradient = self._problem.friction_problem, self.gradient(x)
        if problem.rigid is not None:
            gradient = gradient - problem.rigid.displacement(alpha)
        within = Reductions(self._problem.comm).max(problem.residuals(x, gradient)) <= LIMIT
        return within or self(x, alpha)

    def gradient(self, x: FloatArray) -> FloatArray:
        """A x - b in metres of the forces x in newtons, shapes (3 m,): remaining gap and slip, before free motions;
        collective."""
        remaining = -self._problem.relative_displacement(self._displacement(x))
        remaining[:, 0] += self._problem.surface.gap
        return remaining.ravel()

    def _displacement(self, x: FloatArray) -> FloatArray:
        """Displacement under the forces x before free motions, the last one kept; metres, shape (k, 3)."""
        over = Reductions(self._problem.comm)
        if self._displaced is None or not over.all(np.array_equal(self._displaced[0], x)):
            with timed(self._problem.seconds, "displacement"):
                self._displaced = x.copy(), self._problem.linear.displacement(x)
        return self._displaced[1]

    def explained(self, failure: NotConverged, tolerance: float) -> NotConverged:
        """The failure; if only the certificate does not pass, with its conditions and possible remedies."""
        problem, result = self._problem, failure.result
        if result.status is Status.INTERRUPTED:
            return failure
        if not result.residual <= tolerance:
            whole = (
                running_away(problem, result),
                str(failure),
                _worst(problem, result),
                self._unresolved(result),
                _shared(problem),
                implausible_sizes(problem),
            )
            texts = [text for text in whole if text]
            return NotConverged("; ".join(texts), result) if len(texts) > 1 else failure
        if away := running_away(problem, result):
            return NotConverged(f"{away}; {failure}", result)
        certificate = self.answer(result.x, result.rigid).certificate
        remedies = ["a check of the units of lengths, forces and stiffnesses"]
        if problem.elasticity.ground is not None:
            remedies.insert(0, "a clamp or stiffer springs, to prevent the rigid motion")
        if problem.linear.stiffness.solver.tolerance > 0.0:
            remedies.insert(0, 'K factorised (linear_solver = "direct")')
        said = (
            f"{failure}; failing conditions: {failing_conditions(certificate)}; what may help: {', or '.join(remedies)}"
        )
        return NotConverged(said, result)

    def _unresolved(self, result: SolverResult) -> str:
        """That rounding errors, as of a thin sheet that bends far more easily than its cells are compressed, leave
        forces near an answer undetermined, in words; else empty; collective."""
        if not result.residual <= _NEAR:
            return ""
        check = self.answer(result.x, result.rigid).certificate[RESOLUTION]
        soft = "bodies move far more easily than their cells are deformed, as thin sheets do"
        return "" if check.passed else f"{soft}: {check.meaning}"


def _worst(problem: DiscreteProblem, result: SolverResult) -> str:
    """Where the contact point with the largest residual is, and what rounding leaves, in words; collective."""
    posed, over, surface = problem.friction_problem, Reductions(problem.comm), problem.surface
    if not over.all(len(result.x) == len(problem.b) and bool(np.all(np.isfinite(result.gradient)))):
        return ""
    own = posed.residuals(result.x, result.gradient)
    worst = over.max(np.append(own, -np.inf))
    if not 0.0 < worst < np.inf:
        return ""
    where = place_of_largest(own, surface.x, surface.part, surface.faces, over)
    left = posed.unresolved(result.x, result.gradient)
    unresolved = f"; rounding errors of displacements alone leave {left:.1e} of a force" if left > 0.1 * worst else ""
    return f"worst contact point {where}: its residual is {worst:.1e} of its force{unresolved}"


def _shared(problem: DiscreteProblem) -> str:
    """That rough contact goes across a tie, where nearly matching meshes leave shares of both sides undetermined, in
    words; else empty; collective."""
    over, points = Reductions(problem.comm), problem.surface.nodes
    for tie in problem.elasticity.constraints.ties if over.any(bool(np.any(problem.law.sloped))) else ():
        if tie.of_faces and over.any(bool(np.any(np.isin(tie.nodes, points)))):
            return (
                f"contact goes across the {tie.kind} of {tie.face!r} to {tie.against!r}, whose sides share forces: let "
                "their meshes match to rounding there, or differ by a fifth of a cell"
            )
    return ""


def implausible_sizes(problem: DiscreteProblem) -> str:
    """That what is prescribed is much larger than the bodies, as from another unit, in words; empty if it is not;
    collective."""
    over, x = Reductions(problem.comm), problem.elasticity.x
    size = float(np.linalg.norm(over.extent(x)))
    prescribed = over.max(np.linalg.norm(problem.loading.prescribed, axis=1))
    given = {"prescribed displacements reach": prescribed}
    given["foundations move by"] = float(np.max(np.linalg.norm(problem.motions, axis=1)))
    given["initial gaps reach"] = over.max(np.abs(problem.surface.gap))
    said = [f"{what} {amount(value)}" for what, value in given.items() if value > _FAR * size]
    return (
        f"{' and '.join(said)}, and the bodies together are {amount(size)} long: check values and units" if said else ""
    )


def failing_at_tolerance(certificate: Certificate, tolerance: float) -> str:
    """Conditions that a tolerance above CERTIFIED_FROM leaves unsatisfied, as a message; empty if there are none."""
    if certificate.passed or tolerance <= CERTIFIED_FROM:
        return ""
    return (
        f"the tolerance {tolerance:g} is reached, but these conditions fail: {failing_conditions(certificate)}; with "
        f"{CERTIFIED_FROM:g}, the default, or less a run continues until the certificate passes"
    )


def failing_conditions(certificate: Certificate) -> str:
    """The conditions of a certificate that fail, as text."""
    return ", ".join(f"{c.name} {c.value:.1e} (limit {c.limit:.0e})" for c in certificate.checks if not c.passed)


def certify(problem: DiscreteProblem, x: FloatArray, u: FloatArray, before: State | None = None) -> Certificate:
    """Check an answer; collective.

    Args:
        problem: The contact problem.
        x: Contact forces in newtons, shape (3 m,), point by point (n, t1, t2).
        u: Displacement in metres, this rank's nodes, shape (k, 3).
        before: State after the load step before, such as a `State`, from which slip is measured, moved with the
            foundation since; by default from the problem's `slip_origin`.
    """
    return judge(problem.evidence(x, u, before))
