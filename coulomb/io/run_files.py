"""Reading of the files of a run on one rank: bodies with loads and supports, contact faces, and the summary."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..fem.bodies import HELD_OBLIQUE, HeldDirections
from ..fem.meshes import FACETS, SOLIDS
from ..model.nodal_answer import HELD
from ..solvers.laws import LAWS
from .body_grids import BODIES, FACES
from .field_files import data_of
from .grid_file import Described, described
from .nodal_grids import GROUND
from .run_directory import OLD, RunDirectory
from .written_bodies import Fields, WrittenBodies, WrittenBody, read_bodies
from .written_faces import WrittenFace, WrittenOpposite, read_faces, same_nodes

OF_LARGEST = 1e-14
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
        return same_nodes(self.faces, self.on_face["x"], other.faces, other.on_face["x"], unfit)

    def in_bodies_of(self, other: WrittenRun) -> npt.NDArray[np.int64]:
        """The number of every node among those of another run, shape (k,).

        Raises:
            ValueError: If that has another mesh.
        """
        unfit = f"{self.folder}: has another mesh than {other.folder}"
        return self.body.numbers_in(other.body.nodes, unfit)


def read_run(folder: Path, like: WrittenRun | None = None) -> WrittenRun:
    """Read the files of a run, or of a load step.

    Args:
        folder: Directory with solution.xdmf, contact.xdmf, their .h5 files, and summary.json.
        like: Another run, whose mesh is reused if it is identical.

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
