"""Normals, gaps, areas and law of the nodes of the contact faces, computed anew from the written meshes and the case.

All nodes of the written facets are checked, except those whose displacement along the normal is prescribed according to
solution.h5; the status in contact.h5 is not used.  On faces of 10-node tetrahedra these are the vertices, with averages
over the facets around them, whose weights are integrated anew on the written mesh; in pairs averages over both faces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray, in_words, unit_vectors
from ...case.contact import FoundationTable
from ...fem.contact import (
    NO_SHAPE,
    MortarRows,
    NearFace,
    Shape,
    bounded_gap,
    bulges_at_points,
    contact_points,
    curved_patch,
    distance_along,
    faces_away,
    held_on_both,
    mortar_rows,
    nodes_of_other_pairs,
    planes_of_symmetry,
    shares,
    whole_face,
    within,
    without_noise,
)
from ...fem.geometry import HELD_BELOW, HELD_BEYOND, LEAST_RATIO, RigidFoundation, held_length, supported_frames
from ...model.held_nodes import OtherNodes, touching, without_slopes
from ...nearest import tree_of
from ..run_directory import CONTACT
from ..run_files import WrittenFace, WrittenOpposite, WrittenRun
from .case_reference import CaseReference
from .comparison import Comparison
from .contact_nodes import ContactNodes

_NEARLY_HELD: Final = 0.9
"""Without a case, the normal of a held node is that of its facets, which is only near the foundation's."""

_TURNED: Final = 0.1
"""Without a case, cosine of the angle between a facet's normal and that of the nearest contact point up to which its
node may face away from the foundation."""

_Grid = tuple[WrittenFace, npt.NDArray[np.int32]]
"""The grid of a contact face, and the facets there that are on it."""


def contact_nodes(
    run: WrittenRun,
    case: CaseReference | None,
    time: float,
    slip_rate: FloatArray | None,
    grids: Sequence[_Grid],
    found: Comparison,
    tied: bool = False,
) -> tuple[ContactNodes, tuple[OtherNodes, ...]]:
    """The nodes to check, of contact faces each with its grid and its facets, at the time of the run; and those that
    are no contact points, but are judged as well.

    Without a case, normals, gaps and law are those in the files, whose axes are checked.  `slip_rate` is that of the
    load step before at the nodes of the faces, m/s, shape (q,); None if it is unknown.  `tied` is whether the case has
    ties, and the meshes of the files.

    Raises:
        ValueError: If no node is left.
    """
    said = np.round(run.on_face["face"]).astype(np.int64)
    opposite = {one.contact: one for one in run.opposite}
    taken = np.zeros(len(run.body.x), dtype=bool)  # nodes that are contact points of no pair
    for number, (face, facets) in enumerate(grids):
        if number not in opposite:
            taken[face.part.nodes.start + face.part.body.nodes_of(facets)] = True
    pairs = _pairs(run, case, grids, opposite, taken, time if tied else None)
    source, others = _Source(run, case, time, slip_rate, found, tied), list[OtherNodes]()
    nodes = ContactNodes.joined(
        [
            source.in_pair(number, face, said == number, opposite[number], *pairs[number])
            if number in opposite
            else source.against_foundation(number, face, facets, said == number, others)
            for number, (face, facets) in enumerate(grids)
        ]
    )
    stray = run.touching.copy()
    stray[nodes.index[nodes.written]] = False
    if np.any(stray):
        fault = "are written as contact nodes, but are prescribed along their normal, or on no face"
        source.report(np.flatnonzero(stray), fault)
    if not np.any(nodes.written):
        raise ValueError(f"{run.folder}: contact.h5 has no contact node to check")
    return nodes, tuple(others)


@dataclass(frozen=True)
class _Source:
    """Where normals, gaps and law come from: the meshes and the case, or without one the files (`contact_nodes`)."""

    run: WrittenRun
    case: CaseReference | None
    time: float
    slip_rate: FloatArray | None
    found: Comparison
    tied: bool

    def against_foundation(
        self,
        number: int,
        face: WrittenFace,
        facets: npt.NDArray[np.int32],
        said: npt.NDArray[np.bool_],
        others: list[OtherNodes],
    ) -> ContactNodes:
        """The nodes of a face against a foundation; those that are no contact points are added to `others`."""
        run, case, time, body, held = self.run, self.case, self.time, face.part.body, self.run.held_in(face.part)
        count, local = len(run.node), face.node - face.part.nodes.start
        around, outward = np.zeros(count), np.zeros((count, 3))
        around[face.points], outward[face.points] = (values[local] for values in body.positive_weights(facets))
        points = contact_points(body, facets)
        index, weights = _on_face(points.nodes, points.weights, face, count)
        x, H = weights @ run.on_face["x"], held.projector_at(points.nodes)
        written, data = (run.touching & said)[index], {name: v[index] for name, v in run.on_face.items()}
        axes = np.stack([data["normal"], data["tangent_1"], data["tangent_2"]], axis=1)
        told = written & _have_axes(axes)
        unit = outward[index] / np.linalg.norm(outward[index], axis=1)[:, None]
        beyond = np.full(len(x), HELD_BEYOND)
        if case is None:
            n, gap, given = np.where(told[:, None], data["normal"], unit), data["initial_gap"], data["given_gap"]
            beyond[~told] = _NEARLY_HELD
            near = data["normal"][told][tree_of(x[told]).query(x)[1]] if np.any(told) else n
            turned = np.einsum("ki,ki->k", near, unit) <= _TURNED
        else:
            on = around > 0.0
            place, contact = run.on_face["x"][on], case.contacts[number]
            there = case.foundation(number, time, place, around[on], outward[on])
            distance: FloatArray = there.signed_distance(place)
            if contact.normals == "body":
                n = unit
                normals = outward[on] / np.linalg.norm(outward[on], axis=1)[:, None]
                distance = distance_along(normals, place, distance, there)
            else:
                n = -there.normal(x)
            on_nodes = np.zeros((count, 2))
            on_nodes[on, 0] = distance
            on_nodes[on, 1] = 0.0 if case.lacks_gap(number) else case.given_gap(number, time, place)
            distance, given = (weights @ on_nodes).T
            if not points.nodal:
                distance = bounded_gap(distance, weights, on_nodes[weights.indices, 0])
            turned = faces_away(there.normal(run.on_face["x"][index]), unit)
            given = data["given_gap"] if case.lacks_gap(number) else given
            others.append(
                self._beside(number, face, np.flatnonzero(on), there, unit_vectors(outward[on]), on_nodes[on, 1])
            )
        free: npt.NDArray[np.bool_] = held_length(n, points.held(held)) <= beyond
        if self.tied:
            free &= self._free(weights, n)
        kept = free & (written | ~turned)
        if case is not None:
            distance[kept] = without_noise(distance[kept], x[kept], body)
            gap = distance + given
        frames = supported_frames(n, H)
        if case is not None:
            frames[free] = case.contacts[number].frames(n[free], H[free], x[free], MPI.COMM_SELF)
        elif np.any(here := written & free):
            frames[told] = axes[told]
            self._compare_axes(axes[here], x[here])
            away = here & ~(np.einsum("ki,ki->k", data["normal"], unit) > 0.0)
            self.report(index[away], "have a normal that points into the body")
        self.report(index[free & ~written & ~turned], "are left out, but are not prescribed in solution.h5")
        part, opposite = np.full(len(x), number), scipy.sparse.csr_matrix((len(x), len(run.body.x)))
        law, still = self._law(number, x, points.area, index), np.zeros_like(x)
        averages, origin = (index, weights, opposite, np.zeros_like(frames), part, written), data["slip_origin"]
        nodes = ContactNodes(*averages, frames, gap, given, np.zeros(len(x)), points.area, *law, origin, still, still)
        return nodes.only(kept)

    def _free(self, weights: scipy.sparse.csr_matrix, n: FloatArray) -> npt.NDArray[np.bool_]:
        """Whether supports and ties of the case leave averages of the nodes of the written faces, by weights (m, q),
        free along unit normals n (m, 3), shape (m,)."""
        assert self.case is not None
        entries, shape = (weights.data, self.run.node[weights.indices], weights.indptr), (len(n), len(self.run.body.x))
        lengths = self.case.free_lengths(self.run, scipy.sparse.csr_matrix(entries, shape), n, self.time)
        return np.asarray(lengths > HELD_BELOW)

    def _beside(
        self,
        number: int,
        face: WrittenFace,
        on: npt.NDArray[np.int64],
        there: RigidFoundation,
        outward: FloatArray,
        given: FloatArray,
    ) -> OtherNodes:
        """Which nodes of a face, numbers `on` (p,) among those of the written faces, are no contact points by
        themselves; with the moved foundation, their unit normals (p, 3) and the gaps given there (p,), by the case."""
        run, case, node, x = self.run, self.case, self.run.node[on], self.run.on_face["x"][on]
        assert case is not None
        contact, slope, H = case.contacts[number], there.normal(x), run.held.projector_at(node)
        n = outward if contact.normals == "body" else -slope
        held = held_length(n, H) > HELD_BEYOND
        if self.tied:
            entries = np.ones(len(on)), on, np.arange(len(on) + 1)
            held |= ~self._free(scipy.sparse.csr_matrix(entries, (len(on), len(run.node))), n)
        which = held | (contact.facing & faces_away(slope, outward))
        extent, before = float(np.max(np.ptp(face.part.body.x, axis=0))), case.distance_given(number, x)
        gap = touching(there.signed_distance(x) + given, before, extent, held)[which]
        n = without_slopes(slope, H, held)[which]
        return OtherNodes(MPI.COMM_SELF, node[which].astype(np.int32), run.body.x, n, gap, held[which])

    def in_pair(
        self,
        number: int,
        face: WrittenFace,
        said: npt.NDArray[np.bool_],
        other: WrittenOpposite,
        rows: MortarRows,
        faces: tuple[NearFace, NearFace],
        mirrored: FloatArray,
        n: FloatArray,
    ) -> ContactNodes:
        """The contact points of a pair, whose averages over both faces (`_pairs`) are integrated on the meshes."""
        run, case, start = self.run, self.case, other.face.part.nodes.start
        index, weights = _on_face(rows.node, rows.weights, face, len(run.node))
        among_all = (rows.opposite.data, start + rows.opposite.indices, rows.opposite.indptr)
        opposite = scipy.sparse.csr_matrix(among_all, shape=(len(index), len(run.body.x)))
        written, data = (run.touching & said)[index], {name: v[index] for name, v in run.on_face.items()}
        x = rows.x + np.einsum("mij,mj->mi", mirrored, data["x"] - rows.x)
        given, distance = data["given_gap"], rows.gap(n)
        if case is None and written_shape(run, number) is None:
            distance = data["initial_gap"] - given
        if case is None:  # gaps of meshes may have been closed
            floor = 1e-13 * float(np.max(np.abs(run.body.x)))
            closed = np.abs(data["initial_gap"] - given) <= floor + 1e-13 * np.abs(given)
            distance = np.where(closed, 0.0, distance)
            frames = np.stack([n, data["tangent_1"], data["tangent_2"]], axis=1)
            self._compare_axes(frames[written], x[written])
            untold = ~(written & _have_axes(frames))
            frames[untold] = supported_frames(n[untold], np.zeros((int(np.sum(untold)), 3, 3)))
        else:
            contact = case.contacts[number]
            floor = max(contact.adjust, 1e-14 * float(np.max(np.abs(faces[0].patch.x))))
            distance = np.where(np.abs(distance) <= floor, 0.0, distance)
            given = given if case.lacks_gap(number) else case.given_gap(number, self.time, x)
            H = run.held.projector_at(face.part.nodes.start + rows.node)
            frames = contact.frames(n, H, x, MPI.COMM_SELF)
        self.report(index[~written], "are left out, but are opposite to the other face")
        chord = np.max([*bulges_at_points(rows, distance, *faces), rows.chord], axis=0)
        law, still, part = self._law(number, x, rows.area, index), np.zeros_like(x), np.full(len(x), number)
        averages, origin = (index, weights, opposite, mirrored, part, written), data["slip_origin"]
        return ContactNodes(*averages, frames, distance + given, given, chord, rows.area, *law, origin, still, still)

    def _law(
        self, number: int, x: FloatArray, area: FloatArray, index: npt.NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        """Friction and cohesion in pascals; friction that depends on an unknown slip rate as written."""
        rate, written = self.slip_rate, self.run.on_face
        if self.case is None:
            return written["friction"][index], written["cohesion"][index]
        slip_rate = np.zeros(len(x)) if rate is None else rate[index]
        law = self.case.contacts[number].law(x, area, self.time, slip_rate, MPI.COMM_SELF)
        return written["friction"][index] if rate is None else law.friction, law.cohesion / area

    def _compare_axes(self, frames: FloatArray, x: FloatArray) -> None:
        """Check the lengths of the rows n, t1, t2 of contact points x (m, 3), and their angles, without a case."""
        compare, length, none = self.found.field, np.linalg.norm(frames, axis=2), np.zeros(len(x))
        compare(f"{CONTACT}: length of normal", length[:, 0], none + 1.0, x, "its direction")
        longer, shorter = np.max(length[:, 1:], axis=1), np.minimum(np.min(length[:, 1:], axis=1), LEAST_RATIO)
        compare(f"{CONTACT}: length of the longer tangent", longer, none + 1.0, x, "its direction")
        compare(f"{CONTACT}: length of the shorter tangent", shorter, none + LEAST_RATIO, x, "the least ratio")
        for name, i, j in (("tangent_1", 0, 1), ("tangent_2", 0, 2), ("tangent_2", 1, 2)):
            along = np.einsum("kj,kj->k", frames[:, i], frames[:, j])
            compare(f"{CONTACT}: {name} along the other axes", along, none, x, "right angles", floor=1e-14)

    def report(self, index: npt.NDArray[np.int64], fault: str) -> None:
        """A fault of nodes by their numbers among those of the written faces, if there are any."""
        if len(index):
            place = in_words(self.run.on_face["x"][np.min(index)])
            self.found.fault(f"{CONTACT}: status: {len(np.unique(index))} nodes {fault} (first seen at x = {place})")


def _pairs(
    run: WrittenRun,
    case: CaseReference | None,
    grids: Sequence[_Grid],
    opposite: dict[int, WrittenOpposite],
    taken: npt.NDArray[np.bool_],
    time: float | None,
) -> dict[int, tuple[MortarRows, tuple[NearFace, NearFace], FloatArray, FloatArray]]:
    """The contact points of all pairs (`_in_pair`) by the number of the contact, with every node at the nearest master.

    `taken` are nodes that are contact points against a foundation, shape (k,); `time` is that of the ties of the case,
    None without any.
    """
    rows, left_out, changed = {}, dict.fromkeys(opposite, taken), list(opposite)
    while changed:
        for number in changed:
            shape = written_shape(run, number) if case is None else case.contacts[number].shape
            for _ in range(1 if time is None else 2):
                found = _in_pair(run, *grids[number], opposite[number], left_out[number], shape or NO_SHAPE)
                rows[number] = found
                if case is not None and time is not None:
                    still = _still(
                        run, case, time, found, grids[number][0].part.nodes, opposite[number].face.part.nodes
                    )
                    left_out[number] = left_out[number] | still
        points = {}
        for number, (mortar, _, _, n) in rows.items():
            adjust = 0.0 if case is None else case.contacts[number].adjust
            gap = mortar.gap(n)
            nodes = grids[number][0].part.nodes.start + mortar.node
            points[number] = nodes, np.where(np.abs(gap) <= adjust, 0.0, gap)
        lost = nodes_of_other_pairs(points, len(taken), float(np.max(np.abs(run.body.x))))
        changed = [number for number in lost if np.any(lost[number])]
        left_out |= {number: left_out[number] | lost[number] for number in changed}
    return rows


def _still(
    run: WrittenRun,
    case: CaseReference,
    time: float,
    pair: tuple[MortarRows, tuple[NearFace, NearFace], FloatArray, FloatArray],
    slave: slice,
    master: slice,
) -> npt.NDArray[np.bool_]:
    """Nodes, shape (k,), of contact points of a pair of which ties of the case leave neither side free; `slave` and
    `master` are the nodes of the two bodies."""
    rows, _, _, n = pair
    total = len(run.body.x)
    own, other = (
        scipy.sparse.csr_matrix((of.data, start + of.indices, of.indptr), shape=(of.shape[0], total))
        for of, start in ((rows.weights, slave.start), (rows.opposite, master.start))
    )
    still = np.zeros(total, dtype=bool)
    still[slave.start + rows.node[case.free_lengths(run, (own - other).tocsr(), n, time) <= HELD_BELOW]] = True
    return still


def written_shape(run: WrittenRun, number: int) -> Shape | None:
    """What the facets of a pair stand for by summary.json; None of surfaces that are known to the run alone.

    Raises:
        ValueError: If it is no shape.
    """
    given = run.summary.get("understood", {}).get("contacts", [{}] * (number + 1))[number].get("shape", {})
    tables = [given.get(name) for name in ("surface", "against_surface")]
    if any(isinstance(table, str) for table in tables):
        return None
    slave, master = (None if table is None else FoundationTable.model_validate(table).foundation() for table in tables)
    return Shape(bool(given.get("smooth", False)), slave, master)


def _in_pair(
    run: WrittenRun,
    face: WrittenFace,
    facets: npt.NDArray[np.int32],
    other: WrittenOpposite,
    taken: npt.NDArray[np.bool_],
    shape: Shape,
) -> tuple[MortarRows, tuple[NearFace, NearFace], FloatArray, FloatArray]:
    """The contact points of a pair, with the averages over both faces; nodes are numbers in the body of each.  Besides
    both faces, the projectors across planes of symmetry, shape (m, 3, 3), and the normals in these, shape (m, 3).

    Nodes whose displacement along their normal is prescribed have no contact point, nor have those that are contact
    points of another face, `taken` (k,).  `shape` is what the facets stand for.

    Raises:
        ValueError: If the outward normals around a contact point cancel.
    """
    body, there, held = face.part.body, other.face.part, run.held_in(face.part)
    nodes, outward = body.nodes_of(facets), body.positive_weights(facets)[1]
    n = unit_vectors(outward[nodes])
    clamped = nodes[held_length(n, held.projector_at(nodes)) > HELD_BEYOND].astype(np.int64)
    slave, master = (
        curved_patch(part.body, run.held_in(part), on, surface, shape.smooth, "contact.h5")
        for part, on, surface in ((face.part, facets, shape.slave), (there, other.face.number, shape.master))
    )
    twice = nodes[taken[face.part.nodes][nodes]]
    rows = mortar_rows(slave, master, (0, len(body.x)), left_out=np.union1d(clamped, twice).astype(np.int64))
    planes = planes_of_symmetry(rows.normal, held.projector_at(rows.node), rows.node, slave)
    on_master = run.held.projector_at(there.nodes.start + np.arange(master.size)).reshape(-1, 9)
    mirrored = held_on_both(planes, (shares(rows.opposite) @ on_master).reshape(-1, 3, 3))
    return rows, (whole_face(slave), whole_face(master)), mirrored, within(rows.normal, planes)


def _have_axes(frames: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether none of the rows n, t1, t2 is zero, as all are written where there is no contact, shape (m,)."""
    have: npt.NDArray[np.bool_] = np.all(np.any(frames != 0.0, axis=2), axis=1)
    return have


def _on_face(
    nodes: npt.NDArray[np.integer[Any]], weights: scipy.sparse.csr_matrix, face: WrittenFace, count: int
) -> tuple[npt.NDArray[np.int64], scipy.sparse.csr_matrix]:
    """Nodes of a body (m,) and weights of its nodes (m, p) as those among the `count` nodes of the written faces."""
    in_file = np.full(len(face.part.body.x), -1)
    in_file[face.node - face.part.nodes.start] = np.arange(face.points.start, face.points.stop)
    weights = weights.tocsr()
    columns = in_file[weights.indices]
    widened = scipy.sparse.csr_matrix((weights.data, columns, weights.indptr), shape=(weights.shape[0], count))
    return in_file[nodes], widened
