"""A mesh whose boundary faces and cell groups have names."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from .. import compat
from .lagrange import corner_geometry


@dataclass(frozen=True)
class NamedMesh:
    """A mesh of a body, of degree 1 or 2, whose boundary faces, and perhaps groups of cells, have names.

    Attributes:
        domain: The DOLFINx mesh, coordinates in metres.
        faces: This rank's boundary facets of each face, by name; facet numbers of `domain`.
        cells: This rank's own cells of each group, by name; cell numbers of `domain`.
        refused: Groups of facets in the file that cannot be faces, by name, with the reason.
        components: How many components the mesh in the file has, which share no nodes; 1 if it is not from a file.
        touching: Places in metres at which nodes of several components coincide, those found on this rank, shape
            (k, 3).
    """

    domain: Any
    faces: dict[str, npt.NDArray[np.int32]]
    cells: dict[str, npt.NDArray[np.int32]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    components: int = 1
    touching: FloatArray = field(default_factory=lambda: np.empty((0, 3)), repr=False)

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share it."""
        return self.domain.comm

    @property
    def degree(self) -> int:
        """Order of the cells: 1, or 2 for 10-node tetrahedra and 27-node hexahedra."""
        return compat.geometry_degree(self.domain)

    def facets(self, face: str, what: str) -> npt.NDArray[np.int32]:
        """This rank's facets of a face; ValueError, beginning with `what`, if there is none."""
        if isinstance(face, str) and face in self.refused:
            raise ValueError(f"{what}: {self.refused[face]}")
        return _named(self.faces, face, what, "face")

    def group(self, cells: str, what: str) -> npt.NDArray[np.int32]:
        """This rank's own cells of a group; ValueError, beginning with `what`, if there is none."""
        return _named(self.cells, cells, what, "cell group")


def _named(groups: dict[str, npt.NDArray[np.int32]], name: str, what: str, kind: str) -> npt.NDArray[np.int32]:
    if not isinstance(name, str):
        raise ValueError(f"{what}: a {kind} is given by its name, text in quotation marks, but is {name!r}")
    if name not in groups:
        close = difflib.get_close_matches(name, groups, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        listed = f"its {kind}s are {', '.join(groups)}" if groups else f"it has no {kind}s"
        raise ValueError(f"{what}: there is no {kind} {name!r} on this mesh{hint}; {listed}")
    return groups[name]


_SIX = ((0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (0, 3, 2, 7), (0, 6, 4, 7), (0, 2, 6, 7))
"""A hexahedron with DOLFINx's order of corners as six tetrahedra."""


def aspects(named: NamedMesh) -> FloatArray:
    """Longest over shortest extent of this rank's own cells along their principal axes, by their corners, shape (k,):
    1 for a cube or a regular tetrahedron, 1 + sqrt(2) for six tetrahedra that fill a cube."""
    domain = named.domain
    owned = domain.topology.index_map(3).size_local
    corners = domain.geometry.x[corner_geometry(domain)[:owned]]
    from_middle = corners - corners.mean(axis=1, keepdims=True)
    squares = np.linalg.eigvalsh(np.einsum("kvi,kvj->kij", from_middle, from_middle))
    found: FloatArray = np.sqrt(squares[:, 2] / squares[:, 0])
    return found


def volume(named: NamedMesh) -> float:
    """Volume in cubic metres of this rank's own cells by their corners; non-planar faces are split into triangles."""
    domain = named.domain
    owned = domain.topology.index_map(3).size_local
    corners = domain.geometry.x[corner_geometry(domain)[:owned]]
    parts = ((0, 1, 2, 3),) if corners.shape[1] == 4 else _SIX
    total = 0.0
    for a, b, c, d in parts:
        edges = corners[:, [b, c, d]] - corners[:, [a]]
        total += float(np.sum(np.abs(np.linalg.det(edges)))) / 6.0
    return total
