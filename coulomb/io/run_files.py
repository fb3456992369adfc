"""The files of a run, read back on one rank: the body and what acts on it, the contact face, and the summary."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.spatial import cKDTree

from ..arrays import FloatArray
from ..fem import compat
from ..fem.body import ElasticBody
from ..fem.meshes import corners_of, local_facets
from ..model.nodal_answer import HELD
from .recheck.comparison import OF_LARGEST

ON_CELLS = ("von_mises_stress", "young", "poisson")
"""Fields of solution.h5, one number per cell."""

ON_BODY = ("displacement", "load", "held", "prescribed", "spring")
"""Fields of solution.h5, one vector per node."""

ON_FACE = (
    *("pressure", "friction_traction", "slip", "gap", "status", "friction_use", "contact_force", "normal"),
    *("initial_gap", "area", "coefficient", "slip_bound", "slip_origin", "face"),
)
"""Fields of contact.h5, one number or vector per node of the contact face."""

_NEEDED = ("law", "mean_compliance", "totals", "certificate")
_OLD = "not whole, or written by another version of coulomb: run the case again"

Fields = dict[str, FloatArray]


@dataclass(frozen=True)
class WrittenRun:
    """What the files of a run say; metres, newtons and pascals.

    Attributes:
        folder: Where they are.
        summary: summary.json.
        points: Of the body as the file has them, shape (k, 3).
        cells: Their numbers, cell by cell as the file has them.
        body: The body made of them, with the materials of the files; its nodes may be in another order.
        on_cells: Fields of the cells, in the order of `body.domain`, shape (c,).
        on_body: Vectors at the nodes of `body`, shape (k, 3).
        on_face: Fields at the q nodes of the contact face, and their coordinates "x".
        node: Numbers of these nodes in `body`, shape (q,).
        facets: Facets of the contact face, rows of numbers of nodes of the face, as the file has them.
        number: Their numbers in `body.domain`, shape (facets,).
    """

    folder: Path
    summary: dict[str, Any]
    points: FloatArray
    cells: npt.NDArray[np.int64]
    body: ElasticBody
    on_cells: Fields
    on_body: Fields
    on_face: Fields
    node: npt.NDArray[np.int64]
    facets: npt.NDArray[np.int64]
    number: npt.NDArray[np.int32]

    @property
    def size(self) -> float:
        """Largest extent of the body along an axis in metres."""
        return float(np.max(np.ptp(self.points, axis=0)))

    @property
    def evaluation(self) -> float:
        """By what part of the largest entry a field may be off: DOLFINx writes it as evaluated at the points.

        For that it looks for the place of a point in its cell, as exact as coordinates are over the length of an edge.
        """
        corners = self.points[self.cells]
        edge = float(np.min(np.linalg.norm(corners[:, 1:] - corners[:, :1], axis=2)))
        return max(OF_LARGEST, 1e-15 * float(np.max(np.abs(self.points))) / edge)

    @property
    def fixed(self) -> npt.NDArray[np.bool_]:
        """Which components of the nodes are prescribed, shape (k, 3)."""
        return np.round(self.on_body["held"]).astype(bool)

    @property
    def touching(self) -> npt.NDArray[np.bool_]:
        """Which nodes of the contact face are written as contact nodes, shape (q,)."""
        touching: npt.NDArray[np.bool_] = np.round(self.on_face["status"]) != HELD
        return touching


def read_run(folder: Path, like: WrittenRun | None = None) -> WrittenRun:
    """Read the files of a run, or of a load step.

    Args:
        folder: With solution.xdmf, contact.xdmf, their .h5 files, and summary.json.
        like: Another one, whose mesh is taken if it is the same.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not fit to the others.
    """
    summary = read_summary(folder / "summary.json", _NEEDED)
    _sound(summary, folder / "summary.json")
    for name in ("solution.xdmf", "contact.xdmf", "solution.h5", "contact.h5"):
        if not (folder / name).is_file():
            raise ValueError(f"{folder}: is not whole: there is no {name}")
    _shown_as_named(folder / "solution.xdmf", (*ON_CELLS, *ON_BODY))
    _shown_as_named(folder / "contact.xdmf", ON_FACE)
    try:
        points, cells, in_file = _read(folder / "solution.h5", (*ON_CELLS, *ON_BODY))
        corners, facets, on_face = _read(folder / "contact.h5", ON_FACE)
        for name in ON_CELLS:
            _fits(folder / "solution.h5", name, in_file[name], (len(cells),))
        for name in ON_BODY:
            _fits(folder / "solution.h5", name, in_file[name], (len(points), 3))
        vectors = {"friction_traction", "slip", "contact_force", "normal", "slip_origin"}
        for name in ON_FACE:
            shape = (len(corners), 3) if name in vectors else (len(corners),)
            _fits(folder / "contact.h5", name, on_face[name], shape)
        on_face["x"] = corners
        same = like is not None and np.array_equal(like.points, points) and np.array_equal(like.cells, cells)
        domain = like.body.domain if like and same else compat.read_mesh(MPI.COMM_SELF, str(folder / "solution.xdmf"))
        of_cell = np.asarray(domain.topology.original_cell_index)
        on_cells = {name: in_file[name][of_cell] for name in ON_CELLS}
        body = ElasticBody(domain, on_cells["young"], on_cells["poisson"])
    except (OSError, KeyError, IndexError, RuntimeError, TypeError) as error:
        raise ValueError(f"{folder}: is not whole: {error}") from None
    node = numbers(points, body.x, f"{folder}: solution.h5 does not fit to the mesh of solution.xdmf")
    unfit = f"{folder}: contact.h5 does not fit to the mesh of solution.xdmf"
    in_body = numbers(points, corners, unfit)
    rows = np.sort(in_body[facets], axis=1)
    number = local_facets(domain, {"contact": rows})["contact"]
    if len(number) != len(facets) or len(np.unique(facets)) != len(corners):
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
        {name: in_file[name][node] for name in ON_BODY},
        on_face,
        numbers(body.x, corners, unfit),
        facets,
        number[of_row],
    )


def read_summary(path: Path, needed: tuple[str, ...] = ("certificate",)) -> dict[str, Any]:
    """A summary.json.

    Raises:
        ValueError: If it cannot be read, is none, or lacks an entry that is needed.
    """
    try:
        told: Any = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: is not JSON: {error}") from None
    missing = [key for key in needed if not isinstance(told, dict) or key not in told]
    if missing:
        raise ValueError(f"{path}: has no {missing[0]!r}: {_OLD}")
    return dict(told)


def numbers(points: FloatArray, wanted: FloatArray, unfit: str) -> npt.NDArray[np.int64]:
    """For every wanted point (q, 3) its number among the points (k, 3), to 1e-9 of their extent.

    Raises:
        ValueError: `unfit`, if one is not among them.
    """
    found = places(points, wanted)
    if np.any(found < 0):
        raise ValueError(unfit)
    return found


def places(points: FloatArray, wanted: FloatArray) -> npt.NDArray[np.int64]:
    """The same, -1 for a point that is not among them."""
    if not len(points):
        return np.full(len(wanted), -1)
    distance, number = cKDTree(points).query(wanted)
    near = distance <= 1e-9 * float(np.max(np.ptp(points, axis=0)))
    return np.where(near, number, -1).astype(np.int64)


def midpoints(domain: Any) -> FloatArray:
    """Of the cells of a mesh on one rank, metres, shape (c, 3)."""
    middle: FloatArray = domain.geometry.x[compat.cell_geometry(domain)].mean(axis=1)
    return middle


def _sound(summary: dict[str, Any], path: Path) -> None:
    """What the certificate needs of a summary."""
    law, compliance, certificate = (summary[key] for key in ("law", "mean_compliance", "certificate"))
    if law not in ("coulomb", "tresca"):
        raise ValueError(f"{path}: law should be 'coulomb' or 'tresca', but is {law!r}")
    if isinstance(compliance, bool) or not isinstance(compliance, float | int) or not 0.0 < compliance < math.inf:
        raise ValueError(f"{path}: mean_compliance should be a positive number, but is {compliance!r}")
    if not isinstance(certificate, dict) or not isinstance(certificate.get("passed"), bool):
        raise ValueError(f"{path}: certificate does not say whether it had passed: {_OLD}")


def _shown_as_named(path: Path, names: tuple[str, ...]) -> None:
    """What ParaView reads shows every field, and from the place in the HDF5 file that has its name.

    Raises:
        ValueError: If not.
    """
    try:
        grid = ElementTree.parse(path).getroot().find("Domain/Grid")
        attributes = {} if grid is None else {one.get("Name"): one for one in grid.iter("Attribute")}
    except (OSError, ElementTree.ParseError) as error:
        raise ValueError(f"{path}: cannot be read: {error}") from None
    for name in names:
        if name not in attributes:
            raise ValueError(f"{path}: shows no field {name!r}: {_OLD}")
        place = (attributes[name].findtext("DataItem") or "").strip()
        if not place.startswith(f"{path.stem}.h5:/Function/{name}/"):
            raise ValueError(f"{path}: shows {place or 'nothing'} as {name!r}")


def _read(path: Path, names: tuple[str, ...]) -> tuple[FloatArray, npt.NDArray[np.int64], Fields]:
    """Points, cells and fields of a file; scalars (k,), vectors (k, 3)."""
    with h5py.File(path, "r") as file:
        points = np.array(file["Mesh/mesh/geometry"], dtype=np.float64)
        cells = np.array(file["Mesh/mesh/topology"], dtype=np.int64)
        fields: Fields = {}
        for name in names:
            if f"Function/{name}" not in file:
                raise ValueError(f"{path}: has no field {name!r}: {_OLD}")
            group = file[f"Function/{name}"]
            values = np.array(group[next(iter(group))], dtype=np.float64)
            fields[name] = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
    if points.ndim != 2 or points.shape[1] != 3 or not len(cells) or not 0 <= cells.min() <= cells.max() < len(points):
        raise ValueError(f"{path}: its mesh is damaged")
    return points, cells, fields


def _fits(path: Path, name: str, values: FloatArray, shape: tuple[int, ...]) -> None:
    if values.shape != shape:
        raise ValueError(f"{path}: {name} does not fit to the mesh")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{path}: {name} has entries that are not finite")
