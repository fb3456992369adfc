"""The functions of the contact forces on a slave face: dual ones, or hats.

On every slave facet they are combinations of its functions N (of the vertices' linear functions on 6-node triangles),

    lambda_j = sum_k Lambda_jk N_k,        sum_j lambda_j = 1

Dual (biorthogonal, Wohlmuth 2000): int lambda_j N_k = delta_jk int N_k, so Lambda = diag(M 1) M^-1 with the
mass matrix M of the facet, of the covered part of a partly covered one (Cichosz and Bischoff 2011).  The quadratic
functions of 9-node quadrilaterals have positive integrals, so theirs are dual as they are; those of 6-node triangles
have not (Popp, Wohlmuth, Gee and Wall 2012).

Measured on an aluminium block on a steel one, 19 to 121 contact points, all kinds of elements, sticking and sliding
with F = 0.3; the pressure under the middle of a block that is wholly on the other, and under all of one that is not:

                                      condition of A    Newton steps    smallest to largest pressure, MPa
    dual                              6e1 to 3e2        9 to 14         14 to 16
    hats                              6e2 to 4e3        12 to 17        10 to 20
    partly covered: dual there too    5e1 to 3e2        10 to 13        11 to 170
    hats there, dual elsewhere        9e1 to 3e3        11 to 17        0 to 420
    hats everywhere                   5e2 to 9e3        11 to 17        0 to 370

So dual functions it is, also on partly covered facets, unless the part is so small that they are extrapolations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ...arrays import FloatArray, IntArray
from .facet_patch import FacetPatch
from .mortar_segments import Segments

Basis = Literal["dual", "hats"]

_LEAST_DUAL = 0.05
"""Covered share of a facet below which its functions are hats, linear ones: those of the corners."""

_WHOLE = 0.999
"""Covered share from which a facet counts as wholly covered: hats of second order are positive in the mean there."""

_LEAST_COVERED = 1e-6
"""Covered share of a facet below which it counts as uncovered."""


def multipliers(slave: FacetPatch, parts: Segments, basis: Basis) -> FloatArray:
    """Lambda of every facet, shape (f, multipliers of a facet, n); zero where a facet is uncovered."""
    kind = slave.kind
    count = len(slave.multiplier_columns)
    span = np.eye(kind.width) if kind.width != 6 else kind.vertex_functions
    corner = np.zeros((count, kind.width))
    corner[: kind.corners] = kind.vertex_functions
    covered, full = parts.share > _LEAST_COVERED, parts.share > (_LEAST_DUAL if basis == "dual" else _WHOLE)
    found = np.zeros((len(slave), count, kind.width))
    found[covered] = corner
    if basis == "hats":
        found[full] = span
        return found
    mass = span @ parts.mass[full] @ span.T
    sizes = mass.sum(axis=2)
    found[full] = sizes[:, :, None] * np.linalg.solve(mass, np.broadcast_to(span, (len(mass), *span.shape)))
    return found


@dataclass(frozen=True)
class Pieces:
    """The functions lambda_j, on every facet a combination of its functions.

    Attributes:
        facet: Facet of each piece, shape (k,).
        node: The node j that its lambda_j stands for, shape (k,).
        coefficients: Of the facet's functions, shape (k, n).
        lost: Facets before the master on which there is no lambda_j, since all nodes near are left out; shape (l,).
    """

    facet: IntArray
    node: IntArray
    coefficients: FloatArray
    lost: IntArray


def pieces(
    slave: FacetPatch, nodes: IntArray, found: FloatArray, sizes: FloatArray, left_out: npt.NDArray[np.bool_]
) -> Pieces:
    """The functions of all nodes but some, whose functions are added to others: the sum of all stays 1.

    The others are those of the same facet; if it has none, the nearest one of the facets that it shares nodes with.

    Args:
        slave: The facets.
        nodes: The nodes of the multipliers of every facet, shape (f, j).
        found: Lambda, shape (f, j, n).
        sizes: Integrals of the functions, shape (f, j).
        left_out: Which nodes have no multiplier, shape (nodes of all ranks,).
    """
    covered, gone = np.any(sizes > 0.0, axis=1), left_out[nodes] | (sizes <= 0.0)
    own = np.flatnonzero(covered & ~np.all(gone, axis=1))
    weight = np.where(gone[own], 0.0, sizes[own])
    weight /= weight.sum(axis=1, keepdims=True)
    given = np.where(gone[own][:, :, None], found[own], 0.0).sum(axis=1, keepdims=True)
    kept = np.where(gone[own][:, :, None], 0.0, found[own] + weight[:, :, None] * given)
    row, j = np.nonzero(~gone[own])
    bare = np.flatnonzero(covered & np.all(gone, axis=1))
    standing = np.zeros(slave.size, dtype=bool)
    standing[nodes[own[row], j]] = True
    target = _nearest(slave, nodes, bare, standing)
    facet = np.concatenate([own[row], bare[target >= 0]])
    node = np.concatenate([nodes[own[row], j], target[target >= 0]])
    one = np.ones((int(np.count_nonzero(target >= 0)), slave.kind.width))
    return Pieces(facet, node, np.concatenate([kept[row, j], one]), bare[target < 0])


def _nearest(slave: FacetPatch, nodes: IntArray, bare: IntArray, standing: npt.NDArray[np.bool_]) -> IntArray:
    """For some facets, the nearest of these nodes among those of the facets that they share nodes with; -1 if none."""
    facets, width = nodes.shape
    ones = np.ones(facets * width)
    on = scipy.sparse.csr_matrix((ones, nodes.ravel(), np.arange(0, facets * width + 1, width)), (facets, slave.size))
    around = (on[bare] @ on.T @ on).tocoo()
    candidate = standing[around.col]
    row, node = around.row[candidate], around.col[candidate].astype(np.int64)
    x = np.zeros((slave.size, 3))
    x[slave.nodes] = slave.x
    away = np.linalg.norm(x[node] - slave.x[bare].mean(axis=1)[row], axis=1)
    order = np.lexsort((node, away, row))
    first, at = np.unique(row[order], return_index=True)
    target = np.full(len(bare), -1, dtype=np.int64)
    target[first] = node[order][at]
    return target
