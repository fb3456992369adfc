"""The functions of the contact forces on a slave face: dual ones, or hats.

On every slave facet they are combinations of its functions N (of the vertices' linear functions on 6-node triangles),

    lambda_j = sum_k Lambda_jk N_k,        sum_j lambda_j = 1

Dual (biorthogonal, Wohlmuth 2000): int lambda_j N_k = delta_jk int N_k, so Lambda = diag(M 1) M^-1 with the
mass matrix M of the facet.  Where the other face covers a facet in part, the functions of the covered part would be
extrapolations from it; hats, linear ones, are used there: they are positive, as is what they weigh.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from .facet_patch import FacetPatch
from .mortar_segments import Segments

Basis = Literal["dual", "hats"]

_FULL = 0.999
"""Covered share from which a facet counts as wholly covered."""

_LEAST_COVERED = 1e-6
"""Covered share of a facet below which it counts as uncovered."""


def multipliers(slave: FacetPatch, parts: Segments, basis: Basis) -> FloatArray:
    """Lambda of every facet, shape (f, multipliers of a facet, n); zero where a facet is uncovered."""
    kind = slave.kind
    count = len(slave.multiplier_columns)
    span = np.eye(kind.width) if kind.width != 6 else kind.vertex_functions
    corner = np.zeros((count, kind.width))
    corner[: kind.corners] = kind.vertex_functions
    covered, full = parts.share > _LEAST_COVERED, parts.share > _FULL
    found = np.zeros((len(slave), count, kind.width))
    found[covered] = corner
    if basis == "hats":
        found[full] = span
        return found
    mass = span @ parts.mass[full] @ span.T
    sizes = mass.sum(axis=2)
    found[full] = sizes[:, :, None] * np.linalg.solve(mass, np.broadcast_to(span, (len(mass), *span.shape)))
    return found


def without(
    found: FloatArray, nodes: npt.NDArray[np.int64], sizes: FloatArray, left_out: npt.NDArray[np.bool_]
) -> FloatArray:
    """Lambda with the functions of some nodes added to those of the others of the facet: their sum stays 1.

    Args:
        found: Lambda, shape (f, j, n).
        nodes: The nodes of the multipliers of every facet, shape (f, j).
        sizes: Integrals of the functions, shape (f, j).
        left_out: Which nodes have no multiplier, shape (nodes of all ranks,).
    """
    gone = left_out[nodes]
    touched = np.any(gone, axis=1)
    weight = np.where(gone[touched], 0.0, np.maximum(sizes[touched], 0.0))
    total = weight.sum(axis=1, keepdims=True)
    weight = np.divide(weight, total, out=np.zeros_like(weight), where=total > 0.0)
    given = np.where(gone[touched][:, :, None], found[touched], 0.0)
    result = found.copy()
    result[touched] = found[touched] - given + weight[:, :, None] * given.sum(axis=1, keepdims=True)
    return result
