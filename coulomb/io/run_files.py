"""Reading of the files of a run on one rank: the body with loads and supports, the contact face, and the summary."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.spatial import cKDTree

from ..arrays import FloatArray
from ..fem import compat
from ..fem.body import ElasticBody
from ..fem.cell_materials import FIELDS, VECTORS, CellMaterials
from ..fem.constraints import HELD_OBLIQUE, HeldDirections
from ..fem.displacement_space import DisplacementSpace
from ..fem.lagrange import facet_columns
from ..fem.meshes import distributed
from ..fem.named_mesh import corners_of, local_facets
from ..fem.second_order import CORNERS
from ..fem.temperature import TEMPERATURE
from ..model.accumulated import ACCUMULATED
from ..model.nodal_answer import HELD
from ..solvers.laws import LAWS
from .field_files import data_of, read_fields, refuse_misnamed
from .grid_file import FACETS
from .recheck.comparison import OF_LARGEST
from .run_directory import OLD, SOLUTION, RunDirectory

ON_CELLS = ("von_mises_stress",)
"""Fields of solution.h5, one number per cell; besides those of `cell_materials`."""

ON_BODY = ("displacement", "load", "held", "prescribed", "spring")
"""Fields of solution.h5, one vector per node."""

INTERNAL, ROUNDING = "internal_force", "rounding_force"
"""Fields of solution.h5 of a body of the user's forms, which are not in the files: its internal forces, and those of a
rounding error of the displacement (`rounding_forces`)."""

GROUND = tuple(f"rigid_force_{number}" for number in range(1, 7))
"""The nodal forces of its rigid motions, if it has Robin terms: `Deformable.ground`."""

OURS = (*ON_CELLS, *ON_BODY, *FIELDS, *GROUND, HELD_OBLIQUE, INTERNAL, ROUNDING, TEMPERATURE)
"""All names of fields of solution.h5."""

ON_FACE = (
    *(
        "pressure",
        "friction_traction",
        "slip",
        "gap",
        "status",
        "friction_use",
        *ACCUMULATED,
        "contact_force",
        "normal",
    ),
    *("tangent_1", "tangent_2", "initial_gap", "given_gap", "area", "coefficient", "friction", "cohesion"),
    *("slip_bound", "slip_origin", "face"),
)
"""Fields of contact.h5, one number or vector per node of the contact face."""

_NEEDED = ("law", "mean_compliance", "totals", "certificate")

Fields = dict[str, FloatArray]


class RecordedBody(DisplacementSpace):
    """A body of the user's forms, of which only the internal forces are known.

    Args:
        domain: The mesh in the files, with the nodes of the displacements as points.

    Attributes:
        internal: The internal forces as recorded, at its nodes, newtons, shape (k, 3).
    """

    def __init__(self, domain: Any):
        super().__init__(compat.functionspace(domain, compat.geometry_degree(domain), (3,)))
        self.internal = np.zeros_like(self.x)

    def internal_force(self, u: FloatArray) -> FloatArray:
        """The internal forces as recorded, whatever the displacement is."""
        return self.internal


@dataclass(frozen=True)
class WrittenRun:
    """Contents of the files of a run; metres, newtons and pascals.

    Attributes:
        folder: Their directory.
        summary: summary.json.
        points: Nodes of the body in the order of the file, shape (k, 3).
        cells: Their numbers per cell, in the order of the file.
        body: The body with the materials of the files, or with the recorded internal forces of the user's forms; its
            nodes may be in another order.
        on_cells: Fields of the cells, in the order of `body.domain`, shape (c,).
        on_body: Vectors at the nodes of `body`, shape (k, 3), HELD_OBLIQUE only if directions are held that are no
            axes; and TEMPERATURE, shape (k,), only of a body with a temperature.
        on_face: Fields at the q nodes of the contact face, and their coordinates "x".
        node: Numbers of these nodes in `body`, shape (q,).
        facets: Corners of the facets of the contact face among these, in the order of the file, shape (f, 3 or 4).
        number: Their numbers in `body.domain`, shape (f,).
        face_cells: All nodes of these facets, in VTK's order.
    """

    folder: Path
    summary: dict[str, Any]
    points: FloatArray
    cells: npt.NDArray[np.int64]
    body: ElasticBody | RecordedBody
    on_cells: Fields
    on_body: Fields
    on_face: Fields
    node: npt.NDArray[np.int64]
    facets: npt.NDArray[np.int64]
    number: npt.NDArray[np.int32]
    face_cells: npt.NDArray[np.int64]

    @property
    def files(self) -> RunDirectory:
        """The directory of its files."""
        return RunDirectory(self.folder)

    @property
    def elastic(self) -> ElasticBody | None:
        """The body with its materials; None if it is of the user's forms."""
        return self.body if isinstance(self.body, ElasticBody) else None

    @property
    def ground(self) -> FloatArray | None:
        """Recorded nodal forces of the rigid modes, shape (k, 3, 6); None without Robin terms."""
        if GROUND[0] not in self.on_body:
            return None
        return np.stack([self.on_body[name] for name in GROUND], axis=2)

    @property
    def size(self) -> float:
        """Largest extent of the body along an axis in metres."""
        return float(np.max(np.ptp(self.points, axis=0)))

    @property
    def evaluation(self) -> float:
        """Tolerance of a field relative to its largest entry: DOLFINx writes fields as evaluated at the points.

        For that it computes reference coordinates, with the relative accuracy of coordinates over the edge length.
        """
        corners = self.points[self.cells]
        edge = float(np.min(np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2)))
        return max(OF_LARGEST, 1e-15 * float(np.max(np.abs(self.points))) / edge)

    @cached_property
    def held(self) -> HeldDirections:
        """The held directions of the nodes."""
        return HeldDirections.of_fields(self.on_body["held"], self.on_body.get(HELD_OBLIQUE))

    @property
    def touching(self) -> npt.NDArray[np.bool_]:
        """Which nodes of the contact face are written as contact nodes, shape (q,)."""
        touching: npt.NDArray[np.bool_] = np.round(self.on_face["status"]) != HELD
        touching[self.between[0]] = False
        return touching

    @cached_property
    def between(self) -> npt.NDArray[np.int64]:
        """On faces of 10-node tetrahedra, the nodes of the contact face in the middle of edges, which are no contact
        nodes, and those at the two ends of each, shape (3, e)."""
        if self.body.positive:
            return np.empty((3, 0), dtype=np.int64)
        edges = np.concatenate([self.face_cells[:, list(edge)] for edge in ((3, 0, 1), (4, 1, 2), (5, 2, 0))])
        _, first = np.unique(edges[:, 0], return_index=True)
        found: npt.NDArray[np.int64] = edges[first].T
        return found


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
    body_data, face_data = data_of(files.solution), data_of(files.contact)
    for path in (files.solution, files.contact, body_data, face_data):
        if not path.is_file():
            raise ValueError(f"{folder}: is incomplete: there is no {path.name}")
    refuse_misnamed(files.contact, ON_FACE)
    try:
        forms = summary.get("forms") is not None
        needed = (*ON_BODY, INTERNAL, ROUNDING) if forms else (*ON_CELLS, *ON_BODY)
        optional = (HELD_OBLIQUE, TEMPERATURE, *(GROUND if forms else FIELDS))
        points, cells, in_file = read_fields(body_data, needed, optional)
        refuse_misnamed(files.solution, tuple(in_file))
        face_points, face_cells, on_face = read_fields(face_data, ON_FACE)
        if face_cells.shape[1] not in FACETS or cells.shape[1] not in CORNERS:
            raise ValueError(f"{folder}: its meshes are of cells that coulomb does not write")
        constants = [name for name in (*ON_CELLS, *FIELDS) if name in in_file]
        for name in constants:
            _fits(body_data, name, in_file[name], (len(cells), 3) if name in VECTORS else (len(cells),))
        nodal = (*ON_BODY, HELD_OBLIQUE, TEMPERATURE, INTERNAL, ROUNDING, *GROUND)
        on_body = [name for name in nodal if name in in_file]
        for name in on_body:
            _fits(body_data, name, in_file[name], (len(points),) if name == TEMPERATURE else (len(points), 3))
        vectors = {"friction_traction", "slip", "contact_force", "normal", "tangent_1", "tangent_2", "slip_origin"}
        for name in ON_FACE:
            shape = (len(face_points), 3) if name in vectors else (len(face_points),)
            _fits(face_data, name, on_face[name], shape)
        on_face["x"] = face_points
        same = like is not None and np.array_equal(like.points, points) and np.array_equal(like.cells, cells)
        domain = like.body.domain if like and same else distributed(MPI.COMM_SELF, points, cells)
        of_cell = np.asarray(domain.topology.original_cell_index)
        on_cells = {name: in_file[name][of_cell] for name in constants}
        body = RecordedBody(domain) if forms else ElasticBody(domain, _materials(body_data, on_cells))
    except (OSError, KeyError, IndexError, RuntimeError, TypeError) as error:
        raise ValueError(f"{folder}: is incomplete: {error}") from None
    node = numbers(points, body.x, f"{folder}: {body_data.name} does not match the mesh of {SOLUTION}")
    if isinstance(body, RecordedBody):
        body.internal = in_file[INTERNAL][node]
    unfit = f"{folder}: {face_data.name} does not match the mesh of {SOLUTION}"
    in_body = numbers(points, face_points, unfit)
    facets = face_cells[:, : len(facet_columns(domain.topology.cell_type, 1)[0])]
    rows = np.sort(in_body[facets], axis=1)
    number = local_facets(domain, {"contact": rows})["contact"]
    if len(number) != len(facets) or len(np.unique(face_cells)) != len(face_points):
        raise ValueError(f"{unfit}: its facets are not on the boundary of the body")
    in_order = np.sort(np.asarray(domain.geometry.input_global_indices)[corners_of(domain, number)], axis=1)
    of_row = np.empty(len(rows), dtype=np.int64)
    of_row[np.lexsort(rows.T)] = np.lexsort(in_order.T)
    return WrittenRun(
        folder,
        summary,
        points,
        cells,
        body,
        on_cells,
        {name: in_file[name][node] for name in on_body},
        on_face,
        numbers(body.x, face_points, unfit),
        facets,
        number[of_row],
        face_cells,
    )


def numbers(points: FloatArray, wanted: FloatArray, unfit: str) -> npt.NDArray[np.int64]:
    """Number of every wanted point (q, 3) among the points (k, 3), matched to 1e-9 of their extent.

    Raises:
        ValueError: `unfit`, if one is not among them.
    """
    found = places(points, wanted)
    if np.any(found < 0):
        raise ValueError(unfit)
    return found


def places(points: FloatArray, wanted: FloatArray) -> npt.NDArray[np.int64]:
    """As `numbers`, with -1 for a point that is not among them."""
    if not len(points):
        return np.full(len(wanted), -1)
    distance, number = cKDTree(points).query(wanted)
    near = distance <= 1e-9 * float(np.max(np.ptp(points, axis=0)))
    return np.where(near, number, -1).astype(np.int64)


def midpoints(domain: Any) -> FloatArray:
    """Midpoints of the cells of a mesh on one rank, metres, shape (c, 3)."""
    middle: FloatArray = domain.geometry.x[compat.cell_geometry(domain)].mean(axis=1)
    return middle


def _materials(path: Path, on_cells: Fields) -> CellMaterials:
    try:
        return CellMaterials.of_fields(on_cells)
    except KeyError as error:
        raise ValueError(f"{path}: has no field {error}: {OLD}") from None
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _sound(summary: dict[str, Any], path: Path) -> None:
    """Check the entries of a summary that the certificate needs."""
    law, compliance, certificate = (summary[key] for key in ("law", "mean_compliance", "certificate"))
    if law not in LAWS:
        raise ValueError(f"{path}: law should be {', '.join(map(repr, LAWS[:-1]))} or {LAWS[-1]!r}, but is {law!r}")
    if isinstance(compliance, bool) or not isinstance(compliance, float | int) or not 0.0 < compliance < math.inf:
        raise ValueError(f"{path}: mean_compliance should be a positive number, but is {compliance!r}")
    if not isinstance(certificate, dict) or not isinstance(certificate.get("passed"), bool):
        raise ValueError(f"{path}: certificate does not say whether it had passed: {OLD}")


def _fits(path: Path, name: str, values: FloatArray, shape: tuple[int, ...]) -> None:
    if values.shape != shape:
        raise ValueError(f"{path}: {name} does not match the mesh")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{path}: {name} has entries that are not finite")
