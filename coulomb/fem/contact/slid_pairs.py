"""Pairs of deformable faces after a small displacement: what contact forces, gaps and slip owe to it.

The same facets are integrated anew (`mortar`); nothing is looked for, refused or remarked.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import FloatArray, IntArray
from ..bodies import Deformable, Member
from ..geometry import FrictionAxes, on_all_ranks
from ..meshes import fetched, starts_of
from .contact_points import ContactPoints, among_all, contact_matrix, places_among
from .facet_patch import FacetPatch
from .mortar import mortar_rows
from .near_facets import NearFace
from .pair import Pair, numbered, planes_of_symmetry, within
from .surface import ContactSurface


def slid_surface(
    elasticity: Deformable,
    pair: Pair,
    axes: FrictionAxes | None,
    u: FloatArray,
    given: FloatArray,
) -> ContactSurface:
    """The contact points of a pair after small displacements u (k, 3) of this rank's nodes, with gaps `given` at the
    points of the pair (m,), both in metres; forces act on all displacements, held ones as well; collective."""
    comm, near = elasticity.comm, pair.near
    slave, master = (elasticity.face(name, "contact")[0] for name in (pair.face, pair.against))
    one, other = _displaced(near.slave, slave, u), _displaced(near.master, master, u)
    rows = on_all_ranks(
        lambda: mortar_rows(one, other, near.owned, pair.left_out, near.search, False, near.most),
        f"contact face {pair.face!r}",
        comm,
    )
    body, numbering = slave.body, slave.body.numbering
    local = (near.slave.numbers[rows.node] - numbering.first).astype(np.int32)
    weights = numbered(rows.weights, near.slave, numbering.total)
    theirs = among_all(numbered(rows.opposite, near.master, master.body.numbering.total), master, elasticity)
    points = replace(ContactPoints(body, local, rows.area, weights, False).of(slave, elasticity), opposite=theirs)
    part = np.zeros(len(local), dtype=np.int64)
    place = places_among((points.nodes, part), (pair.points.nodes, np.zeros(len(pair.x), dtype=np.int64)))
    if pair.points.mirrored is not None:
        points = replace(points, mirrored=_of_known(pair.points.mirrored, place))
    held, added = body.held.projector_at(local), _of_known(given, place)
    n = within(rows.normal, planes_of_symmetry(rows.normal, held, rows.node, one))
    frames = points.frames(axes, n, held, rows.x, pair.face, u)
    B, chord = contact_matrix(points, frames), np.zeros_like(rows.x)
    gap = rows.gap(n) + added
    return ContactSurface((pair.face,), part, points, rows.x, frames, gap, added, B, B, False, (None,), chord)


def _displaced(face: NearFace, member: Member, u: FloatArray) -> FacetPatch:
    """The facets of a face of a body after displacements u (k, 3) of the nodes of all bodies; collective."""
    comm, patch = member.body.comm, face.patch
    way = fetched(comm, starts_of(comm, member.body.numbering.local), face.numbers, u[member.nodes])
    return replace(patch, x=patch.x + way[patch.nodes])


def _of_known(values: FloatArray, place: IntArray) -> FloatArray:
    """Values of points by their places among others, 0 of those that are not among them."""
    of_all = np.zeros((len(place), *values.shape[1:]))
    of_all[place >= 0] = values[place[place >= 0]]
    return of_all
