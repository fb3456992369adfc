"""The master face of a pair: what acts there, and fields that are carried over to it from the contact points.

Forces on the master are exact: a force at a contact point acts on the nodes opposite by the weights of its row.
Pressures are not these forces over nodal areas, which vary from node to node with the ratio of the two meshes.  They
are those of the contact points, averaged with the weights transposed,

    p_j = sum_i W_ij p_i / sum_i W_ij,      W_ij = a_i |weight of node j in the average opposite to point i|
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import scipy.sparse

from ..arrays import FloatArray
from ..contact_fields import names
from ..fem.bodies import distributed_rows
from ..fem.contact import ContactPoints
from .nodal_answer import HELD, OPEN, SLIP, STICK

_TURNED = names(opposite="reversed")
"""Fields that are opposite on the master: what acts on it, and its motion against the slave."""

CARRIED = (*names(opposite="mean"), *_TURNED)
"""Fields of the contact points that are carried over; besides the status."""

Spread = Callable[[FloatArray], FloatArray]
"""Multiplies rows of contact points (m, d) by a transposed matrix: rows of nodes (k, d); collective."""


def carried(fields: Mapping[str, FloatArray], spread: Spread) -> dict[str, FloatArray]:
    """The fields at the nodes of the master; collective.

    A node is open where all contact points opposite are; else the larger share of those that touch decides between
    stick and slip.  Nodes without a contact point opposite have the status HELD, and 0 everywhere.

    Args:
        fields: At the contact points, shapes (m,) or (m, 3).
        spread: By the matrix W.
    """
    status = fields["status"]
    shares = spread(np.column_stack([status == code for code in (OPEN, STICK, SLIP)]).astype(float))
    total = shares.sum(axis=1)
    there = total > 0.0
    _, sticking, slipping = np.round(shares / np.where(there, total, 1.0)[:, None], 9).T  # equal ones always stick
    found: dict[str, FloatArray] = {}
    for name in CARRIED:
        values = fields[name].reshape(len(status), 3 if fields[name].ndim == 2 else 1)  # no -1: a rank may have none
        mean = spread(values) / np.where(there, total, 1.0)[:, None]
        mean = -mean if name in _TURNED else mean
        found[name] = mean.reshape(-1, *fields[name].shape[1:])
    touching = np.where(slipping > sticking, SLIP, STICK)
    found["status"] = np.where(there, np.where(shares[:, 1:].any(axis=1), touching, OPEN), HELD).astype(float)
    return found


def carrying(opposite: scipy.sparse.csr_matrix, area: FloatArray) -> scipy.sparse.csr_matrix:
    """W, from the weights opposite to contact points (m, nodes) with areas (m,) in m^2."""
    return (scipy.sparse.diags(area) @ abs(opposite)).tocsr()


def spreading(points: ContactPoints, matrix: scipy.sparse.csr_matrix) -> Spread:
    """Multiplication by the transpose of a matrix (m, nodes), of which every rank has the rows of its contact points;
    collective."""
    size = points.space.numbering

    def spread(values: FloatArray) -> FloatArray:
        product = np.zeros((size.local, values.shape[1]))
        distributed = distributed_rows(matrix, (size.local, size.total), points.space, None)
        at_nodes, at_points = distributed.createVecs()
        for column, found in zip(values.T, product.T, strict=True):
            at_points.array[:] = column
            distributed.multTranspose(at_points, at_nodes)
            found[:] = at_nodes.array_r
        for one in (at_nodes, at_points, distributed):
            one.destroy()
        return product

    return spread
