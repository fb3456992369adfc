"""The certificate of a run, from its files alone: without the case, the solver, or K and A.

The mesh, the displacement and the forces are read back, the stresses assembled anew.  Works on one rank.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from .arrays import FloatArray
from .certificate import Certificate, Evidence, judge
from .evidence import rounding_forces
from .fem import compat
from .fem.body import ElasticBody
from .fem.surface import tangent_frames
from .nodal_answer import HELD


def check(directory: str | Path) -> Certificate:
    """Certify what a run has written.

    Args:
        directory: With solution.xdmf, contact.xdmf, their .h5 files, and summary.json.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not fit to the others.
    """
    folder = Path(directory)
    told = _summary(folder / "summary.json")
    try:
        domain = compat.read_mesh(MPI.COMM_SELF, str(folder / "solution.xdmf"))
        in_file = np.asarray(domain.topology.original_cell_index)
        young, poisson = (_on_cells(folder / "solution.h5", name)[in_file] for name in ("young", "poisson"))
        body = ElasticBody(domain, young, poisson)
        on_body = _fields(folder / "solution.h5", ("displacement", "load", "held", "prescribed", "spring"))
        on_face = _fields(
            folder / "contact.h5",
            (
                *("contact_force", "normal", "initial_gap", "area", "coefficient", "slip_bound", "slip_origin"),
                "status",
            ),
        )
    except (OSError, KeyError, IndexError, RuntimeError) as error:
        raise ValueError(f"{folder}: is not whole: {error}") from None

    node = _numbers(folder, on_body["x"], body.x, "solution.h5")
    u, load = on_body["displacement"][node], on_body["load"][node]
    fixed = np.round(on_body["held"][node]).astype(bool)

    contact = np.round(on_face["status"]) != HELD
    at = {name: values[contact] for name, values in on_face.items()}
    of_node = _numbers(folder, body.x, at["x"], "contact.h5")
    frames = tangent_frames(at["normal"])
    force = -np.einsum("kij,kj->ki", frames, at["contact_force"])
    everywhere = np.zeros_like(u)
    everywhere[of_node] = at["contact_force"]
    pressing = np.maximum(force[:, 0], 0.0) if told["law"] == "coulomb" else at["area"]
    return judge(
        Evidence(
            comm=MPI.COMM_SELF,
            x=body.x,
            displacement=u,
            internal=body.internal_force(u),
            load=load,
            spring=on_body["spring"][node],
            fixed=fixed,
            prescribed=on_body["prescribed"][node],
            on_body=everywhere,
            force=force,
            closure=_closure(frames, u[of_node], at["slip_origin"]),
            gap=at["initial_gap"],
            bound=at["coefficient"] * pressing,
            rounding=rounding_forces(body, u),
            compliance=told["mean_compliance"],
        )
    )


def _closure(frames: FloatArray, u: FloatArray, origin: FloatArray) -> FloatArray:
    """u_n, and the slip along t1 and t2, shape (m, 3)."""
    closure: FloatArray = np.einsum("kij,kj->ki", frames, u)
    closure[:, 1:] -= np.einsum("kij,kj->ki", frames, origin)[:, 1:]
    return closure


def recorded(directory: str | Path) -> bool:
    """Whether the run itself recorded that its certificate passed.

    Raises:
        ValueError: If summary.json cannot be read.
    """
    return bool(_summary(Path(directory) / "summary.json")["certificate"]["passed"])


def _summary(path: Path) -> dict[str, Any]:
    try:
        told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path}: is not JSON: {error}") from None
    needed = ("law", "mean_compliance", "certificate")
    missing = [key for key in needed if not isinstance(told, dict) or key not in told]
    if missing:
        raise ValueError(f"{path}: has no {missing[0]!r}: not a summary of coulomb's, or of a version before 0.2")
    return told


def _on_cells(path: Path, name: str) -> FloatArray:
    """A field that is constant on every cell, cell by cell as the file has them."""
    with h5py.File(path, "r") as file:
        group = file[f"Function/{name}"]
        values = np.ravel(np.array(group[next(iter(group))], dtype=np.float64))
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{path}: {name} has entries that are not finite")
    return values


def _fields(path: Path, names: tuple[str, ...]) -> dict[str, FloatArray]:
    """Fields of a file of DOLFINx's, point by point of its mesh; vectors (k, 3), scalars (k,), coordinates "x"."""
    with h5py.File(path, "r") as file:
        fields: dict[str, FloatArray] = {"x": np.array(file["Mesh/mesh/geometry"], dtype=np.float64)}
        for name in names:
            group = file[f"Function/{name}"]
            values = np.array(group[next(iter(group))], dtype=np.float64)
            fields[name] = values[:, 0] if values.shape[1] == 1 else values
    for name in names:
        if len(fields[name]) != len(fields["x"]):
            raise ValueError(f"{path}: {name} does not fit to the mesh")
        if not np.all(np.isfinite(fields[name])):
            raise ValueError(f"{path}: {name} has entries that are not finite")
    return fields


def _numbers(folder: Path, points: FloatArray, wanted: FloatArray, what: str) -> Any:
    """For every wanted point its number among the points."""
    size = float(np.max(np.ptp(points, axis=0)))
    distance, number = cKDTree(points).query(wanted)
    if len(wanted) and not np.max(distance) <= 1e-9 * size:
        raise ValueError(f"{folder}: {what} does not fit to the mesh of solution.xdmf")
    return number
