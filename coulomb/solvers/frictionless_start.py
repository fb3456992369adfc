"""A cold start that knows the free gaps: forces near the central path of the problem without friction.

With equal pressure on all nodes, a body most of whose contact face opens is bent by forces far from any answer: the
first gradient is thousands of times too large, and tens of steps only recover from it, at step lengths near 0.1.  This
start minimises, over normal forces only, the barrier function whose minimisers are the central path,

    1/2 x^T A x - b^T x - theta sum log(x_n - lower)

so that a node with a large free gap begins with theta over its gap as pressure and the gap as its multiplier, and the
nodes that the free motion pushes into the foundation share the load.  The minimum is sought with one product per
iteration: with A replaced by what the products so far have shown of it (low_rank.py), it is found by Newton's method
without any product.  A product along the line to it makes the search along this line exact, and is another of those
that the replacement reproduces.  Three suffice on a block that is pressed down, 6 to 12 on parts that open.  All are
passed on to the Newton systems, which would otherwise make them in their first steps.

Friction follows from the slip that these forces leave: at each node that of the smoothed projection onto its disc with
diag(A), all of it scaled by the factor that minimises the objective, since nodes that stick together are much more
compliant than each alone.

theta is proportional to the elastic energy per node that carries (`_SHARE`).  Larger values take more steps to the end;
with smaller ones the friction is too far from its answer, and steps block.

Where contact alone holds a body, motions from where it would touch are resisted by a penalty on what lacks for
equilibrium, as friction is not there to provide it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..arrays import FloatArray
from ..linalg.compliance import REPLACED, LowRankApproximation, LowRankUpdate
from ..linalg.reductions import Reductions
from .newton_systems import NewtonSystem
from .scaled_problem import Iterate, ScaledProblem

_SHARE: Final = 3e-3
"""theta over the elastic energy per node that carries, x^T A x (x . x)/(sum x)^2 (interior-point-settings.csv)."""

_CENTRED: Final = 0.6
"""Root mean square of (w_n - nu_1)/nu_1 with nu_1 = theta/(x_n - lower) at which forces are near enough to the path."""

_DECREMENT: Final = 1e-3
"""Newton's decrement per node, over theta, at which the minimum with the model of A is found."""

_PENALTY: Final = 100.0
"""Resistance to what lacks for equilibrium, over the mean compliance under equal pressure."""

_EVEN: Final = 1.5
"""Gaps under equal pressure, root mean square in units of the nominal force times the mean diagonal of A, below which
equal pressure itself is the start for bodies that contact alone holds: friction carries their loads as well."""

_EVEN_THETA: Final = 0.1
"""theta of this start, over rms(A x - b)."""


def frictionless_start(scaled: ScaledProblem, newton: NewtonSystem, most: int, accuracy: float) -> Iterate | None:
    """An iterate near the central path, its multipliers central; None if it is not finite; collective.

    At most `most` products are made on the problem without friction, and four more, to an accuracy if each is the
    solution of a system; they are passed on to the Newton systems.
    """
    normal = _Frictionless(scaled, accuracy)
    even = normal.even()
    if even is not None:
        return even._replace(A_x=newton.products.first(scaled.forces(even.x_n, even.y), accuracy))
    for _ in range(most):
        if not normal.improve():
            return None
        if normal.distance() <= _CENTRED:
            break
    y = normal.friction()
    newton.learn(normal.pairs)
    x_n, theta = normal.x, normal.theta
    finite = math.isfinite(theta) and bool(np.all(np.isfinite(x_n)) and np.all(np.isfinite(y)))
    if not normal.over.all(finite and bool(np.all(x_n > scaled.lower))) or theta <= 0.0:
        return None
    A_x = newton.products.first(scaled.forces(x_n, y), accuracy)
    nu = scaled.over_constraints(scaled.target(theta), scaled.slack(x_n, y))
    return scaled.closing(Iterate(x_n, y, nu, A_x))


class _Frictionless:
    """The barrier function of the normal forces, with the best forces so far, by products of some accuracy.

    Attributes:
        x: Normal forces, shape (m,).
        theta: The barrier parameter.
        pairs: All products so far, x and A x, each (m, 3).
    """

    def __init__(self, scaled: ScaledProblem, accuracy: float):
        self.over = Reductions(scaled.A.comm)
        self._scaled, self._accuracy = scaled, accuracy
        self._model = LowRankApproximation(scaled.A.comm, scaled.A.diagonal, 1000, scaled.A.A.exact, REPLACED)
        self._G: FloatArray = scaled.A.G[:, 0]
        self._nearest = -scaled.A.constraints.resultant(
            scaled.free
        )  # the motion that comes nearest to the free gaps and slips
        carried = self.over.dot(scaled.A_ones[:, 0], np.ones(scaled.nodes))
        self._penalty = _PENALTY * max(carried / self.over.sum(np.ones(scaled.nodes)), 1.0)
        self.pairs: list[tuple[FloatArray, FloatArray]] = []
        self.x: FloatArray = scaled.lower + 1.0
        ones = self._forces(np.ones(scaled.nodes))
        self._learn(ones, scaled.A_ones)
        self._A_x = scaled.A_ones.copy()
        if self.over.max(np.abs(scaled.lower)) > 0.0:
            self._A_x = self._product(self._forces(self.x))
        self._choose_theta()

    # --- the problem -----------------------------------------------------------------------------------------------

    def _forces(self, x_n: FloatArray) -> FloatArray:
        return np.column_stack([x_n, np.zeros((len(x_n), 2))])

    def _product(self, x: FloatArray) -> FloatArray:
        A_x = self._scaled.A.mult(x, self._accuracy)
        self._learn(x, A_x)
        return A_x

    def _learn(self, x: FloatArray, A_x: FloatArray) -> None:
        self.pairs.append((x, A_x))
        self._model.record(x, A_x)
        self._model.update()

    def _lacking(self) -> FloatArray:
        """What lacks for equilibrium along the motions, shape (r,)."""
        return self._scaled.e - self.over.total(self._G.T @ self.x) if len(self._scaled.e) else self._scaled.e

    def _w(self) -> FloatArray:
        """w = A x - b - G^T alpha on all rows, shape (m, 3)."""
        v = Iterate(
            self.x,
            np.zeros((len(self.x), 2)),
            np.zeros((len(self.x), 2)),
            self._A_x,
            self._nearest + self._penalty * self._lacking(),
        )
        return self._scaled.gradient(v)

    def _choose_theta(self) -> None:
        above = self.x - self._scaled.lower
        work = abs(self.over.dot(self.x / self._scaled.energy[:, 0], self._A_x[:, 0]))
        energy = work + self._penalty * float(np.sum(self._lacking() ** 2))
        energy *= self.over.dot(above, above) / self.over.sum(above) ** 2
        self.theta = _SHARE * max(energy, self._frictional_energy())

    def _frictional_energy(self) -> float:
        """A bound per node for the elastic energy of friction, which given slip bounds give to open nodes, too."""
        scaled = self._scaled
        w = self._w()
        force = np.minimum(scaled.law.radius(self.x), np.linalg.norm(w[:, 1:], axis=1) / scaled.isotropic()[:, 1])
        worked = np.where(scaled.frictional, scaled.isotropic()[:, 1] * force**2 / scaled.energy[:, 0], 0.0)
        return self.over.sum(worked) / self.over.sum(np.ones(len(worked)))

    def distance(self) -> float:
        """Root mean square of (w_n - nu_1)/nu_1 over the nodes, 0 on the central path."""
        off = self._w()[:, 0] * (self.x - self._scaled.lower) / self._scaled.target(self.theta)[:, 0] - 1.0
        return self.over.norm(off) / math.sqrt(self.over.sum(np.ones(len(off))))

    def even(self) -> Iterate | None:
        """Equal pressure without friction, if that nearly closes all gaps of bodies that contact alone holds."""
        scaled, zero = self._scaled, np.zeros((len(self.x), 2))
        if not len(scaled.e):
            return None
        v = scaled.closing(Iterate(self.x, zero, zero, self._A_x))
        gradient = scaled.gradient(v) / scaled.energy
        if self.over.norm(gradient[:, 0]) > _EVEN * math.sqrt(self.over.sum(np.ones(len(self.x)))):
            return None
        theta = _EVEN_THETA * max(scaled.rms(gradient), 1e-3)
        return v._replace(nu=scaled.over_constraints(scaled.target(theta), scaled.slack(self.x, zero)))

    # --- an iteration ----------------------------------------------------------------------------------------------

    def improve(self) -> bool:
        """One product: towards the minimum with the model of A, as far as the function decreases; False if there is no
        minimum, as where nothing presses bodies that contact alone holds."""
        self._choose_theta()
        w = self._w()[:, 0]
        with np.errstate(all="ignore"):
            dx = self._minimiser(w) - self.x
        if not self.over.all(bool(np.all(np.isfinite(dx)))):
            return False
        A_dx = self._product(self._forces(dx))
        moved = self.over.total(self._G.T @ dx)
        slope, curvature = self.over.dot(w, dx), self.over.dot(dx, A_dx[:, 0]) + self._penalty * float(moved @ moved)
        t = self._along(dx, slope, curvature)
        self.x = self.x + t * dx
        self._A_x += t * A_dx
        return True

    def _minimiser(self, w: FloatArray) -> FloatArray:
        """The minimum of the barrier function with the model of A, by Newton's method from x, where the gradient of the
        quadratic part is w; shape (m,)."""
        over, above, theta = self.over, self.x - self._scaled.lower, self._scaled.target(self.theta)[:, 0]
        columns = self._model.nodal_columns(3, np.ones(len(w), dtype=bool))[:, 0]
        U = np.column_stack([columns, math.sqrt(self._penalty) * self._G])
        signs = np.append(self._model.signs, np.ones(self._G.shape[1]))
        rest, nodes, dx = self._model.rest[:, 0], over.sum(np.ones(len(w))), np.zeros_like(w)
        for _ in range(50):
            r = w + rest * dx + U @ (signs * over.total(U.T @ dx)) - theta / (above + dx)
            h = rest + theta / (above + dx) ** 2
            inverse = LowRankUpdate(over.comm, lambda r, h=h: (r.T / h).T, U[:, None], signs)  # type: ignore[misc]
            step = -inverse(r[:, None])[:, 0]
            decrement = -over.dot(r / self._scaled.energy[:, 0], step)
            with np.errstate(divide="ignore", invalid="ignore"):
                boundary = over.min(np.where(step < 0.0, -(above + dx) / step, math.inf))
            dx = dx + min(1.0, 0.95 * boundary) * step
            if not decrement > _DECREMENT * self.theta * nodes:
                break
        return self.x + dx

    def _along(self, dx: FloatArray, slope: float, curvature: float) -> float:
        """The step along dx at which the barrier function is smallest, by bisection of its derivative."""
        above, target = self.x - self._scaled.lower, self._scaled.target(self.theta)[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            boundary = self.over.min(np.where(dx < 0.0, -above / dx, math.inf))
        low, high = 0.0, min(0.99 * boundary, 1e3)
        for _ in range(40):
            t = 0.5 * (low + high)
            rising = slope + t * curvature - self.over.sum(target * dx / (above + t * dx)) > 0.0
            low, high = (low, t) if rising else (t, high)
        return low

    # --- friction --------------------------------------------------------------------------------------------------

    def friction(self) -> FloatArray:
        """y (m, 2) against the slip that the normal forces leave; one product."""
        scaled = self._scaled
        w = self._w()
        y = scaled.smoothed_discs(self.x, scaled.projection_step(np.zeros_like(w), w)[:, 1:], self.theta)
        x = self._forces(np.zeros(len(self.x)))
        x[:, 1:] = scaled.law.radius(self.x)[:, None] * y
        moved = scaled.A.constraints.resultant(x)
        energy = self.over.dot(x, self._product(x)) + self._penalty * float(moved @ moved)
        work = -self.over.dot(x, w)
        if not 0.0 < work < energy:
            return y if work > 0.0 else np.zeros_like(y)
        return y * (work / energy)
