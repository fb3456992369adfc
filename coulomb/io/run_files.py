"""The files of a run, read on one rank: summary, bodies (`run_bodies`), and contact faces, those with contact points
and those opposite in pairs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, in_words
from ..contact_fields import names as field_names
from ..contact_fields import sides_of
from ..fem import compat
from ..fem.bodies import HELD_OBLIQUE, HeldDirections
from ..fem.compat import mesh
from ..fem.meshes import FACETS, SEPARATOR, SOLIDS, facet_columns
from ..model.nodal_answer import HELD
from ..solvers.laws import LAWS
from .field_files import NODE, OPPOSITE, data_of, grids_of, read_fields
from .grid_file import Described, described
from .result_grids import BODIES, FACES, GROUND, ON_OPPOSITE
from .run_bodies import Fields, WrittenBodies, WrittenBody, fits, read_bodies
from .run_directory import OLD, SOLUTION, RunDirectory


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
    `pairs` is the entry `faces` of summary.json, which names the sides of the contacts; the folder is for messages.

    Raises:
        ValueError: If a file cannot be read or does not match the others.
        OSError, KeyError, IndexError, RuntimeError, TypeError: If a file is incomplete.
    """
    data, faces, opposite, read = data_of(file), [], [], []
    masters = {master: number for number, (_, master) in enumerate(sides_of(pairs)) if master is not None}
    first, on_face, vectors = 0, field_names(), field_names(vector=True)
    for name, group in grids_of(file).items():
        against = _is_opposite(data, group)
        names = (*(ON_OPPOSITE if against else on_face), *((OPPOSITE,) if against else ()), NODE)
        points, cells, fields = read_fields(data, names, (), group)
        for one in names:
            shape = (len(points), 3) if one in vectors else (len(points),)
            fits(data, one, fields[one], shape)
        start = 0 if against else first
        part = _body_of(name, bodies, folder)
        face = _face(name, part, points, cells, fields.pop(NODE), start, f"{folder}: {data.name}")
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
    name: str,
    part: WrittenBody,
    points: FloatArray,
    cells: npt.NDArray[np.int64],
    node: FloatArray,
    first_point: int,
    what: str,
) -> WrittenFace:
    """A grid whose nodes are numbered from `first_point` on, and have the numbers `node` in the file of the body."""
    body, unfit = part.body, f"{what} does not match the mesh of {SOLUTION}"
    body.domain.topology.create_connectivity(2, 3)
    boundary = np.sort(mesh.exterior_facet_indices(body.domain.topology)).astype(np.int32)
    cell, columns = body.in_cells(boundary)
    sides = compat.cell_dofs(body.V)[cell[:, None], columns]
    order = np.argsort(part.in_file)
    if not np.all(np.isin(node, part.in_file)) or not np.array_equal(part.points[node.astype(np.int64)], points):
        raise ValueError(f"{unfit}: its points are not the nodes there that {NODE} names")
    in_body = order[node.astype(np.int64)]
    _, first, same = np.unique(np.vstack([sides, in_body[cells]]), axis=0, return_index=True, return_inverse=True)
    side = first[same.ravel()[len(sides) :]]
    if np.any(side >= len(sides)):
        place = in_words(points[cells[np.argmax(side >= len(sides))]].mean(axis=0))
        raise ValueError(
            f"{unfit}: {np.count_nonzero(side >= len(sides))} of {len(cells)} facets (first seen at x = {place}) are "
            "not on the boundary of the body, or have their nodes in another order"
        )
    if len(np.unique(side)) < len(side) or len(np.unique(cells)) != len(points):
        raise ValueError(f"{unfit}: it has facets twice, or points on no facet")
    facets = first_point + cells[:, : len(facet_columns(body.domain.topology.cell_type, 1)[0])]
    nodes = slice(first_point, first_point + len(points))
    return WrittenFace(name, part, nodes, part.nodes.start + in_body, facets, boundary[side], first_point + cells)


OF_LARGEST: Final = 1e-14
"""Rounding of a field relative to its largest entry, at least."""

_NEEDED = ("law", "mean_compliance", "totals", "certificate")


@dataclass(frozen=True)
class WrittenRun:
    """Contents of the files of a run; metres, newtons and pascals.

    Attributes:
        folder: Their directory.
        summary: summary.json.
        body: The body, or all bodies one after the other; k nodes.
        on_body: Vectors at the nodes of `body`, shape (k, 3), HELD_OBLIQUE only if directions are held that are no
            axes; and TEMPERATURE, shape (k,), only with a temperature.
        faces: The contact faces, with q nodes in all: a node on two of them is there twice, unless they are in one
            grid.
        on_face: Fields at their nodes, and their coordinates "x".
        opposite: The faces opposite in pairs.
        described: What solution.xdmf and contact.xdmf describe.
    """

    folder: Path
    summary: dict[str, Any]
    body: WrittenBodies
    on_body: Fields
    faces: tuple[WrittenFace, ...]
    on_face: Fields
    opposite: tuple[WrittenOpposite, ...]
    described: tuple[Described, Described]

    @cached_property
    def node(self) -> npt.NDArray[np.int64]:
        """Numbers of the nodes of the contact faces in `body`, shape (q,)."""
        return np.concatenate([face.node for face in self.faces])

    @property
    def files(self) -> RunDirectory:
        """The directory of its files."""
        return RunDirectory(self.folder)

    @property
    def face_names(self) -> list[str]:
        """Names of the contact faces in summary.json; ValueError if it has none."""
        try:
            names = self.summary["totals"]["faces"]
            if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
                return list(names)
        except (KeyError, TypeError):
            pass
        raise ValueError(f"{self.files.summary}: totals.faces does not name the contact faces")

    @property
    def ground(self) -> FloatArray | None:
        """Recorded nodal forces of the rigid modes, shape (k, 3, 6); None without springs and Robin terms."""
        if GROUND[0] not in self.on_body:
            return None
        return np.stack([self.on_body[name] for name in GROUND], axis=2)

    @property
    def size(self) -> float:
        """Largest extent of the bodies together along an axis in metres."""
        return float(np.max(np.ptp(self.body.x, axis=0)))

    @property
    def evaluation(self) -> float:
        """Tolerance of a field relative to its largest entry: DOLFINx writes fields as evaluated at the points.

        For that it computes reference coordinates, with the relative accuracy of coordinates over the edge length.
        """
        edge = np.inf
        for part in self.body.parts:
            corners = part.points[part.cells]
            edge = min(edge, float(np.min(np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2))))
        return max(OF_LARGEST, 1e-15 * float(np.max(np.abs(self.body.x))) / edge)

    @cached_property
    def held(self) -> HeldDirections:
        """The held directions of the nodes."""
        return HeldDirections.of_fields(self.on_body["held"], self.on_body.get(HELD_OBLIQUE))

    def held_in(self, part: WrittenBody) -> HeldDirections:
        """The held directions of the nodes of one of the bodies."""
        here = np.zeros(len(self.body.x), dtype=bool)
        here[part.nodes] = True
        return self.held.of(here)

    @property
    def touching(self) -> npt.NDArray[np.bool_]:
        """Which nodes of the contact faces are written as contact nodes, shape (q,)."""
        touching: npt.NDArray[np.bool_] = np.round(self.on_face["status"]) != HELD
        touching[self.between[0]] = False
        return touching

    @cached_property
    def between(self) -> npt.NDArray[np.int64]:
        """On faces of 10-node tetrahedra, the nodes in the middle of edges, which are no contact nodes, and those at
        the two ends of each, shape (3, e)."""
        return np.concatenate([face.between for face in self.faces], axis=1)

    def on_faces_of(self, other: WrittenRun) -> npt.NDArray[np.int64]:
        """The number of every node of the contact faces among those of another run, shape (q,).

        Raises:
            ValueError: If that has another contact face.
        """
        unfit = f"{self.folder}: has another contact face than {other.folder}"
        if [face.name for face in self.faces] != [face.name for face in other.faces]:
            raise ValueError(unfit)
        in_bodies, found = self.in_bodies_of(other), []
        for mine, there in zip(self.faces, other.faces, strict=True):
            number = np.full(len(other.body.x), -1)
            number[there.node] = np.arange(there.points.start, there.points.stop)
            found.append(number[in_bodies[mine.node]])
        numbers: npt.NDArray[np.int64] = np.concatenate(found)
        if np.any(numbers < 0):
            raise ValueError(unfit)
        return numbers

    def in_bodies_of(self, other: WrittenRun) -> npt.NDArray[np.int64]:
        """The number of every node among those of another run, shape (k,).

        Raises:
            ValueError: If that has another mesh.
        """
        unfit = f"{self.folder}: has another mesh than {other.folder}"
        return self.body.numbers_in(other.body.spaces, unfit)


def read_run(folder: Path, like: WrittenRun | None = None) -> WrittenRun:
    """Read the files of a run, or of a load step: solution.xdmf, contact.xdmf, their .h5 files, and summary.json.  The
    mesh of another run, `like`, is reused if it is identical.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others.
    """
    files = RunDirectory(folder)
    summary = files.read_summary(_NEEDED)
    _sound(summary, files.summary)
    for path in (files.solution, files.contact, data_of(files.solution), data_of(files.contact)):
        if not path.is_file():
            raise ValueError(f"{folder}: is incomplete: there is no {path.name}")
    try:
        described_ = described(files.solution, SOLIDS, BODIES), described(files.contact, FACETS, FACES)
        bodies, on_body = read_bodies(files.solution, folder, summary.get("forms"), like.body if like else None)
        faces, on_face, opposite = read_faces(files.contact, folder, bodies, summary.get("faces") or ())
    except (OSError, KeyError, IndexError, RuntimeError, TypeError) as error:
        raise ValueError(f"{folder}: is incomplete: {error}") from None
    return WrittenRun(folder, summary, bodies, on_body, faces, on_face, opposite, described_)


def _sound(summary: dict[str, Any], path: Path) -> None:
    """Check the entries of a summary that the certificate needs."""
    law, compliance, certificate = (summary[key] for key in ("law", "mean_compliance", "certificate"))
    if law not in LAWS:
        raise ValueError(f"{path}: law should be {', '.join(map(repr, LAWS[:-1]))} or {LAWS[-1]!r}, but is {law!r}")
    if isinstance(compliance, bool) or not isinstance(compliance, float | int) or not 0.0 < compliance < math.inf:
        raise ValueError(f"{path}: mean_compliance should be a positive number, but is {compliance!r}")
    if not isinstance(certificate, dict) or not isinstance(certificate.get("passed"), bool):
        raise ValueError(f"{path}: certificate does not say whether it had passed: {OLD}")
