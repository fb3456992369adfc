"""The transpose of the geometric terms of rigid faces, bolts and loads that turn with their face.

They owe to all nodes of a face, by the few numbers of its motion.  Constraints u = c(v) that hold with forces lambda
have the terms lambda . c''(v), which are symmetric: of bolts the transpose is the same along another way.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Deformable, FiniteMotion
from ..linalg.reductions import Reductions

_STEP: Final = 1e-6
"""Displacement of the differences of bolts over the size of the bodies."""


def far_loads(body: Deformable, u: FloatArray) -> FloatArray:
    """The loads that turn with their face, and the springs of rigid faces, at a displacement u, newtons, shapes (k, 3);
    collective."""
    loads = sum((one.forces for one in body.constraints.spring_forces(u)), np.zeros_like(u))
    for member in body.members:
        for wrench in member.body.wrenches():
            loads[member.nodes] += wrench.forces
    return loads


class TurningTerms:
    """Of bodies at their deformed place.

    Args:
        body: The bodies, with the stiffness of the linear problem.
        following: The forces of constraints on nodes that follow, newtons, shape (k, 3).
    """

    def __init__(self, body: Deformable, following: FloatArray):
        self._body, self._following, self._over = body, following, Reductions(body.comm)
        constraints, x, none = body.constraints, body.x, np.zeros_like(body.x)
        self._faces = list[tuple[FiniteMotion, FloatArray, FloatArray]]()
        for motion in constraints.motions:
            if isinstance(motion, FiniteMotion):
                ways, rates = np.zeros((6, *x.shape)), np.zeros((6, 6))
                ways[:, motion.nodes] = np.moveaxis(motion.of_components(x), 2, 0)
                rates[3:, 3:] = motion.moment_rates(following, (), body.comm)
                pulls = [motion.pull_rate(x, way, body.comm) for way in ways] if motion in constraints.sprung else none
                self._faces.append((motion, rates, np.array(pulls)))
        self._loads = [(member.nodes, *one) for member in body.members for one in member.body.turning_loads()]

    def owed(self, v: FloatArray) -> FloatArray:
        """What a function owes to displacements by these terms, from what it owes to forces, shapes (k, 3);
        collective."""
        over, body = self._over, self._body
        whole = body.reduction.bent_force(v) - body.constraints.spring_force(v) + self._of_bolts(v)
        for motion, rates, pulls in self._faces:
            along = over.total(np.einsum("mcp,mc->p", motion.spread, v[motion.nodes]))
            pulled = over.total(np.einsum("...kc,kc->...", pulls, v))
            whole[motion.nodes] += motion.spread @ (pulled - rates.T @ along)
        for nodes, at, forces, rotations in self._loads:
            turned = over.total(np.einsum("kce,kc->e", forces, v[nodes]))
            whole[nodes][at] += rotations @ turned
        return whole

    def _of_bolts(self, v: FloatArray) -> FloatArray:
        body, over = self._body, self._over
        constraints, reduction, x = body.constraints, body.reduction, body.x
        size = over.max(np.abs(v).ravel())
        if not constraints.bolts or size == 0.0:
            return np.zeros_like(v)
        extent = float(np.max(over.extent(x)))
        h, u = _STEP * extent / size, x - body.reference
        bolts = np.zeros(reduction.width)
        bolts[[own for _, own in constraints.of_bolts]] = 1.0

        def at(step: float) -> FloatArray:
            there = constraints.at_place(x + step * v, u + step * v).reduction
            along = bolts * there.moved_transposed(self._following)
            return there.on_followed(self._following) - reduction.on_followed(reduction.amounts_transposed(along))

        return (at(h) - at(-h)) / (2.0 * h)
