"""Forces and moments on every component of every body: part of the certificate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..fem.bodies import null_space, of_part, rigid_modes
from ..linalg.reductions import Reductions
from .evidence import Evidence

EPSILON = 2.0**-52
"""Rounding unit of double precision."""

ROUNDING = 1e8
"""No scale is less than this multiple of the rounding error, so that a hundred rounding errors are within LIMIT."""

_OF_ALL = 1e-3
"""The forces on a component are judged by no less than this part of those on all."""


def rigid_balance(e: Evidence, outer: FloatArray, length: float, turnover: float) -> tuple[float, float, int]:
    """Imbalance of three forces and three moments of every component; for free rigid motions, relative to the springs.

    A rigid motion causes no internal force, except in an elastic foundation that is part of the internal forces.  The
    work of springs and such foundations on a motion is that of their forces in the motion (`Evidence.ground`) on the
    displacement.  If no prescribed displacement prevents it, only they do, and their forces may be a millionth of the
    internal forces.  So the forces along such a motion are compared with those of the springs, or with those
    that they would have for a motion by the scale of displacements.  If they do not resist it either, contact does:
    then they are compared with all forces.

    Args:
        e: Evidence; of the contact only the forces at the nodes are used.
        outer: Loads, forces of springs, reactions, contact forces on the body in newtons, shape (4, k, 3).
        length: Scale of displacements in metres.
        turnover: Sum of the magnitudes of the outer forces of all nodes, at least the effect of rounding, newtons.

    Returns:
        Largest of six sums over the sum of all forces, and the largest imbalance of a free motion over its spring
        forces, of all components; and their number; collective.
    """
    over = Reductions(e.comm)
    parts = _parts(e, over)
    found = [_of_part(e, here, outer, length, turnover) for here in parts]
    return worst(*(balance for balance, _ in found)), worst(*(drift for _, drift in found)), len(parts)


def _parts(e: Evidence, over: Reductions) -> list[npt.NDArray[np.bool_]]:
    """The nodes of each component of the meshes, shapes (k,); of each body if the components are not known."""
    component = e.component
    if component is None:
        component = np.zeros(len(e.x), dtype=np.int64)
        for number, nodes in enumerate(e.bodies):
            component[nodes] = number
    return [component == number for number in range(1 + int(over.max(component.astype(np.float64))))]


def _of_part(
    e: Evidence, here: npt.NDArray[np.bool_], outer: FloatArray, length: float, turnover: float
) -> tuple[float, float]:
    """The same of one component: no forces of its own judge it that are less than a part of `turnover`."""
    over = Reductions(e.comm)
    if over.all(bool(np.all(here))):
        x, u, spring, held = e.x, e.displacement, e.spring, e.held
    else:
        x, u, spring, outer, held = e.x[here], e.displacement[here], e.spring[here], outer[:, here], e.held.of(here)
        own = worst(sum(over.sum(lengths(part)) for part in outer), ROUNDING * over.sum(lengths(e.rounding[here])))
        turnover = worst(own, _OF_ALL * turnover)
    count, modes = over.sum(float(len(x))), rigid_modes(x, e.comm)
    rows = modes.reshape(-1, modes.shape[2])  # products of matrices take a tenth of the time of sums over nodes
    sums = rows.T @ outer.sum(axis=0).ravel()
    ground = None if e.ground is None else of_part(e.ground, e.x, here, e.comm)
    if ground is not None:  # in place of the springs' forces, and as the work of the internal forces on the motions
        sums -= rows.T @ spring.ravel() + ground.reshape(rows.shape).T @ u.ravel()
    sums = over.total(sums)
    balance = ratio(worst(*np.abs(sums)), turnover)

    prevented = rows[_rows_of(held.nodes)]
    weights = over.total(prevented.T @ held.held_part(modes)[held.nodes].reshape(prevented.shape))
    stiffness, resisted = _resistance(over, rows, ground)
    if not (np.all(np.isfinite(sums)) and np.all(np.isfinite(weights)) and np.all(np.isfinite(stiffness))):
        return balance, math.nan
    free = null_space(weights, 1e-13 * count)
    if not free.shape[1]:
        return balance, 0.0
    loose = free @ null_space(free.T @ resisted @ free, 1e-10 * worst(float(np.trace(resisted)), 1.0))
    free = _besides(free, loose)
    stiff, vectors = np.linalg.eigh(free.T @ stiffness @ free)
    free = free @ vectors  # motions that the springs hold independently of each other
    carried = np.zeros(free.shape[1])
    if ground is not None:
        carried = over.total(np.einsum("kcj,kc->j", np.abs(ground @ free), np.abs(u)))
    drifts = [
        ratio(force, worst(carries, k * length) or turnover)
        for force, carries, k in zip(np.abs(free.T @ sums), carried, stiff, strict=True)
    ]
    return balance, worst(0.0, *drifts, *(ratio(force, turnover) for force in np.abs(loose.T @ sums)))


def _rows_of(nodes: npt.NDArray[np.integer[Any]]) -> npt.NDArray[np.integer[Any]]:
    """The three rows of each node."""
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def _resistance(over: Reductions, rows: FloatArray, ground: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Stiffness of springs and elastic foundations against the motions, and the same with forces over the largest of
    them, shapes (6, 6); collective.

    Args:
        over: The ranks.
        rows: The motions, shape (3 k, 6).
        ground: Forces of springs and foundations in the motions, shape (k, 3, 6); None without any.
    """
    stiffness, resisted = np.zeros((2, rows.shape[1], rows.shape[1]))
    if ground is not None:
        forces = ground.reshape(rows.shape)
        stiffness = rows.T @ forces
        resisted = rows.T @ (forces / (over.max(np.abs(ground)) or 1.0))
    return over.total(stiffness), over.total(resisted)


def _besides(free: FloatArray, loose: FloatArray) -> FloatArray:
    """Orthonormal motions among `free` (6, q) that are orthogonal to `loose` (6, p) among them, shape (6, q - p)."""
    left, _, _ = np.linalg.svd(free - loose @ (loose.T @ free), full_matrices=False)
    besides: FloatArray = left[:, : free.shape[1] - loose.shape[1]]
    return besides


def lengths(vectors: FloatArray) -> FloatArray:
    """Norms of vectors (k, 3) without overflow or underflow of squares."""
    largest = float(np.max(np.abs(vectors), initial=0.0))
    if 1e-100 < largest < 1e100:  # no square overflows, and those that vanish do not count: a fifth of the time
        norms: FloatArray = np.sqrt(np.einsum("ki,ki->k", vectors, vectors))
        return norms
    norms = np.hypot(np.hypot(vectors[:, 0], vectors[:, 1]), vectors[:, 2])
    return norms


def worst(*values: float) -> float:
    """The largest, nan if one is nan."""
    return float(np.max(values))


def ratio(value: float, scale: float) -> float:
    """A measure over its scale, which is 0 only if the measure is."""
    return value / (scale or 1.0)
