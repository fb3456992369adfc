"""The contact faces in the files of a run, on one rank: those with contact points, and those opposite in pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..contact_fields import names as field_names
from ..contact_names import sides_of
from ..fem import compat
from ..fem.compat import mesh
from ..fem.meshes import SEPARATOR, corners_of, facet_columns
from .field_files import OPPOSITE, data_of, grids_of, read_fields
from .nodal_grids import ON_OPPOSITE
from .run_directory import OLD, SOLUTION
from .written_bodies import Fields, WrittenBodies, WrittenBody, fits, numbers


@dataclass(frozen=True)
class WrittenFace:
    """The grid of a contact face, or the one of all contact faces of a single body.

    Attributes:
        name: The face, or of one in several contacts "FACE against OTHER" (`side_names`); "" for all of them.
        part: The body that it is on.
        points: Its nodes among the q nodes of all these grids.
        node: Numbers of its nodes among those of all bodies.
        facets: Corners of its facets among the q nodes, in the order of the file, shape (f, 3 or 4).
        number: Their numbers in the mesh of the body, shape (f,).
        cells: All nodes of these facets among the q nodes, in VTK's order.
    """

    name: str
    part: WrittenBody
    points: slice
    node: npt.NDArray[np.int64]
    facets: npt.NDArray[np.int64]
    number: npt.NDArray[np.int32]
    cells: npt.NDArray[np.int64]

    @property
    def between(self) -> npt.NDArray[np.int64]:
        """On faces of 10-node tetrahedra, the nodes in the middle of edges, which are no contact nodes, and those at
        the two ends of each, among the q nodes, shape (3, e)."""
        if self.part.body.positive:
            return np.empty((3, 0), dtype=np.int64)
        edges = np.concatenate([self.cells[:, list(edge)] for edge in ((3, 0, 1), (4, 1, 2), (5, 2, 0))])
        _, first = np.unique(edges[:, 0], return_index=True)
        found: npt.NDArray[np.int64] = edges[first].T
        return found


@dataclass(frozen=True)
class WrittenOpposite:
    """The grid of the face opposite in a pair.

    Attributes:
        contact: Number of the contact.
        against: Name of the face.
        face: Its grid; its nodes are numbers among its own.
        fields: `ON_OPPOSITE` at its nodes, and their coordinates "x".
    """

    contact: int
    against: str
    face: WrittenFace
    fields: Fields


def read_faces(
    file: Path, folder: Path, bodies: WrittenBodies, pairs: Sequence[Any]
) -> tuple[tuple[WrittenFace, ...], Fields, tuple[WrittenOpposite, ...]]:
    """The contact faces of contact.xdmf, the fields at their nodes with the coordinates "x", and the faces opposite.

    Args:
        file: The file.
        folder: The directory of the run, for messages.
        bodies: The bodies.
        pairs: The entry `faces` of summary.json, which names the sides of the contacts.

    Raises:
        ValueError: If a file cannot be read or does not match the others.
        OSError, KeyError, IndexError, RuntimeError, TypeError: If a file is incomplete.
    """
    data, faces, opposite, read = data_of(file), [], [], []
    masters = {master: number for number, (_, master) in enumerate(sides_of(pairs)) if master is not None}
    first, on_face, vectors = 0, field_names(), field_names(vector=True)
    for name, group in grids_of(file).items():
        against = _is_opposite(data, group)
        names = (*ON_OPPOSITE, OPPOSITE) if against else on_face
        points, cells, fields = read_fields(data, names, (), group)
        for one in names:
            shape = (len(points), 3) if one in vectors else (len(points),)
            fits(data, one, fields[one], shape)
        start = 0 if against else first
        face = _face(name, _body_of(name, bodies, folder), points, cells, start, f"{folder}: {data.name}")
        if against:
            if name not in masters:
                raise ValueError(f"{folder}: summary.json: faces has no pair with {name!r}, unlike contact.xdmf: {OLD}")
            number = masters[name]
            opposite.append(WrittenOpposite(number, pairs[number]["against"], face, {**fields, "x": points}))
        else:
            faces.append(face)
            read.append({**fields, "x": points})
            first += len(points)
    if not faces:
        raise ValueError(f"{folder}: {file.name} has no contact face")
    slaves = [slave for slave, _ in sides_of(pairs)]
    if faces[0].name and slaves != [face.name for face in faces]:
        raise ValueError(
            f"{folder}: {file.name} has the contact faces {', '.join(repr(face.name) for face in faces)}, but "
            f"summary.json {', '.join(map(repr, slaves))}: {OLD}"
        )
    together = {name: np.concatenate([fields[name] for fields in read]) for name in (*on_face, "x")}
    return tuple(faces), together, tuple(opposite)


def _is_opposite(data: Path, group: str) -> bool:
    """Whether a grid is that of a face opposite in a pair."""
    with h5py.File(data, "r") as file:
        return bool(group) and f"Function/{group}/{OPPOSITE}" in file


def _body_of(name: str, bodies: WrittenBodies, folder: Path) -> WrittenBody:
    if len(bodies.parts) == 1:
        return bodies.parts[0]
    body = name.partition(SEPARATOR)[0]
    found = [part for part in bodies.parts if part.name == body]
    if not found:
        raise ValueError(f"{folder}: contact.xdmf has a face {name!r}, but {SOLUTION} has no body {body!r}")
    return found[0]


def _face(
    name: str, part: WrittenBody, points: FloatArray, cells: npt.NDArray[np.int64], first_point: int, what: str
) -> WrittenFace:
    """A grid whose nodes are numbered from `first_point` on."""
    body, unfit = part.body, f"{what} does not match the mesh of {SOLUTION}"
    body.domain.topology.create_connectivity(2, 3)
    boundary = np.sort(mesh.exterior_facet_indices(body.domain.topology)).astype(np.int32)
    cell, columns = body.in_cells(boundary)
    sides = compat.cell_dofs(body.V)[cell[:, None], columns]
    in_body = numbers(body.x, points, unfit)
    _, first, same = np.unique(np.vstack([sides, in_body[cells]]), axis=0, return_index=True, return_inverse=True)
    side = first[same.ravel()[len(sides) :]]
    if np.any(side >= len(sides)):
        place = ", ".join(f"{c:.6g}" for c in points[cells[np.argmax(side >= len(sides))]].mean(axis=0))
        raise ValueError(
            f"{unfit}: {np.count_nonzero(side >= len(sides))} of {len(cells)} facets (first seen at x = {place}) are "
            "not on the boundary of the body, or have their nodes in another order"
        )
    if len(np.unique(side)) < len(side) or len(np.unique(cells)) != len(points):
        raise ValueError(f"{unfit}: it has facets twice, or points on no facet")
    facets = first_point + cells[:, : len(facet_columns(body.domain.topology.cell_type, 1)[0])]
    nodes = slice(first_point, first_point + len(points))
    return WrittenFace(name, part, nodes, part.nodes.start + in_body, facets, boundary[side], first_point + cells)


def midpoints_of_facets(face: WrittenFace) -> FloatArray:
    """Means of the corners of the facets of a face, metres, shape (f, 3)."""
    domain = face.part.body.domain
    middle: FloatArray = domain.geometry.x[corners_of(domain, face.number)].mean(axis=1)
    return middle


def same_nodes(
    faces: Sequence[WrittenFace], x: FloatArray, others: Sequence[WrittenFace], there: FloatArray, unfit: str
) -> npt.NDArray[np.int64]:
    """The number of every node of the faces among those of the same faces elsewhere, shape (q,).

    Args:
        faces: The faces.
        x: Their q nodes, shape (q, 3).
        others: The same faces elsewhere.
        there: Their nodes, shape (p, 3).
        unfit: What to say if they are not the same.

    Raises:
        ValueError: If a node is not there.
    """
    if [face.name for face in faces] != [face.name for face in others]:
        raise ValueError(unfit)
    pairs = zip(faces, others, strict=True)
    found: npt.NDArray[np.int64] = np.concatenate(
        [other.points.start + numbers(there[other.points], x[face.points], unfit) for face, other in pairs]
    ).astype(np.int64)
    return found
