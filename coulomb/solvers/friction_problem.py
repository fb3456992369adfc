"""Contact with friction on the contact nodes: A, b and the law."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final, NamedTuple, Protocol, cast

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.compliance import Compliance
from ..linalg.reductions import Reductions
from .laws import FrictionLaw
from .results import Accept, Goal, NotConverged, ProgressCallback, SolverResult, Status
from .rigid_motions import MotionBasis, RigidMotions
from .scales import ContactScales, relative
from .settings import Settings, within

_FAR_SHORTER: Final = 1e-3
"""Length of the shortest rigid motion over that of an iterate's from which it is preferred."""

_CARRIED_FROM: Final = 1e-6
"""Residual from which on errors are small enough to ask what they do to each other."""

_UNLOADED: Final = 1e-2
"""Part of the largest sqrt(a) f of the bodies: a body that touches without load does not hold up the others."""

_EPSILON: Final = 2.0**-52

_RESOLVED: Final = 1e-12
"""Rounding errors of forces below this, the least tolerance of a case, are none."""

_ROUNDED: Final = 0.5 / math.sqrt(3.0)
"""Root mean square of rounding errors, over the distance of numbers beside each other."""

_OF_CARRIED: Final = 1e-2
"""Part of these errors that counts: a residual of 1e-8 allows 1e-6 of the force of a contact."""

_UNDILUTED: Final = 10.0
"""x^T A x over a |x|^2, times this, from which on forces count as felt by A in full."""


@dataclass(frozen=True, eq=False)
class FrictionProblem:
    """Contact forces x with x_n >= lower and |x_t| <= r(x_n), and with w = A x - b at every contact node

        w_n >= 0,  (x_n - lower) w_n = 0;    w_t = -s x_t with s >= 0,  s = 0 where |x_t| < r(x_n).

    With rigid motions w = A x - b - G^T alpha, and G x = e (rigid_motions.py).

    Where the law has no slope (Tresca's) this is the minimum of 1/2 x^T A x - b^T x under the two constraints, a convex
    quadratic programme.

    Where the displacement along a tangent is prescribed, the slip along it is known, no contact force changes it, and
    its row of A is zero.  Where all of the tangent plane is prescribed, friction follows from the slip and from x_n
    (`completed`): the solvers treat such a node as one without friction.

    Attributes:
        A: Compliance, in metres per newton, symmetric positive semidefinite; its diagonal is positive, except in zero
            rows along tangents.
        b: Free gap closure in metres, this rank's part, shape (3 m,), node by node (n, t1, t2).
        law: Bound of the friction force of every node.
        lower: Lower bound of the normal forces in newtons, a number or shape (m,); 0 for plain contact.
        accept: The certificate that an answer must pass as well; None if only the residual decides.  With rigid motions
            it is called with the forces and alpha.
        balanced: A x - b in metres, shape (3 m,), of forces x in newtons, from the displacement under loads and contact
            forces together, with more correct digits where they nearly cancel, as on soft springs; None: A x less b.
        rigid: Motions of bodies that contact alone holds, with the loads along them; None if supports hold all.
        elastic: A is the compliance of elastic bodies, of full rank: forces are felt (`dilution`).
        body, group: Numbers of the body of every contact, and of the bodies that contacts join, from 0, the same on all
            ranks, shape (m,); None for one.
        together: Whether the contacts of a body are judged together (`residual_of_bodies`), as is enough for a problem
            that is a step towards another one.

    Raises:
        ValueError: On every rank, if shapes do not fit, a value is not finite, or a cohesion or coefficient of friction
            is negative on any rank, or a lower bound where the law has a slope.
    """

    A: Compliance
    b: FloatArray
    law: FrictionLaw
    lower: float | FloatArray = 0.0
    accept: Accept | None = None
    balanced: Callable[[FloatArray], FloatArray] | None = None
    rigid: RigidMotions | None = None
    elastic: bool = False
    body: npt.NDArray[np.int64] | None = None
    group: npt.NDArray[np.int64] | None = None
    together: bool = False

    @classmethod
    def tresca(
        cls,
        A: Compliance,
        b: FloatArray,
        slip_bound: FloatArray,
        lower: float | FloatArray = 0.0,
        accept: Accept | None = None,
    ) -> FrictionProblem:
        """With given slip bounds g >= 0 in newtons, shape (m,)."""
        over = Reductions(A.comm)
        shape, must = slip_bound.shape, f"slip_bound must have shape ({A.nodes},), one per contact node"
        over.require(shape == (A.nodes,), f"{must}, but has {shape}")
        over.require(np.all(np.isfinite(slip_bound)), "slip_bound has entries that are not finite")
        over.require(np.all(slip_bound >= 0.0), "slip_bound has negative entries; a friction disc has a radius >= 0")
        return cls(A, b, FrictionLaw.tresca(slip_bound), lower, accept)

    @classmethod
    def coulomb(
        cls, A: Compliance, b: FloatArray, friction: FloatArray, accept: Accept | None = None
    ) -> FrictionProblem:
        """With coefficients of friction F >= 0, shape (m,), and no cohesion."""
        return cls(A, b, FrictionLaw.coulomb(friction), accept=accept)

    def __post_init__(self) -> None:
        m, over = self.A.nodes, self.reductions
        shape, lower = self.b.shape, np.asarray(self.lower)
        must = f"b must have shape ({3 * m},), three entries per contact node"
        over.require(shape == (3 * m,), f"{must}, but has {shape}")
        self.law.validate(m, over)
        over.require(lower.shape in ((), (m,)), f"lower must be a number or have shape ({m},), but has {lower.shape}")
        for name, values in (("b", self.b), ("lower", lower)):
            over.require(np.all(np.isfinite(values)), f"{name} has entries that are not finite")
        must = "lower must be >= 0 where friction > 0: the bound of friction grows from pressure 0 on"
        over.require(np.all(~self.law.sloped | (lower >= 0.0)), must)
        if self.rigid is not None:
            self.rigid.validate(m, over)
            moved = np.any(self.rigid.G != 0.0, axis=0) & (self.A.diagonal() == 0.0)
            over.require(not np.any(moved), "rigid: G must be zero where a row of A is zero: the slip there is known")

    @cached_property
    def reductions(self) -> Reductions:
        return Reductions(self.A.comm)

    @cached_property
    def mean_diagonal(self) -> float:
        """Mean of diag(A) without its zeros in metres per newton: the scale that turns a gap into a force."""
        d = self.A.diagonal()
        return self.reductions.sum(d) / max(self.reductions.sum(float(np.count_nonzero(d))), 1.0)

    @cached_property
    def known_slip(self) -> npt.NDArray[np.bool_]:
        """Nodes whose slip no contact force changes, shape (m,): both tangential rows of A are zero."""
        return np.all(self.A.diagonal().reshape(-1, 3)[:, 1:] == 0.0, axis=1)

    @cached_property
    def frictional(self) -> npt.NDArray[np.bool_]:
        """Nodes whose friction is to be found: not zero at every pressure, nor known from the slip; shape (m,)."""
        return self.law.frictional & ~self.known_slip

    @cached_property
    def unknown(self) -> npt.NDArray[np.bool_]:
        """Forces that are to be found, shape (m, 3): pressures, and friction of `frictional` nodes."""
        return np.column_stack([np.ones(self.A.nodes, dtype=bool), self.frictional, self.frictional])

    def completed(self, x: FloatArray) -> FloatArray:
        """Forces x (3 m,) in newtons with the friction of nodes of known slip: at its bound r(x_n), against the slip;
        0 where there is no slip, where the law leaves it undetermined."""
        known, forces = self.known_slip, x.reshape(-1, 3).copy()
        law, slip = self.law.at(known), self.b.reshape(-1, 3)[known, 1:]
        forces[known, 1:] = law.against(slip, forces[known, 0])
        return forces.ravel()

    @cached_property
    def sloped(self) -> bool:
        """Whether friction grows with pressure at any node of any rank: then the problem is not a minimisation."""
        return self.reductions.any(bool(np.any(self.law.sloped)))

    def slip_bound(self, x: FloatArray) -> FloatArray:
        """r(x_n) of forces x (3 m,) in newtons, shape (m,)."""
        return self.law.radius(x[0::3])

    def with_slip_bound(self, slip_bound: FloatArray, together: bool = False) -> FrictionProblem:
        """The Tresca problem with these slip bounds in newtons, shape (m,), without certificate."""
        law = FrictionLaw.tresca(slip_bound)
        return replace(self, law=law, accept=None, balanced=None, together=together)

    def gradient(self, x: FloatArray, alpha: FloatArray | None = None) -> FloatArray:
        """w = A x - b - G^T alpha in metres, shape (3 m,); one product by A.

        Args:
            x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
            alpha: Rigid motions, shape (q,); by default those of `rigid_motion`.
        """
        w = self.without_motion(x)
        if self.rigid is None:
            return w
        return w - self.rigid.displacement(self.rigid_motion(x, w) if alpha is None else alpha)

    def without_motion(self, x: FloatArray) -> FloatArray:
        """A x - b in metres, shape (3 m,); one product by A."""
        y = np.empty_like(x)
        self.A.mult(x, y)
        return y - self.b

    def rigid_motion(self, x: FloatArray, without: FloatArray) -> FloatArray:
        """alpha (q,) that closes the contact under the forces x best, the shortest of them; empty without motions.

        It minimises the sum of x_n w_n^2 + w_t^T r (1 - y y^T) w_t, y = x_t/r: the gaps where there is pressure, and
        the slips below the bound of friction or across the friction force.  All of these are zero at a solution.

        Args:
            x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
            without: A x - b in metres, shape (3 m,).
        """
        if self.rigid is None:
            return np.empty(0)
        roots = self._closing(self.project(x).reshape(-1, 3))
        nodal = self.rigid.G.T.reshape(len(roots), 3, self.rigid.count)
        G = np.einsum("iab,ibq->qia", roots, nodal).reshape(self.rigid.count, len(self.b))
        basis = MotionBasis(G, self.reductions)
        w = np.einsum("iab,ib->ia", roots, without.reshape(-1, 3)).ravel()
        return basis.T.T @ (basis.T @ self.reductions.total(G @ w))

    def shortest_motion(self, x: FloatArray, without: FloatArray, alpha: FloatArray) -> FloatArray:
        """`rigid_motion`, if it is far shorter than alpha (q,) and the residual with it no larger; else alpha.

        Where nothing resists a motion, as the spin of a ball that touches at one point, alpha is what rounding errors
        made of it on the way.
        """
        shortest = self.rigid_motion(x, without)
        if self.rigid is None or not np.linalg.norm(shortest) < _FAR_SHORTER * np.linalg.norm(alpha):
            return alpha
        residuals = [self.residual(x, without - self.rigid.displacement(motion)) for motion in (shortest, alpha)]
        return shortest if residuals[0] <= residuals[1] else alpha

    def _closing(self, x: FloatArray) -> FloatArray:
        """Roots of the weights of `rigid_motion` at feasible forces x (m, 3), shape (m, 3, 3)."""
        r = np.where(self.frictional, self.slip_bound(x.ravel()), 0.0)
        y = x[:, 1:] / np.where(r > 0.0, r, 1.0)[:, None] * (r > 0.0)[:, None]
        left = np.sqrt(np.maximum(1.0 - np.sum(y**2, axis=1), 0.0))  # root of 1 - y y^T: 1 - y y^T / (1 + left)
        roots = np.zeros((len(x), 3, 3))
        roots[:, 0, 0] = np.sqrt(x[:, 0] - np.minimum(self.lower, x[:, 0]))
        disc = np.eye(2) - y[:, :, None] * y[:, None, :] / (1.0 + left)[:, None, None]
        roots[:, 1:, 1:] = np.sqrt(r)[:, None, None] * disc
        return roots

    @cached_property
    def motion_basis(self) -> MotionBasis:
        """The rigid motions that contact resists, by pressure or by friction, and those that it does not.

        Raises:
            ValueError: If there are no rigid motions.
        """
        if self.rigid is None:
            raise ValueError("the problem has no rigid motions")
        return MotionBasis(self.rigid.G * self.unknown.ravel(), self.reductions)

    def imbalance(self, x: FloatArray, scale: FloatArray) -> float:
        """How far forces x (3 m,) are from equilibrium along the rigid motions; 0 without motions; collective.

        The largest part of the smallest change of x that restores it, over the `force_scale` (m,).  Along motions
        without resistance no change does: there the resultant itself counts, as a nodal force, over |x|.
        """
        if self.rigid is None:
            return 0.0
        basis, over, lacking = self.motion_basis, self.reductions, self.rigid.out_of_balance(x, self.reductions)
        change = (basis.T @ lacking) @ basis.rows
        resisted = over.max(np.append(relative(change.reshape(-1, 3), scale), 0.0))
        free = float(np.linalg.norm(basis.free.T @ lacking)) / basis.size
        if free == 0.0:
            return resisted
        size = over.norm(x)
        return max(resisted, free / size) if size > 0.0 else math.inf

    def project(self, x: FloatArray) -> FloatArray:
        """The point nearest to x (3 m,) with x_n >= lower and the law's bound at x_n; feasible in a Tresca problem."""
        return self.law.project(x, x[0::3], self.lower)

    def residual(self, x: FloatArray, gradient: FloatArray | None = None) -> float:
        """Largest natural residual of a contact, each by its own compliance and force; 0 exactly at a solution.

        With rigid motions, the larger of it and the `imbalance`; where errors are small and compliances differ, of it
        and what these errors do to each other (`_carried`).  Unless A is that of elastic bodies, the residual of all
        contacts by one compliance, relative to |x|, counts as well; it grows by the `dilution`: where A has no full
        rank, forces may contain large parts that move nothing, beside which any error is small.

        Args:
            x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
            gradient: w in metres, shape (3 m,), if it is known; else it is computed with one product.
        """
        if gradient is None:
            gradient = self.gradient(x)
        left, scale = self.left_over(x, gradient), self.force_scale(x, gradient)
        if self.together:
            worst = self.residual_of_bodies(x, gradient)
        else:
            worst = self.reductions.max(np.append(relative(left, scale), 0.0))
            if self.rigid is None or worst <= _CARRIED_FROM:  # with motions for a product
                worst = max(worst, self.unresolved(x, gradient))
        if self.rigid is not None:
            worst = max(worst, self.imbalance(x, scale))
        if 0.0 < worst <= _CARRIED_FROM and self.scales.mixed and not self.together:
            worst = max(worst, self._carried(left, scale))
        if self.elastic or not worst < math.inf:
            return worst
        natural = self.law.natural_residual(x, gradient, self.mean_diagonal, self.reductions, self.lower)
        return max(worst, natural * self.dilution(x, gradient)) if 0.0 < natural < math.inf else max(worst, natural)

    def residuals(self, x: FloatArray, gradient: FloatArray) -> FloatArray:
        """Natural residual of every contact over its `force_scale`, shape (m,)."""
        return relative(self.left_over(x, gradient), self.force_scale(x, gradient))

    def unresolved(self, x: FloatArray, gradient: FloatArray) -> float:
        """Largest part of the force of a closed contact that rounding errors of A x and b change; collective.

        Where these nearly cancel at a contact that is far stiffer than what moves it, no arithmetic of double precision
        finds its force.  Of bodies that contact alone holds the motions cancel, as those of two blocks on a pad.
        """
        w, loads = gradient.reshape(-1, 3), self.b.reshape(-1, 3)
        felt = np.hypot(w + loads, loads)
        if self.rigid is not None:
            G, alpha = self.rigid.G, self.motion_basis.amounts(self.without_motion(x) - gradient)
            felt = np.where(np.any(G != 0.0, axis=0), np.sqrt(alpha**2 @ G**2), felt.ravel()).reshape(-1, 3)
        closed = x[0::3] > np.maximum(self.lower, w[:, 0] / self.scales.compliance[:, 0])
        rounding = np.where(closed[:, None] & self.unknown, _ROUNDED * _EPSILON * felt / self.scales.compliance, 0.0)
        left = self.reductions.max(np.append(relative(rounding, self.force_scale(x, gradient)), 0.0))
        return left if left > _RESOLVED else 0.0

    @cached_property
    def scales(self) -> ContactScales:
        return ContactScales.of(self.A.diagonal(), self.body, self.reductions, self.group)

    def left_over(self, x: FloatArray, gradient: FloatArray) -> FloatArray:
        """x - P(x - w/a) with the compliances of every contact, newtons, shape (m, 3); see `residual`."""
        return self.law.left_over(x, gradient / self.scales.compliance.ravel(), self.lower).reshape(-1, 3)

    def force_scale(self, x: FloatArray, gradient: FloatArray) -> FloatArray:
        """Force by which every contact is judged, newtons, shape (m,); see `residual`."""
        return self.scales.of_contacts(x, self.b if self.rigid is None else gradient)

    def residual_of_bodies(self, x: FloatArray, gradient: FloatArray) -> float:
        """Largest |x - P(x - w/a)| of all contacts of a body over its |x|, or its `of_bodies`; inf without either."""
        scales, loads = self.scales, self.b if self.rigid is None else gradient
        left, size = scales.norms(self.left_over(x, gradient)), scales.norms(x.reshape(-1, 3))
        size = scales.no_less(np.maximum(size, scales.of_bodies(x, loads)), _UNLOADED)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return float(np.max(np.where(left == 0.0, 0.0, left / size)))

    def _carried(self, left: FloatArray, scale: FloatArray) -> float:
        """A part of the largest relative error that errors `left` (m, 3) in newtons cause at any contact; a product."""
        moved = np.empty(left.size)
        self.A.mult(left.ravel(), moved)
        caused = self.without_motions(moved).reshape(-1, 3) / self.scales.compliance
        return _OF_CARRIED * self.reductions.max(relative(caused, scale))

    def without_motions(self, w: FloatArray) -> FloatArray:
        """Displacements or forces w (3 m,) less their part that is a rigid motion; w itself without any; collective."""
        if self.rigid is None:
            return w
        G = self.motion_basis.rows
        return w - self.reductions.total(G @ w) @ G

    @cached_property
    def _loads(self) -> float:
        """|b|/a less rigid motions, and |lower|, newtons."""
        lower = np.broadcast_to(np.asarray(self.lower, dtype=float), (self.A.nodes,))
        return self.reductions.norm(self.without_motions(self.b)) / self.mean_diagonal + self.reductions.norm(lower)

    def dilution(self, x: FloatArray, gradient: FloatArray) -> float:
        """How much larger forces are than what A feels of them; at least 1; collective.

        It is a |x|^2 over 10 x^T A x, or a |x| over 10 |b| if that is more: with a residual of r the work of the forces
        on the errors of the displacements is at most 10 r x^T A x, and these errors are at most 10 r |A x| and 10 r
        |b|.  Of elastic bodies it is 1: A has full rank, x^T A x is 0.3 a |x|^2 and more, or far less where soft
        springs make a large, beside which the certificate measures what is elastic.  Lower bounds count as loads, and
        so do those that rigid motions have to balance, but not what a rigid motion would close.

        Args:
            x: Contact forces in newtons, shape (3 m,), node by node (n, t1, t2).
            gradient: w in metres, shape (3 m,).
        """
        if self.elastic:
            return 1.0
        over, felt = self.reductions, np.where(self.A.diagonal() > 0.0, x, 0.0)  # friction of known slip is given
        size, balancing = over.norm(felt), 0.0
        if size == 0.0:
            return 1.0
        if self.rigid is not None:  # G x = e gives a part of x; A feels the rest, which rigid motions do no work on
            balancing = float(np.linalg.norm(self.motion_basis.T @ self.rigid.e)) / size
            felt = self.without_motions(felt)
        work = over.dot(felt / size, (gradient + self.b) / (self.mean_diagonal * size))
        share = _UNDILUTED * min(max(work, 0.0) + balancing**2, self._loads / size + balancing)
        return max(1.0 / share, 1.0) if share > 0.0 else math.inf


class Solver(Protocol):
    """Interface of the solvers.

    `solve` raises NotConverged, carrying the result, if the residual stays above the tolerance, and ValueError if it
    does not support the law or the compliance.
    """

    @property
    def tolerance(self) -> float: ...

    def solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None = None,
        *,
        gradient: FloatArray | None = None,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> SolverResult:
        """See `SolverSettings.solve`."""
        ...


def contact_solver(given: object) -> Solver | None:
    """A solver as it is, or None; ValueError for anything else, such as its class."""
    if given is None or (hasattr(given, "tolerance") and hasattr(given, "solve") and not isinstance(given, type)):
        return cast(Solver | None, given)
    said = repr(given) if isinstance(given, type | str | int | float) else f"a {type(given).__name__}"
    known = f"{given.__name__}()" if isinstance(given, type) else "InteriorPoint() or SuccessiveTresca()"
    raise ValueError(
        f"solver must be one for contact, as {known}, but is {said}; "
        "how K u = f is solved is the linear_solver of the problem"
    )


class Task(NamedTuple):
    """What a solver is asked for, besides the problem: the goal, and arguments of `solve`."""

    goal: Goal
    start: FloatArray | None
    gradient: FloatArray | None
    progress: ProgressCallback | None


def _checked_start(start: FloatArray | None, problem: FrictionProblem) -> FloatArray | None:
    """Forces (3 m,), or several, (k, 3 m), as they are; ValueError on every rank for others; collective."""
    over, size = problem.reductions, 3 * problem.A.nodes
    if not over.any(start is not None):
        return None
    values = np.asarray(start) if start is not None else np.zeros(0)
    numbers = values.dtype.kind in "fiu"
    shape = f"({size},)" if problem.A.comm.size == 1 else "(3 m,) for the m contact points of a rank"
    must = f"start must be forces in newtons, finite real numbers of shape {shape}"
    over.require(numbers and values.ndim in (1, 2) and values.shape[-1] == size, f"{must}, but is not")
    over.require(bool(np.all(np.isfinite(values))), f"{must}, but has entries that are not finite")
    return values.astype(np.float64, copy=False)


@dataclass(frozen=True)
class SolverSettings(Settings):
    """Base of the solvers.

    Attributes:
        tolerance: Residual at which to stop (`FrictionProblem.residual`).
    """

    tolerance: float = within("(0, inf)", 1e-8)

    name: ClassVar[str]

    def solve(
        self,
        problem: FrictionProblem,
        start: FloatArray | None = None,
        *,
        gradient: FloatArray | None = None,
        tolerance: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> SolverResult:
        """Solve a problem with friction.

        Args:
            problem: The problem.
            start: Forces in newtons, shape (3 m,), of a nearby problem.
            gradient: w of the start in metres, shape (3 m,), if it is known.
            tolerance: Replaces the solver's tolerance.
            progress: Called after every step.

        Raises:
            NotConverged: With the best answer, if its residual stays above the tolerance or the certificate fails.
            ValueError: If the method does not support the law or the compliance.
        """
        start = _checked_start(start, problem)
        goal, products = Goal(self.tolerance if tolerance is None else tolerance, problem.accept), problem.A.products
        result = self._solved(problem, Task(goal, start, gradient, progress))
        products = result.products + problem.A.products - products
        result = replace(result, products=products, method=result.method or self.name)
        if result.status is Status.CONVERGED:
            return result
        message = result.message or (
            f"the {self.name} method ended with a residual of {result.residual:.1e} after {result.newton_steps} "
            f"Newton steps ({result.status.value}), {goal.missed(result.residual)}"
        )
        raise NotConverged(message, replace(result, message=message))

    def _solved(self, problem: FrictionProblem, task: Task) -> SolverResult:
        """The best answer, whether it has converged, with products that are not those of A; with method and message
        where they are not the usual ones."""
        raise NotImplementedError
