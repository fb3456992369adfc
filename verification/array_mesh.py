"""Graded lines of nodes, meshes of hexahedra from plain arrays, quarters of cylinders and of rings, layers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mpi4py import MPI

from coulomb.arrays import FloatArray, IntArray
from coulomb.fem.bodies import midpoints
from coulomb.fem.meshes import NamedMesh, box, distributed, local_facets

SIDES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
"""Nodes of a cell on its faces, in cyclic order; faces 1 to 6 of Abaqus and CalculiX."""


def growing(first: float, length: float, cells: int) -> FloatArray:
    """Ends of cells that fill a length, each larger than the one before by the same factor, shape (cells,)."""

    def filled(q: float) -> float:
        return first * float(np.sum(q ** np.arange(cells)))

    low, high = 1.0, 1.0 + (length / first) ** (1.0 / max(cells - 1, 1))
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if filled(middle) < length else (low, middle)
    ends: FloatArray = np.cumsum(first * low ** np.arange(cells))
    ends[-1] = length
    return ends


def graded(first: float, uniform: int, end: float, more: int, jump: float = 1.3) -> FloatArray:
    """Ends of cells from 0 to `end`: the first ones uniform, `more` growing, the first of these by `jump`."""
    inner = first * np.arange(uniform + 1.0)
    return np.concatenate([inner, inner[-1] + growing(jump * first, end - inner[-1], more)])


def between(ends: FloatArray, k: FloatArray) -> FloatArray:
    """Places of the numbers k among ends of cells, linear between them."""
    places: FloatArray = np.interp(k, np.arange(float(len(ends))), ends)
    return places


def mesh_of_arrays(
    points: FloatArray, cells: IntArray, faces: Mapping[str, IntArray], comm: MPI.Comm = MPI.COMM_WORLD
) -> NamedMesh:
    """A mesh of hexahedra; collective, with the same arrays on every rank.

    Args:
        points: Nodes in metres, shape (k, 3).
        cells: Hexahedra in VTK's order, shape (c, 8).
        faces: Corners of the facets of each face by name, in any order, shape (q, 4); facets inside are left out.
        comm: The ranks that share the mesh.
    """
    sorted_rows = {name: np.sort(rows, axis=1) for name, rows in faces.items()}
    if comm.rank > 0:
        points, cells = np.empty((0, 3)), np.empty((0, 8), dtype=np.int64)
        sorted_rows = {name: rows[:0] for name, rows in sorted_rows.items()}
    domain = distributed(comm, points, cells)
    return NamedMesh(domain, local_facets(domain, sorted_rows))


def quarter_disc(cells: int, core: float, radii: FloatArray) -> tuple[FloatArray, IntArray]:
    """A quarter of a disc, x >= 0 and y >= 0, of quadrilaterals: a core around the axis, and rings.

    Args:
        cells: Cells along each of the two straight sides of the core; there are twice as many around the quarter.
        core: Length of these sides.
        radii: Of the circles of nodes, each larger than the one before, the first larger than `core`.

    Returns:
        Nodes, shape (k, 2), and quadrilaterals, counterclockwise, shape (q, 4).
    """
    s = np.linspace(0.0, 1.0, cells + 1)
    x, y = np.meshgrid(s, s)
    inside = core * np.column_stack([(x - _BULGE * x * y).ravel(), (y - _BULGE * x * y).ravel()])
    number = np.arange((cells + 1) ** 2, dtype=np.int64).reshape(cells + 1, cells + 1)  # rows along y
    quads = [_between(number)]
    angles = np.linspace(0.0, 0.5 * np.pi, 2 * cells + 1)
    inner = np.concatenate([number[:, -1], number[-1, -2::-1]])  # from the x axis to the y axis
    points = [inside]
    count = len(inside)
    for radius in radii:
        outer = np.arange(count, count + len(angles), dtype=np.int64)
        points.append(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
        count += len(angles)
        quads.append(np.column_stack([inner[:-1], outer[:-1], outer[1:], inner[1:]]))
        inner = outer
    return np.concatenate(points), np.concatenate(quads)


_BULGE = 0.25
"""How far the corner of the core is drawn to the axis, over the length of its sides: its angle is then 118 degrees."""


def _between(number: IntArray) -> IntArray:
    """Quadrilaterals of a grid of nodes, shape (q, 4)."""
    quads: IntArray = np.column_stack(
        [number[:-1, :-1].ravel(), number[:-1, 1:].ravel(), number[1:, 1:].ravel(), number[1:, :-1].ravel()]
    )
    return quads


def quarter_cylinder(disc: tuple[FloatArray, IntArray], levels: FloatArray) -> NamedMesh:
    """A quarter of a body of revolution; collective.

    Args:
        disc: Of `quarter_disc`.
        levels: z of the nodes above each node of the disc, shape (k, layers + 1), rising.

    Returns:
        Its mesh; faces left (x = 0) and front (y = 0), which are planes of symmetry, rim, bottom and top.
    """
    plane, quads = disc
    layers = levels.shape[1] - 1
    k = len(plane)
    points = np.column_stack([np.tile(plane, (layers + 1, 1)), levels.T.ravel()])
    cells = np.concatenate([np.hstack([quads + k * layer, quads + k * (layer + 1)]) for layer in range(layers)])
    sides = np.concatenate([cells[:, side] for side in SIDES[2:]])
    x, y = plane[sides % k].transpose(2, 0, 1)
    near = 1e-9 * np.abs(plane).max()
    outermost = np.hypot(x, y) > np.hypot(*plane.T).max() - near
    faces = {
        "left": sides[np.all(np.abs(x) < near, axis=1)],
        "front": sides[np.all(np.abs(y) < near, axis=1)],
        "rim": sides[np.all(outermost, axis=1)],
        "bottom": quads,
        "top": quads + k * layers,
    }
    return mesh_of_arrays(points, cells, faces)


def quarter_ring(
    inner: float, outer: float, length: float, cells: tuple[int, int, int], cell: str = "hexahedron", degree: int = 1
) -> NamedMesh:
    """Cells along the radius, around, along z; faces left (its bore), right, front and back (planes of symmetry)."""

    def place(k: FloatArray) -> FloatArray:
        r, angle = inner + (outer - inner) * k[0], 0.5 * np.pi * k[1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), length * k[2]])

    return box((1.0, 1.0, 1.0), cells, cell, place=place, degree=degree)


def cored_box(lengths: tuple[float, float, float], n: int, layers: int) -> NamedMesh:
    """A box of hexahedra as of files, along z in layers: in each a skew core of n x n cells, and between each of its
    sides and one of the box as many; collective.  Faces as of `box`."""
    outer = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    core = np.array([(0.25, 0.35), (0.7, 0.25), (0.75, 0.65), (0.3, 0.75)])
    around = [np.array([outer[k], outer[k - 3], core[k - 3], core[k]]) for k in range(4)]
    t = np.linspace(0.0, 1.0, n + 1)
    x, y = (one[..., None] for one in np.meshgrid(t, t))
    blocks = [(1 - x) * (1 - y) * a + x * (1 - y) * b + x * y * c + (1 - x) * y * d for a, b, c, d in [core, *around]]
    every = np.concatenate([block.reshape(-1, 2) for block in blocks])
    _, first, number = np.unique(np.round(every, 9), axis=0, return_index=True, return_inverse=True)
    quads = np.concatenate([_between(part) for part in number.reshape(len(blocks), n + 1, n + 1)])
    plane, k = every[first], len(first)
    z = np.repeat(np.linspace(0.0, 1.0, layers + 1), k)
    points = np.column_stack([np.tile(plane, (layers + 1, 1)), z])
    cells = np.concatenate([np.hstack([quads + k * layer, quads + k * (layer + 1)]) for layer in range(layers)])
    sides = np.concatenate([cells[:, side] for side in SIDES])
    at = points[sides]
    faces = {
        name: sides[np.all(np.abs(at[:, :, axis] - end) < 1e-9, axis=1)]
        for axis, names in enumerate((("left", "right"), ("front", "back"), ("bottom", "top")))
        for end, name in enumerate(names)
    }
    return mesh_of_arrays(np.array(lengths) * points, cells, faces)


def in_layers(mesh: NamedMesh, z: float, below: str, above: str) -> NamedMesh:
    """With two groups of cells, below and above z."""
    own = midpoints(mesh.domain)[: mesh.domain.topology.index_map(3).size_local, 2]
    groups = {below: np.flatnonzero(own < z), above: np.flatnonzero(own > z)}
    return NamedMesh(mesh.domain, mesh.faces, {name: cells.astype(np.int32) for name, cells in groups.items()})
