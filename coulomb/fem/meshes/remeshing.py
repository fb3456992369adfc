"""Other meshes of bodies of tetrahedra, finer or coarser, by MMG's `mmg3d_O3`: a program of its own that PyPI's package
mmgpy has (https://www.mmgtools.org; C. Dapogny, C. Dobrzynski and P. Frey, J. Comput. Phys. 262, 2014).

MMG keeps borders of faces and of groups of cells, edges and corners.  Where cells become larger it moves nodes of the
boundary on the smooth surface for which the facets stand; where none does, all corners on the boundary stay, and new
ones are on the facets.
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
from mpi4py import MPI

from ...arrays import FloatArray, IntArray
from .. import compat
from .curving import CREASE, arcs
from .exchange import on_first_rank
from .inspection import InspectedMesh
from .lagrange import corner_geometry, corners_to_nodes
from .meshes import first_order, from_first_rank, second_order
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
        mesh: Tetrahedra of first order, or of second order with straight edges, with named faces and groups of cells,
            which are kept.
        factor: Of the lengths of edges, at this rank's own cells, shape (k,).

    Raises:
        ValueError: On every rank, if there is no MMG, or it fails, or cells are curved.
    """
    if mesh.degree == 2 and _curved(mesh):
        raise ValueError("MMG takes straight edges, but some of the second-order cells are curved")
    straight = mesh if mesh.degree == 1 else first_order(mesh)
    off = float(np.linalg.norm(arcs(straight)[1], axis=1).max(initial=0.0))
    whole, every = gathered(straight), mesh.comm.gather(factor)
    sound = on_first_rank(mesh.comm, "other tetrahedra", lambda: _by_mmg(whole, np.concatenate(every or []), off))
    made = from_first_rank(mesh.comm, "other tetrahedra", sound)
    return made if mesh.degree == 1 else second_order(made)


def _curved(mesh: NamedMesh) -> bool:
    domain = mesh.domain
    chords = corners_to_nodes(domain.topology.cell_type) @ domain.geometry.x[corner_geometry(domain)]
    off = np.linalg.norm(domain.geometry.x[compat.cell_geometry(domain)] - chords, axis=2).max(initial=0.0)
    size = np.ptp(chords, axis=1).max(initial=0.0)
    return bool(mesh.comm.allreduce(float(off), op=MPI.MAX) > 1e-6 * mesh.comm.allreduce(float(size), op=MPI.MAX))


def mmg() -> Path | None:
    """The program: on the PATH, or where `install.sh` puts it."""
    found = shutil.which("mmg3d_O3") or shutil.which("mmg3d")
    ours = Path(sys.prefix, "mmg", "bin", "mmg3d_O3")
    return Path(found) if found else ours if ours.exists() else None


def _by_mmg(mesh: InspectedMesh, factor: FloatArray, off: float) -> InspectedMesh:
    program = mmg()
    if program is None:
        raise ValueError("other tetrahedra are made by MMG, whose mmg3d_O3 is not on the PATH")
    mesh, factor = _sorted(mesh, factor)
    x, cells = mesh.points, mesh.cells
    sides = np.sort(cells[:, _SIDES].reshape(-1, 3), axis=1)
    first, number = distinct(sides)
    facets = sides[first][np.bincount(number) == 1]
    face_of, faces = _sets(len(facets), {name: _places(facets, rows) for name, rows in mesh.face_groups.items()})
    group_of, groups = _sets(len(cells), mesh.cell_groups)
    length = np.linalg.norm(x[cells[:, _ENDS[:, 0]]] - x[cells[:, _ENDS[:, 1]]], axis=2).mean(axis=1)
    at, wanted = cells.ravel(), np.repeat(np.log(factor * length), 4)
    size = np.exp(np.bincount(at, wanted, len(x)) / np.maximum(np.bincount(at, minlength=len(x)), 1))
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
        # How far new edges may be off the smooth surface: their middles, four times as far since MMG takes half of it.
        larger = float(factor.max())
        near = max(off * (4.0 * larger**2 if larger > 1.0 else 1.0), 1e-3 * float(np.ptp(x, axis=0).max()))
        ran = subprocess.run(
            [
                str(program),
                "-v",
                "0",
                "-hgrad",
                repr(GRADATION),
                "-hausd",
                repr(near),
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


def _sorted(mesh: InspectedMesh, factor: FloatArray) -> tuple[InspectedMesh, FloatArray]:
    """With points and cells in an order that does not depend on the number of ranks: what MMG makes depends on it."""
    order = np.lexsort(mesh.points.T)
    x, number = mesh.points[order], _inverse(order)
    cells = np.sort(number[mesh.cells], axis=1)
    order = np.lexsort(cells.T[::-1])
    cells, place = cells[order], _inverse(order)
    edges = x[cells[:, 1:]] - x[cells[:, :1]]
    mirrored = np.linalg.det(edges) < 0.0
    cells[mirrored, 2:] = cells[mirrored, :1:-1]
    return InspectedMesh(
        x,
        cells,
        {name: np.sort(place[members]) for name, members in mesh.cell_groups.items()},
        {name: np.sort(number[rows], axis=1) for name, rows in mesh.face_groups.items()},
        {},
    ), factor[order]


def _inverse(order: IntArray) -> IntArray:
    found = np.empty_like(order)
    found[order] = np.arange(len(order))
    return found


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
