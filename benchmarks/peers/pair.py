"""What two blocks in contact are compared by, from the displacements that a package has computed, for all alike."""

from __future__ import annotations

import numpy as np

from coulomb.arrays import FloatArray, IntArray

from ..two_blocks import HEIGHT, LOWER, SPRING, TRACTIONS, UPPER, Block, Grid, grid
from .answer import Answer, Figures


def answer(
    p: int, lower: FloatArray, upper: FloatArray, seconds: float, iterations: int, peak_memory_bytes: int = 0
) -> Answer:
    """The answer of displacements of the nodes of the blocks in metres, shapes (k, 3) in the order of their grids.

    Contact forces are what the upper block lacks to equilibrium at its lower face.
    """
    below, above = grid(LOWER, p), grid(UPPER, p)
    contact = np.unique(above.faces["bottom"].corners)
    points = above.points[contact]
    forces = (_internal_forces(UPPER, above, upper) - above.loads(TRACTIONS))[contact]
    forces += SPRING * (above.products("left") @ upper)[contact]
    slip = np.linalg.norm((upper[contact] - _on_top(below, lower, points))[:, :2], axis=1)
    total = forces.sum(axis=0)
    figures = Figures(
        float(total[2]),
        float(np.hypot(total[0], total[1])),
        float(slip.max()),
        float(np.linalg.norm(upper.mean(axis=0))),
    )
    return Answer(seconds, iterations, points, forces, peak_memory_bytes, figures)


def _on_top(below: Grid, u: FloatArray, points: FloatArray) -> FloatArray:
    """Displacements of the lower block's upper face at places on it, shape (m, 3)."""
    x, y, _ = below.lines
    top = u[below.points[:, 2] == HEIGHT].reshape(len(y), len(x), 3)
    (i, s), (j, t) = (_located(line, points[:, axis]) for axis, line in enumerate((x, y)))
    near, far = ((1.0 - s) * top[j + k, i] + s * top[j + k, i + 1] for k in (0, 1))
    between: FloatArray = (1.0 - t) * near + t * far
    return between


def _located(line: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """Intervals of a line of nodes, and relative places within them, shape (m, 1)."""
    k = np.clip(np.searchsorted(line, at) - 1, 0, len(line) - 2)
    return k, ((at - line[k]) / (line[k + 1] - line[k]))[:, None]


def _internal_forces(block: Block, made: Grid, u: FloatArray) -> FloatArray:
    """K u of one of the blocks, whose cells are all alike, shape (k, 3)."""
    stiffness = _cell_stiffness(block.young, block.poisson, made.points[made.cells[0]])
    of_cells = (u[made.cells].reshape(-1, 24) @ stiffness).reshape(-1, 3)
    nodes = made.cells.ravel()
    return np.column_stack([np.bincount(nodes, of_cells[:, axis], len(u)) for axis in range(3)])


def _cell_stiffness(young: float, poisson: float, corners: FloatArray) -> FloatArray:
    """Of a trilinear hexahedron with edges along the axes, by 2 x 2 x 2 Gauss points, shape (24, 24)."""
    edges = corners[6] - corners[0]
    signs = np.sign(corners - corners.mean(axis=0))
    shear = young / (2.0 * (1.0 + poisson))
    lame = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    identity = np.eye(3)
    stiffness = np.zeros((8, 3, 8, 3))
    for point in signs / np.sqrt(3.0):
        factors = 0.5 * (1.0 + signs * point)
        slopes = np.column_stack(
            [signs[:, a] / edges[a] * np.delete(factors, a, axis=1).prod(axis=1) for a in range(3)]
        )
        stiffness += lame * np.einsum("ai,bj->aibj", slopes, slopes)
        stiffness += shear * np.einsum("aj,bi->aibj", slopes, slopes)
        stiffness += shear * np.einsum("ak,bk,ij->aibj", slopes, slopes, identity)
    whole: FloatArray = stiffness.reshape(24, 24) * np.prod(edges) / 8.0
    return whole
