"""Which of two faces carries the contact points: the slave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from .contact_frames import HELD_BEYOND, held_length
from .deformable import Deformable, SingleBody

_FINER = 1.2
"""Ratio of the distances of nodes from which one face is finer than the other."""

_SOFTER = 1.5
"""Ratio of stiffnesses from which one body is softer than the other."""


@dataclass(frozen=True)
class _Side:
    """A face, over all ranks.

    Attributes:
        spacing: Mean distance of its nodes in metres.
        stiffness: Of the body there, pascals: the mean diagonal of K over the distance of nodes.
        clamped: Share of its nodes whose displacement along the normal is prescribed.
    """

    spacing: float
    stiffness: float
    clamped: float


def slave_side(elasticity: Deformable, face: str, against: str) -> tuple[str, str, str]:
    """Slave and master of a pair of faces, and why; collective.

    The finer face is the slave, since its nodes are the contact points; of faces as fine that of the softer body.  A
    face that is mostly clamped has too few.

    Raises:
        ValueError: On every rank, if a face is unknown.
    """
    one, other = _side(elasticity, face), _side(elasticity, against)
    mostly = one.clamped > 0.5, other.clamped > 0.5
    if mostly[0] != mostly[1]:
        exchanged, why = mostly[0], "the other face is clamped"
    elif max(one.spacing, other.spacing) > _FINER * min(one.spacing, other.spacing):
        exchanged, why = other.spacing < one.spacing, "it has the finer mesh"
    elif max(one.stiffness, other.stiffness) > _SOFTER * min(one.stiffness, other.stiffness):
        exchanged, why = other.stiffness < one.stiffness, "its body is softer"
    else:
        exchanged, why = False, "it was named first"
    return (against, face, why) if exchanged else (face, against, why)


def clamped_nodes(body: SingleBody, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
    """This rank's nodes on facets whose displacement along the normal is prescribed; collective."""
    nodes, outward = body.nodes_of(facets), body.positive_weights(facets)[1]
    n: FloatArray = outward[nodes]
    n /= np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]
    clamped: npt.NDArray[np.int64] = nodes[held_length(n, body.held.projector_at(nodes)) > HELD_BEYOND].astype(np.int64)
    return clamped


def _side(elasticity: Deformable, face: str) -> _Side:
    member, facets = elasticity.face(face, "contact")
    body, comm = member.body, elasticity.comm
    nodes, diagonal = body.nodes_of(facets), body.K.getDiagonal()
    free = ~body.fixed[nodes]
    stiff = diagonal.array_r.reshape(-1, 3)[nodes][free]
    diagonal.destroy()
    mine = [len(nodes), body.area_of(facets).sum(), stiff.sum(), stiff.size, len(clamped_nodes(body, facets))]
    count, area, sum_of_K, entries, clamped = comm.allreduce(np.array(mine, dtype=np.float64), op=MPI.SUM)
    spacing = float(np.sqrt(area / max(count, 1.0)))
    mean = sum_of_K / entries if entries else np.inf
    return _Side(spacing, float(mean / (spacing or 1.0)), float(clamped / max(count, 1.0)))
