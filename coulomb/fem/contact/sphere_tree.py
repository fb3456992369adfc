"""Which facets straight lines can meet: a tree of spheres.

Unlike a search by distance it finds what is far away as well, such as a body that will come down on another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...arrays import FloatArray, IntArray
from ...nearest import tree_of

_CHILDREN: Final = 8
"""Of every node of the tree."""

_LINES: Final = 2048
"""Lines searched at once, so that memory stays small."""


@dataclass(frozen=True, eq=False)
class SphereTree:
    """Spheres around facets, around groups of them, and so on up to one.

    Attributes:
        order: The facets in the order of the lowest level.
        levels: Centres and radii in metres of the spheres, shape (4, k), from the top to the facets; the children of
            sphere i are those from 8 i on in the next level.
    """

    order: IntArray
    levels: tuple[FloatArray, ...]

    def before(
        self, centre: FloatArray, radius: FloatArray, normal: FloatArray, depth: float, reach: float
    ) -> tuple[IntArray, IntArray]:
        """Pairs (line, facet), ascending, whose spheres meet: lines from points (k, 3) along unit normals (k, 3), as
        cylinders of these radii (k,), from `depth` behind their points as far as `reach`, metres."""
        lines = np.column_stack([centre, normal, radius]).T.copy()  # component by component: faster
        pairs = [
            self._search(at, lines, depth, reach)
            for at in np.array_split(np.arange(len(centre)), len(centre) // _LINES + 1)
        ]
        line, facet = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        order = np.lexsort((facet, line))
        return line[order], facet[order]

    def _search(self, line: IntArray, lines: FloatArray, depth: float, reach: float) -> tuple[IntArray, IntArray]:
        first, lines = line[0] if len(line) else 0, lines[:, line]
        line = line - first
        sphere: IntArray = np.zeros(len(line), dtype=np.int64)
        for level, spheres in enumerate(self.levels):
            if level:
                line = np.repeat(line, _CHILDREN)
                sphere = (_CHILDREN * sphere[:, None] + np.arange(_CHILDREN)).ravel()
                there = sphere < spheres.shape[1]
                line, sphere = line[there], sphere[there]
            x, y, z = (spheres[i][sphere] - lines[i][line] for i in range(3))
            along = x * lines[3][line] + y * lines[4][line] + z * lines[5][line]
            around = spheres[3][sphere]
            meets = x * x + y * y + z * z - along * along < (1.0 + 1e-9) * (lines[6][line] + around) ** 2
            meets &= (along > -depth - around) & (along < reach + around)
            line, sphere = line[meets], sphere[meets]
        return line + first, self.order[sphere]


def sphere_tree(centre: FloatArray, radius: FloatArray) -> SphereTree:
    """The tree of facets with these centres (f, 3) and radii (f,) around them in metres; at least one facet."""
    order = tree_of(centre, _CHILDREN).indices.astype(np.int64)  # near ones are near in this order
    levels = [(centre[order], radius[order])]
    while len(levels[0][0]) > 1:
        middle, size = levels[0]
        first = np.arange(0, len(middle), _CHILDREN)
        count = np.diff(np.append(first, len(middle)))
        above = np.add.reduceat(middle, first) / count[:, None]
        outer = np.linalg.norm(middle - np.repeat(above, count, axis=0), axis=1) + size
        levels.insert(0, (above, np.maximum.reduceat(outer, first)))
    return SphereTree(order, tuple(np.vstack([middle.T, size]) for middle, size in levels))
