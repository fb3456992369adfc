"""Corrections of a Newton step that lengthen it, without a product by A.

A step of path following ends where the first constraint is reached, often after a tenth of its length because of a few
of thousands of nodes.  Two corrections are tried, both with the approximation of A from the products so far
(low_rank.py) in place of A.  The boundary is where it is for any direction, so that the length of a corrected step is
known; only its gradient is estimated, and that of the next iterate is computed with a product in any case.  A
correction is used only if it lengthens the step.

- Nodes that would open with much of the step left, held: their pressure falls to `_LEFT` of itself and their gap
  follows from the equations, as in an active-set method, while all other nodes respond.  Nodes whose gap would become
  negative are released, and others that would open are held, until nothing changes, at most `_ROUNDS` times.
  Otherwise a step settles only the first of these nodes, the next step the next one: pressure at the rim of a bore.
- Correctors for products nu z that would be too small or too large at a longer step, at most `_CORRECTORS` times: J.
  Gondzio, Multiple centrality corrections in a primal-dual method for linear programming, Comput. Optim. Appl. 6, 1996.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.reductions import Reductions
from .linearization import Linearization
from .newton_systems import NewtonStep, NewtonSystem
from .scaled_problem import ScaledProblem, Step
from .steps import StepSettings, along_curve, step_length

_SHORT = 0.6
"""Length of a step below which nodes are held."""

_LEFT = 0.1
"""Part of its pressure that a held node keeps, over its lower bound."""

_THROUGH = 1.2
"""Part of its pressure that a node would lose in a full step, from which on it is held."""

_ROUNDS, _CORRECTORS = 4, 3

_LONG = 0.9
"""Length of a step from which on there are no correctors."""

_AHEAD = (1.08, 0.3)
"""The length at which products are looked at: this times that of the step, and this more; at most 1 (Gondzio)."""

_WITHIN = (0.1, 10.0)
"""Bounds of products at that length over their target (Gondzio)."""

_GAIN = 0.1
"""Part of the way to that length that a corrector has to gain (Gondzio)."""

_STIFF = 1e-6
"""D22 of a held pressure over the reciprocal of diag(A)."""


def longer(
    settings: StepSettings, scaled: ScaledProblem, newton: NewtonSystem, step: Step, target: float, beta: float
) -> Step:
    """The step to nu_i z_i = target, corrected where that lengthens it; collective.

    Args:
        settings: Those of `step_length`.
        scaled: The problem.
        newton: The Newton systems, the last of which gave the step; without an approximation of A nothing is changed.
        step: The step.
        target: nu_i z_i at its end.
        beta: Bound of the gradient over theta.
    """
    return _Correction(settings, scaled, newton, step, target, beta).done()


class _Correction:
    """A step and its length, made longer."""

    def __init__(
        self,
        settings: StepSettings,
        scaled: ScaledProblem,
        newton: NewtonSystem,
        step: Step,
        target: float,
        beta: float,
    ):
        self._settings, self._scaled, self._newton, self._beta = settings, scaled, newton, beta
        self._over = Reductions(scaled.A.comm)
        self._v, self._target, self._at = step.v, target, scaled.linearize(step.v)
        self._above = step.v.x_n - scaled.lower
        self._sigma = target / scaled.theta(step.v.nu, scaled.slack(step.v.x_n, step.v.y))
        self._step, self._alpha = step, self._length(step)

    def done(self) -> Step:
        """The longest step found."""
        if self._alpha < _SHORT:
            self._hold()
        for _ in range(_CORRECTORS):
            if self._alpha > _LONG or not self._centre():
                break
        return self._step

    def _length(self, step: Step) -> float:
        """How far a step goes; 0 if it is not possible at all."""
        alpha, new = step_length(self._settings, self._scaled, step, self._beta, self._sigma)
        return 0.0 if new is None else alpha

    def _changed(self, step: Step, change: NewtonStep) -> Step:
        """A step with a change of its direction, A dx to the accuracy of the approximation of A."""
        at, r = self._at, self._at.r[:, None]
        dx_t = r * step.dy + (at.slope * step.dx_n)[:, None] * self._v.y
        whole = NewtonStep(
            np.column_stack([step.dx_n, dx_t]) + change.dx,
            step.dnu + change.dnu,
            step.A_dx + change.A_dx,
            step.iterations,
            step.dalpha + change.dalpha,
        )
        return along_curve(self._scaled, self._newton, self._v, at, whole)

    def _hold(self) -> None:
        """Hold nodes that would open."""
        first = trial = self._step
        held: npt.NDArray[np.bool_] = np.zeros(self._scaled.nodes, dtype=bool)
        for _ in range(_ROUNDS):
            released = held & (trial.dnu[:, 0] < -self._v.nu[:, 0])
            now = (held & ~released) | (trial.dx_n < -_THROUGH * self._above)
            if not self._over.any(bool(np.any(now != held))):
                return
            held = now
            change = self._newton.correction(*self._held(held, first.dx_n))
            if change is None:
                return
            trial = self._changed(first, change)
            alpha = self._length(trial)
            if alpha > self._alpha:
                self._step, self._alpha = trial, alpha

    def _held(self, held: npt.NDArray[np.bool_], dx_n: FloatArray) -> tuple[FloatArray, Linearization]:
        """Right-hand side (m, 2) and linearisation of the change after which held nodes keep `_LEFT`."""
        r2, D22 = np.zeros((len(held), 2)), self._at.D22.copy()
        D22[held, 0] = _STIFF / np.maximum(self._scaled.A.diagonal[held, 0], 1e-300)
        r2[held, 0] = (dx_n + (1.0 - _LEFT) * self._above)[held]
        return r2, replace(self._at, D22=D22)

    def _centre(self) -> bool:
        """A corrector; whether the step has become longer."""
        scaled, v, low, high = self._scaled, self._v, *(bound * self._target for bound in _WITHIN)
        ahead = min(1.0, _AHEAD[0] * self._alpha + _AHEAD[1])
        new = self._step.at(ahead)
        products = new.nu * scaled.slack(new.x_n, new.y)
        wanted = scaled.on_constraints(np.maximum(np.clip(products, low, high) - products, -high))
        change = self._newton.correction(-scaled.over_constraints(wanted, v.nu))
        if change is None:
            return False
        trial = self._changed(self._step, change)
        alpha = self._length(trial)
        if alpha < self._alpha + _GAIN * (ahead - self._alpha):
            return False
        self._step, self._alpha = trial, alpha
        return True
