"""Coarser meshes of bodies of first order: of hexahedra by taking out sheets (`extract_sheets`), of tetrahedra by MMG's
`mmg3d_O3`, a program of its own that PyPI's package mmgpy has (https://www.mmgtools.org; C. Dapogny, C. Dobrzynski and
P. Frey, J. Comput. Phys. 262, 2014).

MMG keeps borders of faces and of groups of cells, edges and corners, and moves nodes of the boundary on the smooth
surface for which the facets stand.
"""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from ...arrays import distinct
from .. import compat
from .among_ranks import on_first_rank
from .curving import CREASE, arcs, put_on_surfaces
from .inspection import InspectedMesh
from .mesh_file import FACETS
from .mesh_parts import places, sets
from .meshes import from_first_rank, refuse_flat_cells
from .meshio_format import by_meshio
from .named_mesh import NamedMesh
from .sheet_extraction import extract_sheets
from .xdmf_writing import gathered

LONGER: Final = 2.0
"""Factor of the lengths of edges."""

LEAST = {4: 1.3, 8: 1.05}
"""Least ratio of cell sizes, (cells/coarser cells)^(1/3), by corners of a cell: where a body is a cell thick tetrahedra
stay, as hexahedra do by `sheet_extraction.SEEN`."""

GRADATION: Final = 1.5
"""Largest ratio of the lengths of two edges at one corner."""

_NUMBERS: Final = "medit:ref"
"""Of what facets and cells belong to, in MMG's files by meshio."""

_ENDS = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def coarsened(mesh: NamedMesh, again: bool = False) -> NamedMesh:
    """The body with cells about twice as large, of small ones and large ones; collective.

    Rank 0 makes it, and needs the memory for all of it.

    Args:
        mesh: First-order cells with named faces and groups of cells, which are kept.
        again: Whether it is one that this function made.

    Raises:
        ValueError: On every rank, if hardly fewer cells are found, or for tetrahedra if there is no MMG, or it fails.
    """
    hexahedra, off = mesh.domain.topology.cell_type.name == "hexahedron", 0.0
    if not hexahedra:
        off = float(np.linalg.norm(arcs(mesh)[1], axis=1).max(initial=0.0))
    whole = gathered(mesh)

    def coarser() -> InspectedMesh:
        coarse = extract_sheets(_sorted(whole), again) if hexahedra else _by_mmg(_sorted(whole), off)
        if len(whole.cells) < LEAST[whole.cells.shape[1]] ** 3 * len(coarse.cells):
            raise ValueError(f"{len(coarse.cells)} coarser cells for {len(whole.cells)} are hardly fewer")
        return coarse

    sound = on_first_rank(mesh.comm, "a coarser mesh", coarser)
    coarse = replace(from_first_rank(mesh.comm, "a coarser mesh", sound), surfaces=mesh.surfaces)
    put_on_surfaces(coarse)
    refuse_flat_cells(coarse.domain.geometry.x[compat.cell_geometry(coarse.domain)], "a coarser mesh", mesh.comm)
    return coarse


def mmg() -> Path | None:
    """The program: on the PATH, or where `install.sh` puts it."""
    program = shutil.which("mmg3d_O3") or shutil.which("mmg3d")
    ours = Path(sys.prefix, "mmg", "bin", "mmg3d_O3")
    return Path(program) if program else ours if ours.exists() else None


def _by_mmg(mesh: InspectedMesh, off: float) -> InspectedMesh:
    import meshio  # it takes 0.1 s to load, and may be missing

    program = mmg()
    if program is None:
        raise ValueError("coarser tetrahedra are made by MMG, whose mmg3d_O3 is not on the PATH")
    x, cells = mesh.points, mesh.cells
    sides = np.sort(cells[:, np.array(FACETS[4])].reshape(-1, 3), axis=1)
    first, number = distinct(sides)
    facets = sides[first][np.bincount(number) == 1]
    face_of, faces = sets(len(facets), {name: places(facets, rows) for name, rows in mesh.face_groups.items()})
    group_of, groups = sets(len(cells), mesh.cell_groups)
    length = np.linalg.norm(x[cells[:, _ENDS[:, 0]]] - x[cells[:, _ENDS[:, 1]]], axis=2).mean(axis=1)
    at, wanted = cells.ravel(), np.repeat(np.log(LONGER * length), 4)
    size = np.exp(np.bincount(at, wanted, len(x)) / np.maximum(np.bincount(at, minlength=len(x)), 1))
    given = meshio.Mesh(x, {"tetra": cells, "triangle": facets}, cell_data={_NUMBERS: [group_of, face_of]})
    with tempfile.TemporaryDirectory() as folder:
        old, new, sizes = (Path(folder, name) for name in ("old.mesh", "new.mesh", "old.sol"))
        meshio.medit.write(old, given)
        head = f"MeshVersionFormatted 2\nDimension 3\nSolAtVertices\n{len(x)}\n1 1"
        np.savetxt(sizes, size, fmt="%.17g", header=head, footer="End", comments="")
        libraries = os.pathsep.join([str(program.parent.parent / "lib64"), os.environ.get("LD_LIBRARY_PATH", "")])
        # How far new edges may be off the smooth surface: four times their middles, since MMG takes half the length.
        near = max(4.0 * LONGER**2 * off, 1e-3 * float(np.ptp(x, axis=0).max()))
        options = f"-v 0 -hgrad {GRADATION} -hausd {near} -ar {math.degrees(CREASE)} -m {200 + len(cells) // 250}"
        ran = subprocess.run(
            [str(program), *options.split(), "-in", str(old), "-sol", str(sizes), "-out", str(new)],
            capture_output=True,
            text=True,
            errors="replace",
            env={**os.environ, "LD_LIBRARY_PATH": libraries},
        )
        if ran.returncode or not new.exists():
            raise ValueError(f"MMG found no coarser tetrahedra: {(ran.stderr or ran.stdout).strip()[-300:]}")
        coarse = by_meshio(str(new), b"", "medit")
    rows, numbers = coarse.cells_dict, coarse.cell_data_dict[_NUMBERS]
    of_group, of_face = groups[numbers["tetra"]], faces[numbers["triangle"]]
    facets = np.sort(rows["triangle"].astype(np.int64), axis=1)
    return InspectedMesh(
        coarse.points,
        rows["tetra"].astype(np.int64),
        {name: np.flatnonzero(of_group[:, k]) for k, name in enumerate(mesh.cell_groups)},
        {name: facets[of_face[:, k]] for k, name in enumerate(mesh.face_groups)},
        {},
    )


def _sorted(mesh: InspectedMesh) -> InspectedMesh:
    """With points and cells in an order that does not depend on the number of ranks, as what is made depends on it; and
    with corners of tetrahedra in ascending order: MMG turns those that are mirrored."""
    order = np.lexsort(mesh.points.T)
    x, number = mesh.points[order], np.argsort(order)
    cells = number[mesh.cells]
    ascending = np.sort(cells, axis=1)
    order = np.lexsort(ascending.T[::-1])
    cells, place = (ascending if cells.shape[1] == 4 else cells)[order], np.argsort(order)
    return InspectedMesh(
        x,
        cells,
        {name: np.sort(place[members]) for name, members in mesh.cell_groups.items()},
        {name: np.sort(number[rows], axis=1) for name, rows in mesh.face_groups.items()},
        {},
    )
