"""Meshes with named boundary faces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from .compat import mesh
from .fields import evaluate_vectors

BOX_FACES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0), "top": (2, 1)}
"""Faces of a box: axis, and whether at its lower (0) or upper (1) end."""

CELLS = {"hexahedron": mesh.CellType.hexahedron, "tetrahedron": mesh.CellType.tetrahedron}


@dataclass(frozen=True)
class NamedMesh:
    """A first-order mesh of a body whose boundary faces have names.

    Attributes:
        domain: The DOLFINx mesh, coordinates in metres.
        faces: This rank's boundary facets of each face, by name; facet numbers of `domain`.
    """

    domain: Any
    faces: dict[str, npt.NDArray[np.int32]]

    @property
    def comm(self) -> MPI.Comm:
        comm: MPI.Comm = self.domain.comm
        return comm

    def facets(self, face: str, what: str) -> npt.NDArray[np.int32]:
        """This rank's facets of a face.

        Raises:
            ValueError: If there is no such face; `what` says who asks.
        """
        if face not in self.faces:
            raise ValueError(f"{what}: there is no face {face!r} on this mesh; its faces are {', '.join(self.faces)}")
        return self.faces[face]


def box(
    lengths: Sequence[float],
    cells: Sequence[int],
    cell: str = "hexahedron",
    comm: MPI.Comm = MPI.COMM_WORLD,
    place: Callable[[FloatArray], FloatArray] | None = None,
) -> NamedMesh:
    """Box (0, lengths) with the faces left, right (x), front, back (y), bottom, top (z).

    Args:
        lengths: Edges in metres, three of them.
        cells: Cells along each edge.
        cell: "hexahedron", or "tetrahedron" (each hexahedron cut into six).
        comm: The ranks that share the mesh.
        place: Where the nodes x (3, k) of the regular box go, shape (3, k): for graded meshes and curved bodies.

    Raises:
        ValueError: If a length or a number of cells is not positive, the cell unknown, or a node placed nowhere.
    """
    if len(lengths) != 3 or not all(np.isfinite(length) and length > 0.0 for length in lengths):
        raise ValueError(f"box: lengths must be three positive numbers in metres, but are {list(lengths)}")
    if len(cells) != 3 or not all(int(n) == n and n >= 1 for n in cells):
        raise ValueError(f"box: cells must be three whole numbers of at least 1, but are {list(cells)}")
    if cell not in CELLS:
        raise ValueError(f"box: cell must be one of {', '.join(CELLS)}, but is {cell!r}")
    corner = np.array(lengths, dtype=np.float64)
    domain = mesh.create_box(comm, [np.zeros(3), corner], [int(n) for n in cells], cell_type=CELLS[cell])
    near = 1e-6 * corner / np.asarray(cells)
    faces = {}
    for name, (axis, end) in BOX_FACES.items():
        faces[name] = mesh.locate_entities_boundary(
            domain, 2, lambda x, i=axis, e=end: np.abs(x[i] - e * corner[i]) < near[i]
        )
    if place is not None:
        x = domain.geometry.x
        x[:] = evaluate_vectors(place, x.copy(), "box: place", comm)
    return NamedMesh(domain, faces)
