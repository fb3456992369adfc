"""Which of two faces carries the contact points: the slave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from .. import compat
from ..bodies import Deformable, SingleBody
from ..geometry import HELD_BEYOND, held_length

_AS_NEAR = 1e-9
"""Distances that differ by less than this part of the coordinates are the same."""


def lost_nodes(
    points: Mapping[int, tuple[npt.NDArray[np.integer[Any]], FloatArray]], count: int, size: float
) -> dict[int, npt.NDArray[np.bool_]]:
    """Which of `count` nodes every pair loses to another, by the number of the pair: a node counts at the nearest
    master, of equally near ones at that of the first pair.

    Args:
        points: By the number of the pair the nodes of its contact points and their gaps in metres, each of shape (m,).
        count: How many nodes there are.
        size: Largest coordinate, metres.
    """
    distance = np.full((len(points), count), np.inf)
    for row, (nodes, gap) in zip(distance, points.values(), strict=True):
        row[nodes] = np.abs(gap)
    near = distance <= np.min(distance, axis=0) + _AS_NEAR * size
    first = np.argmax(near, axis=0)
    return {number: np.isfinite(distance[k]) & (first != k) for k, number in enumerate(points)}


_FINER = 1.2
"""Ratio of the distances of nodes from which one face is finer than the other."""

_SOFTER = 1.5
"""Ratio of stiffnesses from which one body is softer than the other."""

_STRAINS = np.zeros((5, 3, 3))
for _k in range(3):
    _STRAINS[_k, _k, _k - 1] = _STRAINS[_k, _k - 1, _k] = 1.0
_STRAINS[3:] = np.diag([1.0, -1.0, 0.0]), np.diag([0.0, 1.0, -1.0])
"""Strains without change of volume."""


@dataclass(frozen=True)
class _Side:
    """A face, over all ranks: mean distance of its contact points if it were the slave, nodes or vertices of 10-node
    tetrahedra, in metres; and the share of its nodes whose displacement along the normal is prescribed."""

    spacing: float
    clamped: float


def slave_side(elasticity: Deformable, face: str, against: str) -> tuple[str, str, str]:
    """Slave and master of a pair of faces, and why; ValueError on every rank if a face is unknown; collective.

    The finer face is the slave, since its nodes are the contact points; of faces as fine that of the softer body.  A
    face that is mostly clamped has too few.
    """
    one, other = _side(elasticity, face), _side(elasticity, against)
    mostly = one.clamped > 0.5, other.clamped > 0.5
    if mostly[0] != mostly[1]:
        exchanged, why = mostly[0], "the other face is clamped"
    elif max(one.spacing, other.spacing) > _FINER * min(one.spacing, other.spacing):
        exchanged, why = other.spacing < one.spacing, "it has the finer mesh"
    else:
        stiffness = [_stiffness(elasticity, name) for name in (face, against)]
        softer = max(stiffness) > _SOFTER * min(stiffness)
        exchanged, why = (
            softer and stiffness[1] < stiffness[0],
            "its body is softer" if softer else "it was named first",
        )
    return (against, face, why) if exchanged else (face, against, why)


def clamped_nodes(body: SingleBody, facets: npt.NDArray[np.int32]) -> npt.NDArray[np.int64]:
    """This rank's nodes on facets whose displacement along the normal is prescribed; collective."""
    nodes, outward = body.nodes_of(facets), body.positive_weights(facets)[1]
    n: FloatArray = outward[nodes]
    n /= np.maximum(np.linalg.norm(n, axis=1), 1e-300)[:, None]
    return nodes[held_length(n, body.held.projector_at(nodes)) > HELD_BEYOND].astype(np.int64)


def _side(elasticity: Deformable, face: str) -> _Side:
    member, facets = elasticity.face(face, "contact")
    body, nodes = member.body, member.body.nodes_of(facets)
    points = np.intersect1d(nodes, body.vertices.node).size if not body.positive else len(nodes)
    mine = [len(nodes), points, body.area_of(facets).sum(), len(clamped_nodes(body, facets))]
    count, number, area, clamped = elasticity.comm.allreduce(np.array(mine, dtype=np.float64), op=MPI.SUM)
    return _Side(float(np.sqrt(area / max(number, 1.0))), float(clamped / max(count, 1.0)))


def _stiffness(elasticity: Deformable, face: str) -> float:
    """Twice the shear modulus of a body at a face, in pascals, whatever its mesh, and also of the user's forms;
    collective.

    A uniform strain without change of volume, A, has the stress 2 mu A and the nodal forces 2 mu A n, n the integral of
    the outward normal against the hat functions.  Of anisotropic materials it is a mean over five strains.
    """
    member, facets = elasticity.face(face, "contact")
    body, nodes = member.body, member.body.nodes_of(facets)
    body.domain.topology.create_connectivity(2, 3)
    outward = body.normal_of(compat.mesh.exterior_facet_indices(body.domain.topology).astype(np.int32))[nodes]
    work = np.zeros(2)
    for A in _STRAINS:
        forces, expected = body.internal_force(body.x @ A)[nodes], outward @ A
        work += np.vdot(forces, expected), np.vdot(expected, expected)
    done, of_unit = elasticity.comm.allreduce(work, op=MPI.SUM)
    return float(done / (of_unit or 1.0))
