"""The matrix of geometric terms along displacements, for their transpose: the adjoint of large motions.

Every row owes to a few nodes near it, so that differences along many nodes at once find all columns
(`nodes_together`), each of them twice `GeometricTerms.along`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import scipy.sparse

from ..arrays import FloatArray
from ..fem.meshes import boundary_facets
from ..linalg.reductions import Reductions
from ..solvers.derivatives import Change
from .discrete_problem import DiscreteProblem
from .geometric_terms import Terms
from .shape_gradient import by_colours, colours_of, nodes_beside, nodes_of_points, pattern

_RINGS: Final = 4
"""Rings of facets around the nodes of a row on which it depends at most."""

_OTHER: Final = 1e-5
"""Change of the rows by nodes on which they are not taken to depend, over the largest of their kind: gaps of pairs are
known to as much."""


_LARGE_FORCE: Final = 1e-4
"""Part of internal forces that counts as large: differences of these have rounding errors of 1e-10."""


class TransposedTerms:
    """Of the terms along displacements w (k, 3) of this rank's nodes.

    Args:
        problem: The linear problem at the answer.
        x: Its contact forces, newtons, shape (3 m,).
        along: Terms along w; collective.

    Raises:
        ValueError: On every rank, if they owe to nodes far away, or have a kink.
    """

    def __init__(self, problem: DiscreteProblem, x: FloatArray, along: Callable[[FloatArray], Terms]):
        body, over = problem.elasticity, Reductions(problem.comm)
        self._over, self._along, self._body = over, along, body
        extent = float(np.max(over.extent(body.x)))
        force = over.max(np.abs(x)) / extent
        beside = nodes_beside(problem, [(member, boundary_facets(member.body.domain)) for member in body.members])
        points = nodes_of_points(problem)
        before = problem.comm.exscan(len(problem.surface.nodes)) or 0
        own, first = slice(before, before + len(problem.surface.nodes)), body.numbering.first
        on_boundary = np.flatnonzero(np.diff(beside.indptr))
        way = np.zeros((body.numbering.total, 3))
        way[on_boundary] = np.random.default_rng(37).uniform(-1.0, 1.0, (len(on_boundary), 3))
        whole = self._stacked(way)
        internal = over.max(np.abs(body.internal_force(way[first : first + len(body.x)])).ravel())
        limits = np.maximum(self._sizes(whole), [max(force, _LARGE_FORCE * internal), 1.0, 1.0, force, force])

        def counts(stacked: FloatArray) -> bool:
            return bool(np.any(self._sizes(stacked) > _OTHER * limits))

        k, m = len(body.x), len(problem.surface.nodes)
        at_nodes, at_points = np.repeat(np.arange(k), 3), k + np.repeat(np.arange(m), 3)
        site = np.concatenate([at_nodes, at_nodes, at_points, k + np.arange(m), at_points])
        rows = points
        for _ in range(_RINGS):
            rows = pattern(rows @ beside)
            of_nodes = pattern(beside + points.T @ rows)
            sites = scipy.sparse.vstack([of_nodes[first : first + len(body.x)], rows[own]], format="csr")
            colours = colours_of(scipy.sparse.vstack([of_nodes, rows], format="csr"))
            matrix = by_colours(sites, site, colours, self._stacked, counts)
            if matrix is not None and not counts(whole - matrix @ way.ravel()):
                self._matrix = matrix
                return
        raise ValueError("gradients: what contact owes to the displacement is not of nodes near, or has a kink")

    def owed(self, load: FloatArray, prescribed: FloatArray, owed: Change, components: FloatArray) -> FloatArray:
        """What a function owes to w by the terms, shape (k, 3), from what it owes to load and prescribed displacements
        (k, 3), to the equations of contact and to forces along turning frames (m, 3); collective."""
        blocks = load, prescribed, -owed.b, owed.bound, components
        whole = self._over.total(self._matrix.T @ np.concatenate([block.ravel() for block in blocks]))
        first = self._body.numbering.first
        return whole.reshape(-1, 3)[first : first + len(self._body.x)]

    def _stacked(self, way: FloatArray) -> FloatArray:
        """The terms along a way of the nodes of all ranks: this rank's rows."""
        first = self._body.numbering.first
        change = self._along(way[first : first + len(self._body.x)])
        blocks = change.load, change.prescribed, change.c, change.bound, change.components
        self._ends = np.cumsum([block.size for block in blocks])[:-1]
        return np.concatenate([block.ravel() for block in blocks])

    def _sizes(self, stacked: FloatArray) -> FloatArray:
        """The largest entry of every kind over all ranks."""
        return np.array([max(self._over.max(np.abs(one)), 0.0) for one in np.split(stacked, self._ends)])
