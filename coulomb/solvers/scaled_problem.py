"""The problem in the variables of path following: answer and counts do not depend on the user's units.

    x = s W (x_n, r y),   r = c + F x_n,    A~ = W A W / a,    b~ = W b / (a s),    a the mean diagonal of A

A friction cone is a disc of unit radius once friction is measured by its bound: y = x_t/r(x_n).  With w = A~ x~ - b~
and the slacks z1 = x_n - lower, z2 = r (1 - |y|^2)/2,

    w_n - nu1 = 0          nu1 z1 = theta
    w_t + nu2 y = 0        nu2 z2 = theta

at every node: at theta = 0 Signorini's law and the law of friction.  nu1 is the gap; nu2 the slip, which friction
opposes.  All slacks are forces, all multipliers displacements.  Without slope this is the paper's problem with the disc
(|x_t|^2 - g^2)/(2 g) <= 0.  A node without friction has no second constraint and no y.

Rigid motions add w -= G~^T alpha~ and the equations G~ x~ = e~.  The rows of G~ are orthonormal combinations of those
of G W on the unknowns: an error of G~ x~ is then the distance of x~ from equilibrium, comparable with the gradient, and
motions that no contact force resists are left out (alpha is the shortest along them).

s is a nominal nodal force: the multiple of equal pressure on all nodes that minimises the objective.  W is 1 on normal
forces; on friction it is min(c/s, 1) where the law has no slope, so that small discs become unit discs: the gradient of
a node is then weighted by the work that its force can do, and slip bounds over many orders of magnitude need no more
steps than equal ones.  Where the law has a slope, the rows are weighted by min(r, 1) of the iterate instead (`weight`).

Bodies of very different stiffness or load have nominal forces of their own: W is times f, and theta in the products of
their nodes times their energy a f^2 over the mean; gradients are divided by it.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ..arrays import FloatArray, squares
from ..linalg.compliance import Compliance, Constraints, Formed, RecycledColumns
from ..linalg.reductions import Reductions
from .friction_problem import FrictionProblem
from .linearization import Linearization
from .rigid_motions import NO_MOTION, MotionBasis

_LEAST_WEIGHT: Final = 1e-3
"""Weights below this make columns inaccurate that were found with others."""


class ScaledCompliance:
    """A~ = W A W / a for forces x = s W x~: the interface of A for Newton systems.

    a is in metres per newton, s in newtons; arrays are (m, 3).

    Attributes:
        diagonal: diag(A~).
        rest: diag(A~), where products are inexact without the few large eigenvalues that the estimate of it has found.
        G: G~^T, the displacements of the nodes under rigid motions, shape (m, 3, r), r = 0 without any.
        constraints: G~ x = e~.
        rigid: Columns F~ of a part F~ F~^T of A~ that is known exactly (`MatrixFreeCompliance.rigid`), shape (3 m, q).
        recalls: Whether Newton systems begin with the columns of A that earlier problems have found.
    """

    def __init__(self, A: Compliance, W: FloatArray, a: float, s: float, G: FloatArray | None = None):
        self.A, self.W, self.a, self.s = A, W, a, s
        self.comm, self.nodes = A.comm, A.nodes
        self.diagonal: FloatArray = W**2 * A.diagonal().reshape(-1, 3) / a
        free = A.matrix_free
        rest = A.diagonal() if free is None or A.exact else free.rest_of_diagonal
        self.rest: FloatArray = W**2 * rest.reshape(-1, 3) / a
        self.G: FloatArray = np.empty((*W.shape, 0)) if G is None else G
        self.constraints = Constraints(A.comm, self.G)
        F = None if free is None else free.rigid
        self.rigid: FloatArray = np.empty((W.size, 0)) if F is None else W.reshape(-1, 1) * F / np.sqrt(a)
        self.recalls = False

    def mult(self, x: FloatArray, tolerance: float = 0.0) -> FloatArray:
        """A~ x, to a relative accuracy; one product."""
        y = np.empty(self.W.size)
        self.A.mult((self.W * x).ravel(), y, tolerance)
        return self.W * y.reshape(-1, 3) / self.a

    def mult_incremental(self, x: FloatArray, tolerance: float = 0.0) -> FloatArray:
        """A~ x of the next iterate, its change to a relative accuracy; one product."""
        y = np.empty(self.W.size)
        self.A.mult_incremental(self.forces(x), y, tolerance)
        return self.image(y)

    def dense(self) -> FloatArray:
        """A~ as an array, shape (3 m, 3 m), on one rank: as A has it, or by 3 m products."""
        A, W = self.A, self.W.ravel()
        if isinstance(A, Formed):
            return W[:, None] * A.dense() * W / self.a
        return np.array([self.mult(e.reshape(-1, 3)).ravel() for e in np.eye(W.size)]).T

    def forces(self, x: FloatArray) -> FloatArray:
        """s W x in newtons, shape (3 m,)."""
        return (self.s * self.W * x).ravel()

    def known(self) -> RecycledColumns | None:
        """The columns that earlier problems with this A have found, scaled; None if there are none, or if the weights
        are too far apart; collective if there are any."""
        learnt = self.A.learnt
        if not self.recalls or learnt.X is None or learnt.U is None:
            return None
        if Reductions(self.comm).min(self.W) < _LEAST_WEIGHT:
            return None
        scaled, root, W = RecycledColumns(), np.sqrt(self.a), self.W.reshape(-1, 1)
        scaled.keep(root * learnt.X / W, W * learnt.U / root, learnt.part)
        return scaled

    def keep(self, columns: RecycledColumns, prepared: object | None = None) -> None:
        """Keep the columns found by a Newton system, scaled, for problems to come; and what was `prepared` of them, in
        the variables of this problem."""
        if columns.X is not None and columns.U is not None:
            root, W = np.sqrt(self.a), self.W.reshape(-1, 1)
            self.A.learnt.keep(W * columns.X / root, root * columns.U / W, columns.part, prepared)

    def image(self, displacement: FloatArray) -> FloatArray:
        """Displacements A x in metres (3 m,), as A~ x~."""
        return self.W * displacement.reshape(-1, 3) / (self.a * self.s)


_SHARPEST: Final = 1e-5
"""Smallest factor of the accuracy of products: below it the accuracy of the solves with K decides."""


class IterateProducts:
    """A x of the iterates, one product each, the next from the one before.

    Attributes:
        sharper: Factor of the accuracy of inexact products, 1 at first.
        corrects: Whether to continue with the exact A x of an iterate, once it is known; else the next step removes
            its error.
    """

    corrects = True

    def __init__(self, A: ScaledCompliance):
        self._scaled, self.sharper = A, 1.0

    def first(self, x: FloatArray, tolerance: float) -> FloatArray:
        """A x of the first iterate x (m, 3), to a relative accuracy."""
        return self._scaled.mult_incremental(x, tolerance)

    def advance(self, x: FloatArray, predicted: FloatArray | None, alpha: float, tolerance: float) -> FloatArray:
        """A x of the next iterate x (m, 3), alpha along the last step, to a tolerance relative to the change.

        `predicted`, A x + alpha A dx for a straight step, suffices if products are exact.
        """
        if predicted is not None and self._scaled.A.exact:
            return predicted
        return self._scaled.mult_incremental(x, self.sharper * tolerance)

    def exact(self, x: FloatArray) -> FloatArray:
        """The most accurate A x, shape (m, 3), for the final residual."""
        return self._scaled.mult_incremental(x)

    def tighten(self) -> None:
        """Make inexact products ten times as accurate from now on."""
        self.sharper = max(0.1 * self.sharper, _SHARPEST)


_MIXED: Final = 10.0
"""Largest over smallest energy of the bodies from which on each has its own nominal force."""

_ROUGHLY: Final = 1e-3
"""Relative residual of the product that gives a nominal force."""


class Iterate(NamedTuple):
    """x_n (m,), y (m, 2), nu (m, 2), A x (m, 3), alpha (r,), in scaled variables; x_n > lower, |y| < 1, nu > 0.

    w is A x - b (m, 3) where it is known as such, without the rounding errors of A x and b; else None.
    """

    x_n: FloatArray
    y: FloatArray
    nu: FloatArray
    A_x: FloatArray
    alpha: FloatArray = NO_MOTION
    w: FloatArray | None = None


class Step(NamedTuple):
    """A step on its curve: v(alpha), and its Krylov iterations."""

    v: Iterate
    dx_n: FloatArray
    dy: FloatArray
    dnu: FloatArray
    A_dx: FloatArray
    iterations: int
    dalpha: FloatArray = NO_MOTION

    def at(self, alpha: float) -> Iterate:
        """The iterate at a step length; A x to first order where the curve is not straight."""
        v = self.v
        A_x = v.A_x + alpha * self.A_dx
        motion = v.alpha + alpha * self.dalpha
        return Iterate(v.x_n + alpha * self.dx_n, v.y + alpha * self.dy, v.nu + alpha * self.dnu, A_x, motion)


class ScaledProblem:
    """A problem with friction, scaled, and the norms of path following; all arrays of this rank.

    Attributes:
        nodes: Contact nodes m of this rank.
        frictional: Nodes with friction to be found (`FrictionProblem.frictional`), shape (m,).
        sloped: Whether friction grows with pressure anywhere, on any rank.
        lower: Lower bound of x_n, shape (m,).
        law: The scaled law; bound 1 where there is no friction.
        A: The scaled compliance, with G~.
        free: b~ on the unknowns, shape (m, 3): what the loads without contact forces close of gaps and slips.
        A_ones: A~ of unit normal forces, shape (m, 3), the product that gave the nominal force.
        e: e~, shape (r,).
        energy: Energies of the bodies over a s^2, at every node, shape (m, 1); 1 for one body.
        mixed: Whether they differ: then rows have weights, and CG cannot solve the Newton systems.
    """

    def __init__(self, problem: FrictionProblem):
        self.problem, self._over, self.sloped = problem, problem.reductions, problem.sloped
        self.nodes, self.frictional = problem.A.nodes, problem.frictional
        self._active = problem.unknown[:, :2]
        self._all_active, self._ones = bool(self.frictional.all()), np.ones(self.nodes)
        self._constraints = self._over.sum(self._active.astype(float))
        self._unknowns = self._over.sum(1.0 + 2.0 * self.frictional)
        self._a, self._s = problem.mean_diagonal, self._nominal_force()
        self._nominal, self.energy = self._of_bodies()
        self.mixed = self._over.max(self.energy) > self._over.min(self.energy)
        law = problem.law.scaled(self._s * self._nominal)
        unit = np.where(self.frictional & ~law.sloped, np.minimum(law.radius(np.zeros(self.nodes)), 1.0), 1.0)
        self.law = law.scaled(1.0, unit).only(self.frictional, 1.0)
        self._W = self._nominal[:, None] * np.column_stack([np.ones(self.nodes), unit, unit])
        self._T, G, self.e = self._motions()
        self.A = ScaledCompliance(problem.A, self._W, self._a, self._s, G)
        self.A_ones: FloatArray = self._W * self._A_e / self._a
        self.lower = np.broadcast_to(np.asarray(problem.lower) / (self._s * self._nominal), (self.nodes,))
        self._b = self._W * problem.b.reshape(-1, 3) / (self._a * self._s)
        self.free: FloatArray = np.where(problem.unknown, self._b, 0.0)

    def _nominal_force(self) -> float:
        """s > 0 in newtons; one product by A."""
        over, b = self._over, self.problem.b
        e, A_e = np.zeros((self.nodes, 3)), np.empty(3 * self.nodes)
        e[:, 0] = 1.0
        self.problem.A.mult(e.ravel(), A_e, _ROUGHLY)
        self._A_e = A_e.reshape(-1, 3)
        least = 0.1 * over.max(np.abs(np.asarray(self.problem.lower)))
        if self.problem.rigid is not None:  # at least the size of the smallest forces that balance the loads
            least = max(least, self.problem.motion_basis.distance(self.problem.rigid.e) / over.norm(e))
            b = self.problem.without_motions(b)
        felt, alone = over.dot(e.ravel(), A_e), self.problem.mean_diagonal * over.dot(e.ravel(), e.ravel())
        felt = felt if felt > 1e-9 * alone else alone  # opposite forces at nodes that touch two foundations cancel
        s = max(over.dot(e.ravel(), b), 0.1 * over.norm(e) * over.norm(b)) / felt
        return max(s, least) or 1.0  # without loads any force will do

    def _of_bodies(self) -> tuple[FloatArray, FloatArray]:
        """Nominal forces f of the bodies over s, shape (m,), and energies a f^2 over those of the mean, shape (m, 1);
        1 unless they differ much; a product by A more if they do."""
        problem, scales, same = self.problem, self.problem.scales, np.ones(self.nodes)
        if scales.bodies == 1:
            return same, same[:, None]
        groups, b = scales.of_groups, problem.without_motions(problem.b).reshape(-1, 3)
        loads, squares, nodes = groups.sums(b[:, 0]), groups.sums(np.sum(b**2, axis=1)), groups.sums(same)
        with np.errstate(divide="ignore", invalid="ignore"):
            f = np.maximum(loads, 0.1 * np.sqrt(nodes * squares)) / groups.sums(self._A_e[:, 0]) / self._s
        f = np.where((f > 0.0) & np.isfinite(f), f, 1.0)
        if problem.rigid is not None:  # forces go on from body to body, and b is that of one of many K^+
            f = np.ones_like(f)
        a = scales.sums(scales.compliance[:, 0]) / np.maximum(scales.sums(same), 1.0)
        nominal, A_e = f[groups.body], np.empty(3 * self.nodes)
        energy = np.where(a > 0.0, a / self._a, 1.0)[scales.body] * nominal**2
        if not self._over.max(energy) > _MIXED * self._over.min(energy):
            return same, same[:, None]
        problem.A.mult(np.column_stack([nominal, 0.0 * same, 0.0 * same]).ravel(), A_e, _ROUGHLY)
        self._A_e = A_e.reshape(-1, 3)
        return nominal, energy[:, None]

    def _motions(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """T (r, q), G~ (m, 3, r), e~ (r,) with G~ = T G W, e~ = T e/s."""
        rigid = self.problem.rigid
        if rigid is None:
            return np.empty((0, 0)), np.empty((self.nodes, 3, 0)), NO_MOTION
        basis = MotionBasis(rigid.G * (self._W * self.problem.unknown).ravel(), self._over)
        return basis.T, basis.rows.T.reshape(self.nodes, 3, len(basis.T)), basis.T @ rigid.e / self._s

    # --- norms ----------------------------------------------------------------------------------------------------

    def theta(self, nu: FloatArray, z: FloatArray) -> float:
        """Duality measure nu^T z / (number of constraints)."""
        return self._over.dot(nu / self.energy, z) / self._constraints

    def smallest_product(self, nu: FloatArray, z: FloatArray) -> float:
        """Smallest nu_i z_i of all constraints."""
        products = nu / self.energy * z
        return self._over.min(products if self._all_active else products[self._active])

    def on_constraints(self, values: FloatArray) -> FloatArray:
        """`values` (m, 2) where there is a constraint, 0 where there is no disc."""
        return values if self._all_active else np.where(self._active, values, 0.0)

    def over_constraints(self, values: FloatArray, divisor: FloatArray, otherwise: float = 0.0) -> FloatArray:
        """values / divisor (m, 2) where there is a constraint, `otherwise` where there is no disc."""
        if self._all_active:
            return values / divisor
        quotient: FloatArray = values / np.where(self._active, divisor, 1.0)
        return np.where(self._active, quotient, otherwise)

    def rms(self, r: FloatArray) -> float:
        """Root mean square over the unknowns."""
        return self._over.norm(r) / math.sqrt(self._unknowns)

    def from_rms(self, value: float) -> float:
        """The Euclidean norm of a residual whose root mean square is `value`."""
        return value * math.sqrt(self._unknowns)

    def relative_change(self, old: Iterate, new: Iterate) -> float:
        """err = |v_new - v| / |v_new| of v = (x, nu, z)."""
        before, after = ((self.forces(v.x_n, v.y), v.nu / self.energy, self.slack(v.x_n, v.y)) for v in (old, new))
        return self._over.norm(*(n - o for n, o in zip(after, before, strict=True))) / self._over.norm(*after)

    def infeasibility(self, v: Iterate) -> float:
        """Root mean square of the weighted gradient; with rigid motions, of it and of what lacks for equilibrium."""
        gradient = self.rms(self.weight(v.x_n) * self.gradient(v))
        if not len(self.e):
            return gradient
        return math.hypot(gradient, float(np.linalg.norm(self.out_of_balance(v))) / math.sqrt(self._unknowns))

    def target(self, theta: float) -> FloatArray:
        """Products nu z at theta on the central path, shape (m, 2)."""
        return np.repeat(theta * self.energy, 2, axis=1)

    # --- formulas of the path ---------------------------------------------------------------------------------------

    def forces(self, x_n: FloatArray, y: FloatArray) -> FloatArray:
        """x = (x_n, r y), shape (m, 3)."""
        r = self.law.radius(x_n)
        return np.column_stack([x_n, r * y[:, 0], r * y[:, 1]])

    def slack(self, x_n: FloatArray, y: FloatArray) -> FloatArray:
        """z, shape (m, 2); 0 where there is no constraint."""
        disc = 0.5 * self.law.radius(x_n) * (1.0 - squares(y))
        return self.on_constraints(np.column_stack([x_n - self.lower, disc]))

    def gradient(self, v: Iterate) -> FloatArray:
        """(w_n - nu1, w_t + nu2 y) on the unknowns, shape (m, 3)."""
        r = self._w(v)
        if len(self.e):
            r -= self.A.G @ v.alpha
        r[:, 0] -= v.nu[:, 0]
        r[:, 1:] += v.nu[:, 1:] * v.y
        if not self._all_active:
            r[~self.frictional, 1:] = 0.0
        return r

    def out_of_balance(self, v: Iterate) -> FloatArray:
        """e~ - G~ x~, shape (r,), what lacks for equilibrium; collective if there are rigid motions."""
        if not len(self.e):
            return NO_MOTION
        return self.e - self.A.constraints.resultant(self.forces(v.x_n, v.y))

    def closing(self, v: Iterate) -> Iterate:
        """The iterate with the alpha that makes its weighted gradient smallest."""
        if not len(self.e):
            return v
        weight = self.weight(v.x_n)
        G = (weight[:, :, None] * self.A.G).reshape(-1, len(self.e))
        gradient = (weight * self.gradient(v._replace(alpha=np.zeros(len(self.e))))).ravel()
        normal, right = self._over.totals(G.T @ G, G.T @ gradient)
        return v._replace(alpha=np.linalg.lstsq(normal, right, rcond=1e-12)[0])

    def linearize(self, v: Iterate) -> Linearization:
        """The Newton system at an iterate."""
        r = self.law.radius(v.x_n)
        return Linearization(
            slope=self.law.slope(v.x_n),
            r=r,
            h=self.on_constraints(v.nu)[:, 1] / r,
            y=v.y,
            D22=self.over_constraints(self.slack(v.x_n, v.y), v.nu, 1.0),
            frictional=self.frictional,
        )

    def weight(self, x_n: FloatArray) -> FloatArray:
        """Weights of the rows, shape (m, 3): 1 for gaps, min(r, 1) for slips, which is 1 where there is no slope;
        open nodes get no weight if friction is proportional to pressure."""
        t = np.minimum(self.law.radius(x_n), 1.0)
        return np.column_stack([self._ones, t, t]) / self.energy

    def distance_to_boundary(self, v: Iterate, dx_n: FloatArray, dy: FloatArray, dnu: FloatArray) -> float:
        """Largest alpha with x_n + alpha dx_n >= lower, |y + alpha dy| <= 1, nu + alpha dnu >= 0; inf if there is none.

        On a disc with room = 1 - |y|^2, it is the positive root, computed without cancellation.
        """
        room = 1.0 - squares(v.y)
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = np.where(dx_n < 0.0, -(v.x_n - self.lower) / dx_n, math.inf)
            multiplier = np.where(dnu < 0.0, -v.nu / dnu, math.inf)[self._active]
            squared, outward = squares(dy), dy[:, 0] * v.y[:, 0] + dy[:, 1] * v.y[:, 1]
            disc = (room / (outward + np.sqrt(outward**2 + squared * room)))[self.frictional & (squared > 0.0)]
        return self._over.min(np.concatenate([bound, multiplier, disc]))

    # --- between the scaled and the user's variables ----------------------------------------------------------------

    def scaled(self, x: FloatArray) -> FloatArray:
        """Forces (3 m,) in N as x~, shape (m, 3); no friction where there is no disc."""
        x_scaled = x.reshape(-1, 3) / (self._s * self._W)
        x_scaled[~self.frictional, 1:] = 0.0
        return x_scaled

    def scaled_gradient(self, gradient: FloatArray) -> FloatArray:
        """A x - b (3 m,) in m as A~ x~ - b~, shape (m, 3)."""
        return self._W * gradient.reshape(-1, 3) / (self._a * self._s)

    def unscaled(self, v: Iterate) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Forces in N (3 m,), with friction where the slip is known, w in m (3 m,), multipliers in m (m, 2)."""
        unit, problem = self._a * self._s / self._W, self.problem
        forces = self._s * self._W * self.forces(v.x_n, v.y)
        multipliers, known = unit[:, :2] * v.nu, problem.law.frictional & problem.known_slip
        multipliers[known, 1] = np.linalg.norm(problem.b.reshape(-1, 3)[known, 1:], axis=1)
        gradient = self.displaced(v)
        if problem.rigid is not None:
            gradient = gradient - problem.rigid.displacement(self.rigid_motion(v))
        return problem.completed(forces.ravel()), gradient, multipliers

    def displaced(self, v: Iterate) -> FloatArray:
        """A x - b in metres, shape (3 m,), without rigid motions."""
        return (self._a * self._s / self._W * self._w(v)).ravel()

    def _w(self, v: Iterate) -> FloatArray:
        """A~ x~ - b~ without rigid motions, shape (m, 3)."""
        return v.A_x - self._b if v.w is None else v.w.copy()

    def rigid_motion(self, v: Iterate) -> FloatArray:
        """alpha (q,) in the user's units, the shortest; empty without rigid motions."""
        if self.problem.rigid is None:
            return NO_MOTION
        return self._a * self._s * (self._T.T @ v.alpha)

    def with_gradient(self, v: Iterate, gradient: FloatArray) -> Iterate:
        """The iterate with A x - b in metres, shape (3 m,), without rigid motions, not from its A x."""
        w = self.A.image(gradient)
        return v._replace(A_x=w + self._b, w=w)

    # --- warm starts -------------------------------------------------------------------------------------------------

    def inside(self, x: FloatArray, least: float, most: float) -> tuple[FloatArray, FloatArray]:
        """x_n (m,) >= lower + least and y (m, 2), |y| <= most, nearest to forces in N (3 m,)."""
        forces = self.scaled(x)
        x_n = np.maximum(forces[:, 0], self.lower + least)
        y = forces[:, 1:] / self.law.radius(x_n)[:, None]
        size = np.linalg.norm(y, axis=1)
        return x_n, y * (np.minimum(size, most) / np.where(size > 0.0, size, 1.0))[:, None]

    def projection_step(self, x: FloatArray, w: FloatArray) -> FloatArray:
        """q = x - D^-1 w with w = A x - b and D = diag(A), made isotropic on each disc; a solution has P(q) = x."""
        return x - w / self.isotropic()

    def isotropic(self) -> FloatArray:
        """diag(A~), made isotropic on each disc, 1 where there is none, shape (m, 3)."""
        d = self.A.diagonal.copy()
        d[:, 1:] = np.where(self.frictional[:, None], 0.5 * (d[:, 1:2] + d[:, 2:3]), 1.0)
        return d

    def distance_from_solution(self, x: FloatArray, q: FloatArray) -> float:
        """Root mean square of x - P(q) in units of the nominal force."""
        p: FloatArray = self.law.project(q.ravel(), x[:, 0], self.lower).reshape(-1, 3)
        p[~self.frictional, 1:] = 0.0
        return self.rms(self._W / self._nominal[:, None] * (x - p))

    def smoothed_projection(self, q: FloatArray, theta: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The point of the projection's central path: x_n, y strictly feasible, nu, with nu_i z_i = theta.

        Minimises 1/2 (x - q)^T D (x - q) under the constraints with barrier theta, the discs with the radius of the
        x_n found.  A bound: x_n - l is the positive root of t^2 - (q_n - l) t - theta/d (the smoothing of Chen, Harker,
        Kanzow and Smale).  A disc: x_t = q_t / (1 + tau) with tau = nu2 / (r d), where
        d tau (r^2 - |q_t|^2 / (1 + tau)^2) = 2 theta.
        """
        d = self.isotropic()[:, 0]
        target = self.target(theta)
        above = q[:, 0] - self.lower
        root = np.sqrt(above**2 + 4.0 * target[:, 0] / d)
        with np.errstate(divide="ignore", invalid="ignore"):  # the root without cancellation
            t = np.where(above > 0.0, 0.5 * (above + root), 2.0 * target[:, 0] / d / (root - above))
        x_n = self.lower + t
        y = self.smoothed_discs(x_n, q[:, 1:], theta)
        with np.errstate(divide="ignore"):  # of discs that rounding errors have left no room, from which no path begins
            nu = self.over_constraints(target, self.slack(x_n, y))
        return x_n, y, nu

    def smoothed_discs(self, x_n: FloatArray, q_t: FloatArray, theta: float) -> FloatArray:
        """The part y (m, 2) of `smoothed_projection`, with discs of the radius of x_n (m,), of q_t (m, 2)."""
        d_t, r, size = self.isotropic()[:, 1], self.law.radius(x_n), np.hypot(q_t[:, 0], q_t[:, 1])
        target = self.target(theta)[:, 0]
        low = np.maximum(size / r - 1.0, 0.0)
        high = low + 1.0 + 4.0 * target / (d_t * r**2)
        for _ in range(100):  # bisection: the left-hand side grows with tau between these bounds
            tau = 0.5 * (low + high)
            short = tau * d_t * (r**2 - (size / (1.0 + tau)) ** 2) < 2.0 * target
            low, high = np.where(short, tau, low), np.where(short, high, tau)
        y: FloatArray = q_t / ((1.0 + high) * r)[:, None]
        y[~self.frictional] = 0.0
        return y
