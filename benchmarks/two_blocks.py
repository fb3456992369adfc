"""An aluminium block on a steel block, meshes that do not match: pressed down, pulled along, pushed across, lifted.

The steel block is clamped below.  The aluminium block stands on it, inside its upper face, with cells 4/5 as large.  A
pressure on its top presses it down, an oblique traction on its right face pulls it along and lifts that end, a smaller
traction pushes it across.  It sticks on the left, slips towards the pulled end, and is open there.  A spring on its
left face takes an eighth of the pull: without it contact alone holds the block, and the linear systems of codes with
penalties or augmented Lagrangians are singular until they have found some.

The meshes are plain arrays, from which every code makes its own.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse

from coulomb.arrays import FloatArray, IntArray
from coulomb.fem.bodies import Clamp, Material, Spring, Traction, join
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from verification.array_mesh import SIDES, mesh_of_arrays

HEIGHT = 0.5
"""z of the contact plane, in metres."""

FRICTION = 0.3
SPRING = 1e11
"""On the left face of the upper block, all directions, in N/m^3."""

TRACTIONS = {"top": (0.0, 2e6, -2e7), "right": (1.4e7, 0.0, 1.2e7)}
"""On faces of the upper block, in pascals."""


class Block(NamedTuple):
    """One of the blocks.

    Attributes:
        young: Young's modulus in pascals.
        poisson: Poisson's ratio.
        near: Corner with the smallest coordinates, in metres.
        far: The opposite corner.
        finer: Cells per metre over those asked for.
    """

    young: float
    poisson: float
    near: tuple[float, float, float]
    far: tuple[float, float, float]
    finer: float


LOWER = Block(2.119e11, 0.277, (0.0, 0.0, 0.0), (3.0, 1.0, HEIGHT), 1.0)
UPPER = Block(7e10, 0.33, (0.55, 0.05, HEIGHT), (2.45, 0.95, 2.0 * HEIGHT), 1.25)
BLOCKS = {"lower": LOWER, "upper": UPPER}


class Face(NamedTuple):
    """A face of a mesh.

    Attributes:
        cells: The cell of every facet, shape (q,).
        corners: Its nodes in cyclic order, shape (q, 4).
    """

    cells: IntArray
    corners: IntArray


class Grid(NamedTuple):
    """The mesh of a block.

    Attributes:
        points: Nodes in metres, shape (k, 3); x varies fastest.
        cells: Hexahedra, shape (c, 8): four nodes below, counterclockwise seen from above, then those above them.
        faces: left, right (x), front, back (y), bottom, top (z).
        lines: Coordinates of the planes of nodes along x, y and z, shapes (n + 1,).
    """

    points: FloatArray
    cells: IntArray
    faces: dict[str, Face]
    lines: list[FloatArray]

    def loads(self, tractions: dict[str, tuple[float, float, float]]) -> FloatArray:
        """Nodal forces of uniform tractions on faces, in newtons, shape (k, 3)."""
        load = np.zeros_like(self.points)
        for name, traction in tractions.items():
            load += np.outer(self.areas(name), traction)
        return load

    def areas(self, face: str) -> FloatArray:
        """Integrals of the nodes' hat functions over a face, in square metres, shape (k,)."""
        corners = self.faces[face].corners
        a, b, _, d = np.moveaxis(self.points[corners], 1, 0)
        area = np.linalg.norm(np.cross(b - a, d - a), axis=1)  # of rectangles
        areas = np.zeros(len(self.points))
        np.add.at(areas, corners, area[:, None] / 4.0)
        return areas

    def products(self, face: str) -> scipy.sparse.coo_matrix:
        """Integrals of products of two nodes' hat functions over a face, in square metres, shape (k, k)."""
        corners = self.faces[face].corners
        a, b, _, d = np.moveaxis(self.points[corners], 1, 0)
        area = np.linalg.norm(np.cross(b - a, d - a), axis=1)  # of rectangles
        of_facet = np.array([[4, 2, 1, 2], [2, 4, 2, 1], [1, 2, 4, 2], [2, 1, 2, 4]]) / 36.0
        rows, columns = np.repeat(corners, 4, axis=1).ravel(), np.tile(corners, 4).ravel()
        size = len(self.points)
        summed = scipy.sparse.coo_matrix((np.outer(area, of_facet).ravel(), (rows, columns)), (size, size))
        return summed.tocsr().tocoo()


CORNERS = dict(zip(("bottom", "top", "front", "right", "back", "left"), SIDES, strict=True))
"""Nodes of a cell on its faces, in the order of faces 1 to 6 of Abaqus and CalculiX."""


def grid(block: Block, p: int) -> Grid:
    """The mesh of a block for p cells per metre of the lower block, about 1.25 p of the upper one."""
    near, far = np.array(block.near), np.array(block.far)
    n = [max(1, round(length * block.finer * p)) for length in far - near]
    lines = [np.linspace(a, b, count + 1) for a, b, count in zip(near, far, n, strict=True)]
    z, y, x = np.meshgrid(*reversed(lines), indexing="ij")
    number = np.arange(x.size, dtype=np.int64).reshape(x.shape)
    around = ((0, 0), (0, 1), (1, 1), (1, 0))
    cells = np.column_stack(
        [number[c : c + n[2], b : b + n[1], a : a + n[0]].ravel() for c in (0, 1) for b, a in around]
    )
    cell = np.arange(len(cells), dtype=np.int64).reshape(n[2], n[1], n[0])
    of_face = {
        **{"left": cell[:, :, 0], "right": cell[:, :, -1], "front": cell[:, 0], "back": cell[:, -1]},
        **{"bottom": cell[0], "top": cell[-1]},
    }
    faces = {name: Face(own.ravel(), cells[own.ravel()][:, CORNERS[name]]) for name, own in of_face.items()}
    return Grid(np.column_stack([x.ravel(), y.ravel(), z.ravel()]), cells, faces, lines)


def two_blocks(p: int, friction: float = FRICTION, spring: float = SPRING, **options: Any) -> ContactProblem:
    """The two blocks with p cells per metre of the lower one; `options` are ContactProblem's.

    Args:
        p: Cells per metre of the lower block.
        friction: Friction coefficient.
        spring: Stiffness of the spring in N/m^3; 0 leaves the upper block to contact alone.
        **options: Passed on.
    """
    grids = {name: grid(block, p) for name, block in BLOCKS.items()}
    meshes = {
        name: mesh_of_arrays(made.points, made.cells, {face: of.corners for face, of in made.faces.items()})
        for name, made in grids.items()
    }
    return ContactProblem(
        join(meshes),
        {name: Material(young=block.young, poisson=block.poisson) for name, block in BLOCKS.items()},
        [Clamp("lower:bottom")],
        Contact("upper:bottom", friction, against="lower:top"),
        [Traction(f"upper:{face}", traction) for face, traction in TRACTIONS.items()],
        springs=[Spring("upper:left", spring)] if spring else [],
        **options,
    )
