"""Other meshes of bodies of tetrahedra, finer or coarser, by MMG's `mmg3d_O3`: a program of its own that PyPI's package
mmgpy has (https://www.mmgtools.org; C. Dapogny, C. Dobrzynski and P. Frey, J. Comput. Phys. 262, 2014).

MMG keeps borders of faces and of groups of cells, edges and corners, and moves nodes of the boundary on the smooth
surface for which the facets stand.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray, IntArray
from .curving import CREASE
from .exchange import on_first_rank
from .inspection import InspectedMesh
from .meshes import first_order, from_first_rank, smooth_second_order
from .named_mesh import NamedMesh
from .refinement import distinct
from .xdmf_writing import gathered

GRADATION = 1.5
"""Largest ratio of the lengths of two edges at one corner."""

_SIDES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
_ENDS = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def remeshed(mesh: NamedMesh, factor: FloatArray) -> NamedMesh:
    """The body with other tetrahedra; collective.

    Rank 0 makes it, and needs the memory for all of it.

    Args:
        mesh: Tetrahedra of first or second order with named faces and groups of cells, which are kept.
        factor: Of the lengths of edges, at this rank's own cells, shape (k,).

    Raises:
        ValueError: On every rank, if there is no MMG, or it fails.
    """
    whole = gathered(mesh if mesh.degree == 1 else first_order(mesh))
    every = mesh.comm.gather(factor)
    sound = on_first_rank(mesh.comm, "other tetrahedra", lambda: _by_mmg(whole, np.concatenate(every)))
    made = from_first_rank(mesh.comm, "other tetrahedra", sound)
    return made if mesh.degree == 1 else smooth_second_order(made)


def mmg() -> Path | None:
    """The program: on the PATH, or where `install.sh` puts it."""
    found = shutil.which("mmg3d_O3") or shutil.which("mmg3d")
    ours = Path(sys.prefix, "mmg", "bin", "mmg3d_O3")
    return Path(found) if found else ours if ours.exists() else None


def _by_mmg(mesh: InspectedMesh, factor: FloatArray) -> InspectedMesh:
    program = mmg()
    if program is None:
        raise ValueError("other tetrahedra are made by MMG, whose mmg3d_O3 is not on the PATH")
    x, cells = mesh.points, mesh.cells
    sides = np.sort(cells[:, _SIDES].reshape(-1, 3), axis=1)
    first, number = distinct(sides)
    facets = sides[first][np.bincount(number) == 1]
    face_of, faces = _sets(len(facets), {name: _places(facets, rows) for name, rows in mesh.face_groups.items()})
    group_of, groups = _sets(len(cells), mesh.cell_groups)
    length = np.linalg.norm(x[cells[:, _ENDS[:, 0]]] - x[cells[:, _ENDS[:, 1]]], axis=2).mean(axis=1)
    at, wanted = cells.ravel(), np.repeat(np.log(factor * length), 4)
    size = np.exp(np.bincount(at, wanted, len(x)) / np.maximum(np.bincount(at, minlength=len(x)), 1))
    # Corners on the boundary stay, unless there shall be fewer: they are on the surface, which others only approximate.
    kept = np.unique(facets) if np.max(factor) <= 1.0 else facets[:0, 0]
    none = np.empty((len(kept), 0), dtype=np.int64)
    parts = {
        "Vertices": (x, np.zeros(len(x))),
        "Tetrahedra": (cells + 1, group_of),
        "Triangles": (facets + 1, face_of),
        "RequiredVertices": (none, kept + 1),
    }
    with tempfile.TemporaryDirectory() as folder:
        old, new, sizes = (Path(folder, name) for name in ("old.mesh", "new.mesh", "old.sol"))
        _write(old, parts)
        _write(sizes, {"SolAtVertices": (np.empty((len(x), 0)), size)}, "1 1\n")
        libraries = os.pathsep.join([str(program.parent.parent / "lib64"), os.environ.get("LD_LIBRARY_PATH", "")])
        most = int(np.sum(np.maximum(factor**-3.0, 1.0)))
        extent = float(np.ptp(x, axis=0).max())  # of the distance from the surface that sizes obey
        ran = subprocess.run(
            [
                str(program),
                "-v",
                "0",
                "-hgrad",
                repr(GRADATION),
                "-hausd",
                repr(extent),
                "-ar",
                repr(np.degrees(CREASE)),
            ]
            + ["-m", str(200 + most // 250), "-in", str(old), "-sol", str(sizes), "-out", str(new)],
            capture_output=True,
            text=True,
            errors="replace",
            env={**os.environ, "LD_LIBRARY_PATH": libraries},
        )
        if ran.returncode or not new.exists():
            raise ValueError(f"MMG found no other tetrahedra: {(ran.stderr or ran.stdout).strip()[-300:]}")
        text = new.read_text()
    points, tetrahedra, triangles = (
        _rows(text, "Vertices", 4),
        _rows(text, "Tetrahedra", 5),
        _rows(text, "Triangles", 4),
    )
    facets = np.sort(triangles[:, :3].astype(np.int64) - 1, axis=1)
    of_face, of_group = faces[triangles[:, -1].astype(np.int64)], groups[tetrahedra[:, -1].astype(np.int64)]
    return InspectedMesh(
        points[:, :3],
        tetrahedra[:, :4].astype(np.int64) - 1,
        {name: np.flatnonzero(of_group[:, k]) for k, name in enumerate(mesh.cell_groups)},
        {name: facets[of_face[:, k]] for k, name in enumerate(mesh.face_groups)},
        {},
    )


def _places(rows: IntArray, some: IntArray) -> IntArray:
    """Where some rows are among distinct rows."""
    first, number = distinct(np.vstack([rows, some]))
    return first[number[len(rows) :]]


def _sets(count: int, groups: Mapping[str, IntArray]) -> tuple[IntArray, npt.NDArray[np.bool_]]:
    """Of so many things with groups of some, the number of the set of groups that each is in, shape (count,), and which
    groups are in each set, shape (sets, groups)."""
    member = np.zeros((count, len(groups)), dtype=bool)
    for k, some in enumerate(groups.values()):
        member[some, k] = True
    first, number = distinct(np.column_stack([np.zeros((count, 2), dtype=np.int64), member]))
    return number, member[first]


def _write(
    path: Path, parts: Mapping[str, tuple[npt.NDArray[np.generic], npt.NDArray[np.generic]]], kind: str = ""
) -> None:
    """A file of MMG: rows of each part with a last column, whole numbers but for the places of vertices."""
    with path.open("w") as file:
        file.write("MeshVersionFormatted 2\nDimension 3\n")
        for name, (rows, last) in parts.items():
            file.write(f"{name}\n{len(rows)}\n{kind}")
            np.savetxt(file, np.column_stack([rows, last]), fmt="%d" if rows.dtype.kind == "i" else "%.17g")
        file.write("End\n")


def _rows(text: str, name: str, width: int) -> FloatArray:
    start = text.index("\n", text.index(f"\n{name}\n") + 1) + 1
    end = text.index("\n", start)
    count = int(text[start:end])
    found: FloatArray = np.fromstring(text[end:], sep=" ", count=count * width)
    return found.reshape(count, width)
