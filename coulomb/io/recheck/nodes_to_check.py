"""The nodes of the contact faces to check, with normal, gap, area and law, compared with the case and the facets.

All nodes of the written facets are checked, except those whose displacement along the normal is prescribed according to
solution.h5; the status in contact.h5 is not used.  On faces of 10-node tetrahedra these are the vertices, with averages
over the facets around them, whose weights are integrated anew on the written mesh; in pairs averages over both faces.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ...arrays import FloatArray
from ...fem.contact import bounded_gap, contact_points, turned_away
from ...fem.geometry import HELD_BEYOND, held_length, supported_frames
from ...model.accumulated import ACCUMULATED
from ...nearest import tree_of
from ...solvers.laws import FrictionLaw
from ..run_directory import CONTACT
from ..run_files import WrittenRun
from ..written_faces import WrittenFace
from .case_reference import CaseReference
from .comparison import Comparison
from .face_nodes import FaceNodes, face_names
from .written_pair import (
    GAPS,
    LAW,
    TANGENTS,
    compare_axes,
    everywhere,
    have_axes,
    on_face,
    pair_nodes,
    report,
    written_pairs,
)

_NEARLY_HELD = 0.9
"""Without a case, the normal of a held node is that of its facets, which is only near the foundation's."""

_TURNED = 0.1
"""Without a case, cosine of the angle between a facet's normal and that of the nearest contact point up to which its
node may face away from the foundation."""


def face_nodes(
    run: WrittenRun,
    case: CaseReference | None,
    time: float,
    slip_rate: FloatArray | None,
    facet_part: npt.NDArray[np.int64],
    found: Comparison,
) -> FaceNodes:
    """The nodes to check; their written data are compared with the case and the facets.

    Args:
        run: The files.
        case: The case, if there is one.
        time: The time of the run.
        slip_rate: In the load step before at the nodes of the face, m/s, shape (q,); None if it is unknown.
        facet_part: Number of the face of each written facet.
        found: Collects the differences.

    Raises:
        ValueError: If no node is left.
    """
    count = len(case.contacts) if case is not None else len(face_names(run))
    said = np.round(run.on_face["face"]).astype(np.int64)
    found.field("contact.xdmf: face", run.on_face["face"], said.astype(float), run.on_face["x"], "whole numbers")
    opposite = {one.contact: one for one in run.opposite}
    grids = [facets_of(run, facet_part, number) for number in range(count)]
    taken = np.zeros(len(run.body.x), dtype=bool)  # nodes that are contact points of no pair
    for number, (face, facets) in enumerate(grids):
        if number not in opposite:
            taken[face.part.nodes.start + face.part.body.nodes_of(facets)] = True
    pairs = written_pairs(run, case, {number: grids[number] for number in opposite}, opposite, taken)
    faces = []
    for number, grid in enumerate(grids):
        given = (run, case, time, slip_rate, number, *grid, said == number)
        if number in opposite:
            faces.append(pair_nodes(*given, opposite[number], pairs[number], found))
        else:
            faces.append(_face(*given, found))
    parts = {name: [vars(face)[name] for face in faces] for name in vars(faces[0])}
    rows = {name: scipy.sparse.vstack(parts.pop(name), format="csr") for name in ("weights", "opposite")}
    judged = FaceNodes(**rows, **{name: np.concatenate(values) for name, values in parts.items()})
    stray = run.touching.copy()
    stray[judged.index[judged.written]] = False
    if np.any(stray):
        report(found, run, stray, "are written as contact nodes, but are prescribed along their normal, or on no face")
    if not np.any(judged.written):
        raise ValueError(f"{run.folder}: contact.h5 has no contact node to check")
    return judged


def facets_of(
    run: WrittenRun, facet_part: npt.NDArray[np.int64], number: int
) -> tuple[WrittenFace, npt.NDArray[np.int32]]:
    """The grid of a contact face, and the facets there that are on it."""
    if len(run.faces) == 1:
        return run.faces[0], run.faces[0].number[facet_part == number]
    return run.faces[number], run.faces[number].number


def _face(
    run: WrittenRun,
    case: CaseReference | None,
    time: float,
    slip_rate: FloatArray | None,
    number: int,
    face: WrittenFace,
    facets: npt.NDArray[np.int32],
    said: npt.NDArray[np.bool_],
    found: Comparison,
) -> FaceNodes:
    """The nodes of one face against a foundation."""
    body, held, count = face.part.body, run.held_in(face.part), len(run.node)
    mine = np.arange(face.points.start, face.points.stop)
    local = face.node - face.part.nodes.start
    around, outward = np.zeros(count), np.zeros((count, 3))
    around[mine], outward[mine] = (values[local] for values in body.positive_weights(facets))
    on = around > 0.0
    points = contact_points(body, facets)
    index, weights, area = *on_face(points.nodes, points.weights, face, count), points.area
    x, H = weights @ run.on_face["x"], held.projector_at(points.nodes)
    written = (run.touching & said)[index]
    data = {name: run.on_face[name][index] for name in ("normal", *TANGENTS, *GAPS, *LAW, "slip_origin")}
    unit = outward[index] / np.linalg.norm(outward[index], axis=1)[:, None]
    axes = np.stack([data["normal"], *(data[name] for name in TANGENTS)], axis=1)
    if case is None:
        told = written & have_axes(axes)
        n = np.where(told[:, None], data["normal"], unit)
        gap, given = (data[name] for name in GAPS)
        law = FrictionLaw(data["cohesion"] * area, data["friction"])
        beyond = np.where(told, HELD_BEYOND, _NEARLY_HELD)
        near = data["normal"][told][tree_of(x[told]).query(x)[1]] if np.any(told) else n
        turned = np.einsum("ki,ki->k", near, unit) <= _TURNED
    else:
        place = run.on_face["x"][on]
        distance = case.distances(number, time, place, around[on], outward[on])
        n = unit if case.contacts[number].normals == "body" else case.normals(number, time, x)
        on_nodes = np.zeros((len(on), 2))
        on_nodes[on, 0] = distance
        if not case.lacks_gap(number):
            on_nodes[on, 1] = case.given_gap(number, time, place)
        distance, given = (weights @ on_nodes).T
        if not points.nodal:
            distance = bounded_gap(distance, weights, on_nodes[weights.indices, 0])
        slope = -case.normals(number, time, run.on_face["x"][index])
        turned = turned_away(slope, unit)
        given = data["given_gap"] if case.lacks_gap(number) else given
        gap = distance + given
        law = case.law(number, x, area, time, np.zeros(len(x)) if slip_rate is None else slip_rate[index])
        if slip_rate is None:
            law = replace(law, friction=data["friction"])
        beyond = np.full(len(x), HELD_BEYOND)
    free: npt.NDArray[np.bool_] = held_length(n, points.held(held)) <= beyond
    frames = supported_frames(n, H)
    if case is None:
        frames[told] = axes[told]
    else:
        frames[free] = case.frames(number, n[free], H[free], x[free])

    here = written & free
    size, file = float(np.max(np.abs(run.body.x))), CONTACT
    found.field(f"{file}: area", run.on_face["area"][index][here], area[here], x[here], "the facets")
    if case is None:
        compare_axes(found, axes[here], x[here])
        away = here & ~(np.einsum("ki,ki->k", data["normal"], unit) > 0.0)
        if np.any(away):
            report(found, run, everywhere(run, index[away]), "have a normal that points into the body")
    else:
        found.field(f"{file}: normal", data["normal"][here], n[here], x[here], "the foundation of the case")
        for name, expected, source in zip(GAPS, (gap, given), ("the foundation of the case", "the case"), strict=True):
            found.field(f"{file}: {name}", data[name][here], expected[here], x[here], source, floor=1e-13 * size)
        for k, name in enumerate(TANGENTS, start=1):
            found.field(f"{file}: {name}", data[name][here], frames[here, k], x[here], "normal and case", floor=1e-13)
        for name, expected in zip(LAW, (law.friction, law.cohesion / area), strict=True):
            found.field(f"{file}: {name}", data[name][here], expected[here], x[here], "the case")
    left_out = free & ~written & ~turned
    if np.any(left_out):
        report(found, run, everywhere(run, index[left_out]), "are left out, but are not prescribed in solution.h5")
    part = np.full(len(index), number)
    cohesion = law.cohesion / area
    origin, still, earlier = data["slip_origin"], np.zeros_like(x), np.zeros((len(index), len(ACCUMULATED)))
    none_opposite = scipy.sparse.csr_matrix((len(index), len(run.body.x)))
    measured = (frames, gap, given, area, law.friction, cohesion, origin, still, earlier)
    mirrored = np.zeros((len(index), 3, 3))
    nodes = FaceNodes(index, weights, none_opposite, mirrored, part, written, *measured)
    return nodes.only(free & (written | ~turned))


def facet_parts(run: WrittenRun, count: int) -> npt.NDArray[np.int64]:
    """The face of every written facet: that of its contact nodes; if they are on two, the one to which the facet is
    more parallel.  Where every face has a grid of its own, that of its grid."""
    if len(run.faces) > 1 or run.faces[0].name:
        return np.repeat(np.arange(len(run.faces)), [len(face.facets) for face in run.faces])
    (face,) = run.faces
    said = np.round(run.on_face["face"]).astype(np.int64)
    best = np.full(len(face.facets), -np.inf)
    part: npt.NDArray[np.int64] = np.zeros(len(face.facets), dtype=np.int64)
    x = run.on_face["x"][face.facets]
    across = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    across /= np.linalg.norm(across, axis=1)[:, None]
    for number in range(count if count > 1 else 0):
        here = (run.touching & (said == number))[face.facets]
        mean = np.sum(np.where(here[..., None], run.on_face["normal"][face.facets], 0.0), axis=1)
        parallel = np.abs(np.einsum("ki,ki->k", mean, across)) / np.maximum(np.sum(here, axis=1), 1)
        parallel[~np.any(here, axis=1)] = -1.0
        part, best = np.where(parallel > best, number, part), np.maximum(best, parallel)
    return part
