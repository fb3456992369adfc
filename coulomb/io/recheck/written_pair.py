"""The contact points of a pair in the files of a run, from the meshes of its two faces, compared with those written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ...arrays import FloatArray
from ...fem.contact import (
    NO_SHAPE,
    MortarRows,
    Shape,
    curved_patch,
    held_on_both,
    lost_nodes,
    mortar_rows,
    planes_of_symmetry,
    shares,
    within,
)
from ...fem.geometry import HELD_BEYOND, LEAST_RATIO, held_length, supported_frames
from ...model.accumulated import ACCUMULATED
from ...solvers.laws import FrictionLaw
from ..run_directory import CONTACT
from ..run_files import WrittenRun
from ..written_faces import WrittenFace, WrittenOpposite
from .case_reference import CaseReference
from .comparison import Comparison
from .face_nodes import FaceNodes

WrittenRows = tuple[MortarRows, FloatArray, FloatArray]
"""Contact points of a pair, projectors across planes of symmetry, and normals (`written_rows`)."""

LAW = ("friction", "cohesion")
"""Fields of contact.xdmf with the law of friction."""

TANGENTS = ("tangent_1", "tangent_2")
"""Fields of contact.xdmf that are the rows t1 and t2."""

GAPS = ("initial_gap", "given_gap")
"""Fields of contact.xdmf with the gap before deformation, and the part of it that the contact gives."""


def pair_nodes(
    run: WrittenRun,
    case: CaseReference | None,
    time: float,
    slip_rate: FloatArray | None,
    number: int,
    face: WrittenFace,
    facets: npt.NDArray[np.int32],
    said: npt.NDArray[np.bool_],
    other: WrittenOpposite,
    rows_there: WrittenRows,
    found: Comparison,
) -> FaceNodes:
    """The contact points of a pair, whose averages over both faces are integrated anew on the written meshes."""
    rows, mirrored, n = rows_there
    apart = rows.gap(n)
    count, start = len(run.node), other.face.part.nodes.start
    index, weights = on_face(rows.node, rows.weights, face, count)
    among_all = (rows.opposite.data, start + rows.opposite.indices, rows.opposite.indptr)
    opposite = scipy.sparse.csr_matrix(among_all, shape=(len(index), len(run.body.x)))
    area, written = rows.area, (run.touching & said)[index]
    x = rows.x + np.einsum("mij,mj->mi", mirrored, run.on_face["x"][index] - rows.x)
    data = {name: run.on_face[name][index] for name in ("normal", *TANGENTS, *GAPS, *LAW, "slip_origin")}
    size, file, at = float(np.max(np.abs(run.body.x))), CONTACT, x[written]
    given, law, frames = data["given_gap"], FrictionLaw(data["cohesion"] * area, data["friction"]), None
    adjust = 0.0
    if case is not None:
        contact = case.contacts[number]
        adjust = contact.adjust
        given = given if case.lacks_gap(number) else case.given_gap(number, time, x)
        law = case.law(number, x, area, time, np.zeros(len(x)) if slip_rate is None else slip_rate[index])
        law = replace(law, friction=data["friction"]) if slip_rate is None else law
        H = run.held.projector_at(face.part.nodes.start + rows.node)
        frames = case.frames(number, n, H, x)
    floor = 1e-13 * size
    distance = np.where(np.abs(apart) <= adjust, 0.0, apart) if adjust else apart
    if case is None:  # gaps of meshes may have been closed
        closed = np.abs(data["initial_gap"] - given) <= floor + 1e-13 * np.abs(given)
        distance = np.where(closed, 0.0, distance)
    source = "the meshes of both faces"
    found.field(f"{file}: area", run.on_face["area"][index][written], area[written], at, source)
    found.field(f"{file}: normal", data["normal"][written], n[written], at, source, floor=1e-13)
    gap = distance + given
    found.field(f"{file}: initial_gap", data["initial_gap"][written], gap[written], at, source, floor=floor)
    if frames is None:
        frames = np.stack([n, *(data[name] for name in TANGENTS)], axis=1)
        compare_axes(found, frames[written], at)
        untold = ~(written & have_axes(frames))
        frames[untold] = supported_frames(n[untold], np.zeros((int(np.sum(untold)), 3, 3)))
    else:
        found.field(f"{file}: given_gap", data["given_gap"][written], given[written], at, "the case", floor=floor)
        for k, name in enumerate(TANGENTS, start=1):
            found.field(f"{file}: {name}", data[name][written], frames[written, k], at, "normal and case", floor=1e-13)
        for name, expected in zip(LAW, (law.friction, law.cohesion / area), strict=True):
            found.field(f"{file}: {name}", data[name][written], expected[written], at, "the case")
    if not np.all(written):
        report(found, run, everywhere(run, index[~written]), "are left out, but are opposite to the other face")
    part, cohesion, still = np.full(len(index), number), law.cohesion / area, np.zeros_like(x)
    earlier = np.zeros((len(index), len(ACCUMULATED)))
    measured = (frames, gap, given, area, law.friction, cohesion, data["slip_origin"], still, earlier)
    return FaceNodes(index, weights, opposite, mirrored, part, written, *measured)


def written_pairs(
    run: WrittenRun,
    case: CaseReference | None,
    grids: Mapping[int, tuple[WrittenFace, npt.NDArray[np.int32]]],
    opposite: Mapping[int, WrittenOpposite],
    taken: npt.NDArray[np.bool_],
) -> dict[int, WrittenRows]:
    """The `written_rows` of all pairs, by the number of the contact, with every node at the nearest master.

    Args:
        run: The files.
        case: The case, if there is one.
        grids: The grid of every slave face, and its facets.
        opposite: The faces opposite.
        taken: Nodes that are contact points against a foundation, shape (k,).
    """
    rows: dict[int, WrittenRows] = {}
    left_out, changed, size = {number: taken for number in grids}, list(grids), float(np.max(np.abs(run.body.x)))
    while changed:
        for number in changed:
            shape = NO_SHAPE if case is None else case.contacts[number].shape
            rows[number] = written_rows(run, *grids[number], opposite[number], left_out[number], shape)
        points = {}
        for number, (found, _, n) in rows.items():
            adjust = 0.0 if case is None else case.contacts[number].adjust
            start = grids[number][0].part.nodes.start
            gap = found.gap(n)
            points[number] = start + found.node, np.where(np.abs(gap) <= adjust, 0.0, gap)
        lost = lost_nodes(points, len(taken), size)
        changed = [number for number in lost if np.any(lost[number])]
        left_out |= {number: left_out[number] | lost[number] for number in changed}
    return rows


def written_rows(
    run: WrittenRun,
    face: WrittenFace,
    facets: npt.NDArray[np.int32],
    other: WrittenOpposite,
    taken: npt.NDArray[np.bool_],
    shape: Shape,
) -> WrittenRows:
    """The contact points of a pair, with the averages over both faces; nodes are numbers in the body of each.  Besides
    the projectors across planes of symmetry, shape (m, 3, 3), and the normals in these, shape (m, 3).

    Nodes whose displacement along their normal is prescribed have no contact point, nor have those that are contact
    points of another face, `taken` (k,).  `shape` is what the facets stand for.

    Raises:
        ValueError: If the outward normals around a contact point cancel.
    """
    body, held = face.part.body, run.held_in(face.part)
    nodes, outward = body.nodes_of(facets), body.positive_weights(facets)[1]
    n = outward[nodes] / np.maximum(np.linalg.norm(outward[nodes], axis=1), 1e-300)[:, None]
    clamped = nodes[held_length(n, held.projector_at(nodes)) > HELD_BEYOND].astype(np.int64)
    slave, master = (
        curved_patch(part.body, run.held_in(part), on, surface, shape.smooth, "contact.h5")
        for part, on, surface in (
            (face.part, facets, shape.slave),
            (other.face.part, other.face.number, shape.master),
        )
    )
    twice = nodes[taken[face.part.nodes][nodes]]
    rows = mortar_rows(slave, master, (0, len(body.x)), left_out=np.union1d(clamped, twice).astype(np.int64))
    planes = planes_of_symmetry(rows.normal, held.projector_at(rows.node), rows.node, slave)
    n, start = within(rows.normal, planes), other.face.part.nodes.start
    there = run.held.projector_at(start + np.arange(master.size)).reshape(-1, 9)
    mirrored = held_on_both(planes, (shares(rows.opposite) @ there).reshape(-1, 3, 3))
    return rows, mirrored, n


def on_face(
    nodes: npt.NDArray[np.integer[Any]], weights: scipy.sparse.csr_matrix, face: WrittenFace, count: int
) -> tuple[npt.NDArray[np.int64], scipy.sparse.csr_matrix]:
    """Nodes of a body (m,) and weights of its nodes (m, p) as those among the `count` nodes of the written faces."""
    in_file = np.full(len(face.part.body.x), -1)
    in_file[face.node - face.part.nodes.start] = np.arange(face.points.start, face.points.stop)
    weights = weights.tocsr()
    columns = in_file[weights.indices]
    widened = scipy.sparse.csr_matrix((weights.data, columns, weights.indptr), shape=(weights.shape[0], count))
    return in_file[nodes], widened


def have_axes(frames: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether none of the rows n, t1, t2 is zero, as all are written where there is no contact, shape (m,)."""
    have: npt.NDArray[np.bool_] = np.all(np.any(frames != 0.0, axis=2), axis=1)
    return have


def compare_axes(found: Comparison, frames: FloatArray, x: FloatArray) -> None:
    """Check the lengths of the rows n, t1, t2 of contact points x (m, 3), and their angles, without a case."""
    length, none = np.linalg.norm(frames, axis=2), np.zeros(len(x))
    found.field("contact.xdmf: length of normal", length[:, 0], none + 1.0, x, "its direction")
    longer, shorter = np.max(length[:, 1:], axis=1), np.minimum(np.min(length[:, 1:], axis=1), LEAST_RATIO)
    found.field("contact.xdmf: length of the longer tangent", longer, none + 1.0, x, "its direction")
    found.field("contact.xdmf: length of the shorter tangent", shorter, none + LEAST_RATIO, x, "the least ratio")
    for name, i, j in (("tangent_1", 0, 1), ("tangent_2", 0, 2), ("tangent_2", 1, 2)):
        along = np.einsum("kj,kj->k", frames[:, i], frames[:, j])
        found.field(f"contact.xdmf: {name} along the other axes", along, none, x, "right angles", floor=1e-14)


def everywhere(run: WrittenRun, index: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    which = np.zeros(len(run.node), dtype=bool)
    which[index] = True
    return which


def report(found: Comparison, run: WrittenRun, which: npt.NDArray[np.bool_], fault: str) -> None:
    place = ", ".join(f"{c:.6g}" for c in run.on_face["x"][np.argmax(which)])
    found.fault(f"contact.xdmf: status: {np.count_nonzero(which)} nodes {fault} (first seen at x = {place})")
