"""What sectors of cyclic symmetry must share: rigid faces and supports that reach the cuts go on in the neighbours."""

from __future__ import annotations

from typing import Final

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ...nearest import tree_of
from ..bodies import Deformable, Loading
from .ties import CyclicSymmetry

_EVEN: Final = 1e-9
"""Part of a motion of a rigid face that is a rounding error beside motions along and about the axis."""

_SAME_NODE: Final = 1e-6
"""Distance of nodes of the two cut faces, one turned onto the other, over their extent, up to which they are one."""

_TURNED: Final = 0.75
"""Part of the sector's angle by which directions that supports hold at the same node may differ: normals of the facets
on one side of a cut do by one facet's angle."""

_ALONG: Final = 1e-2
"""Part of prescribed displacements along the axis by which they may differ there, as normals of a cone do."""

_HELD: Final = 1e-6
"""Displacements over the largest on the cut below which nodes, as those on the axis, are held at rest."""


def refuse_uneven_sectors(body: Deformable) -> None:
    """Refuse rigid faces that reach the cut faces of a sector, so are one with those of its neighbours, and move
    otherwise than along the axis and about it; collective.

    Raises:
        ValueError: On every rank.
    """
    ties = body.constraints.every
    for cut in (one for one in body.constraints.given if isinstance(one, CyclicSymmetry)):
        on_cut = np.zeros(len(body.x), dtype=bool)
        for name in (cut.face, cut.against):
            member, facets = body.face(name, cut.kind)
            on_cut[member.nodes.start + member.body.nodes_of(facets)] = True
        axis, start = np.array(cut.axis) / np.linalg.norm(cut.axis), np.array(cut.point, dtype=np.float64)
        for tie, motion in ((tie, tie.motion) for tie in ties if tie.motion is not None):
            ways = np.column_stack([motion.motions, motion.given_part])
            along, about = np.cross(axis, ways[3:].T), ways[3:].T
            moved = ways[:3].T + np.cross(about, start - motion.place)  # a point of the axis
            size = np.linalg.norm(ways[:3], axis=0) + np.linalg.norm(about, axis=1) * np.max(
                np.abs(body.x), initial=0.0
            )
            uneven = np.linalg.norm(np.cross(axis, moved), axis=1) > _EVEN * size
            uneven |= np.linalg.norm(along, axis=1) > _EVEN * np.linalg.norm(about, axis=1)
            if body.comm.allreduce(bool(np.any(uneven) and np.any(on_cut[tie.nodes])), op=MPI.LOR):
                place = ", ".join(f"{value:.4g}" for value in start + axis * (axis @ (motion.place - start)))
                raise ValueError(
                    f"rigid face {tie.face!r}: reaches the cut faces of the {cut.what}, where those of the other "
                    "sectors go on: together they move along the axis and turn about it alone; prescribe translations "
                    f"and rotations across it as 0, and give a point on it, as [{place}]"
                )


def refuse_uneven_supports(body: Deformable, loading: Loading) -> None:
    """Refuse supports that hold nodes of one cut face of a sector otherwise than the same nodes of the other, turned;
    collective.

    Nodes without one at the same place of the other face are not compared.

    Raises:
        ValueError: On every rank.
    """
    for cut in (one for one in body.constraints.given if isinstance(one, CyclicSymmetry)):
        (x, held, given), (x2, held2, given2) = (_on_cut(body, loading, cut, name) for name in (cut.face, cut.against))
        turn = cut.turn(x2.mean(axis=0), x.mean(axis=0))
        R, axis = turn.matrix, turn.axis
        distance, there = tree_of(turn.point + (x2 - turn.point) @ R.T).query(x)
        held2, given2 = R @ held2[there] @ R.T, given2[there] @ R.T
        angle, apart = 2.0 * np.pi / cut.sectors, np.einsum("kij,kj->ki", held, given - given2)
        uneven = np.linalg.norm(held - held2, axis=(1, 2)) > _TURNED * np.sqrt(2.0) * np.sin(min(angle, np.pi / 2.0))
        along = np.outer(axis, axis)
        for part, limit in ((along, _ALONG), (np.eye(3) - along, _TURNED * 2.0 * np.sin(angle / 2.0))):
            sizes = np.linalg.norm([given @ part, given2 @ part], axis=2).max(axis=0)
            uneven |= np.linalg.norm(apart @ part, axis=1) > limit * (sizes + _HELD * np.max(sizes, initial=0.0))
        uneven &= distance < _SAME_NODE * np.linalg.norm(np.ptp(x, axis=0))
        if np.any(uneven):
            k = int(np.argmax(np.where(uneven, np.linalg.norm(np.cross(axis, x - turn.point), axis=1), -1.0)))
            place, other = (", ".join(f"{value:.4g}" for value in of) for of in (x[k], x2[there[k]]))
            raise ValueError(
                f"{cut.what}: at time {loading.time:g} supports hold the node at [{place}] otherwise than its image on "
                f"{cut.against!r}, at [{other}], turned by {np.degrees(angle):.4g} degrees: what holds one sector "
                "holds all of them: along the axis, along the radius and around it, as a direction or a displacement "
                "that is a function of place"
            )


def _on_cut(body: Deformable, loading: Loading, cut: CyclicSymmetry, face: str) -> tuple[FloatArray, ...]:
    """Of the nodes of a cut face on all ranks: places (q, 3), the projectors of supports (q, 3, 3), and what they
    prescribe (q, 3), metres; collective."""
    member, facets = body.face(face, cut.kind)
    nodes = member.body.nodes_of(facets)
    here = member.nodes.start + nodes
    parts = member.body.x[nodes], member.body.held.projector_at(nodes), loading.prescribed[here]
    return tuple(np.concatenate(body.comm.allgather(part)) for part in parts)
