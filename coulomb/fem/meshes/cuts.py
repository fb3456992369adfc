"""Cuts of a mesh along surfaces inside it, whose nodes are doubled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components

from ...arrays import BoolArray, IntArray, distinct, in_words
from ..mesh_formats import other_side
from .lagrange import CORNERS, nodes_of_facets
from .mesh_file import FACETS, MeshFile


def cut(file: MeshFile, names: Sequence[str]) -> MeshFile:
    """The mesh cut along groups of facets inside it: of each the facets on one side keep the name, those on the other
    have that of `other_side`.

    Raises:
        ValueError: If there is no such group, facets of it are not between two cells, or a cut has one side only since
            it ends inside the body.
    """
    for name in names:
        file = _cut(file, name)
    return file


def _cut(file: MeshFile, name: str) -> MeshFile:
    what = f"{file.path}: cut {name!r}"
    if name not in file.face_groups:
        raise ValueError(f"{what}: there is no such group of facets; there are {', '.join(sorted(file.face_groups))}")
    width = file.cells.shape[1]
    columns = np.array(nodes_of_facets(width, FACETS[CORNERS[width]]))
    sides = 3 if CORNERS[width] == 4 else 4
    near = np.zeros(len(file.points), dtype=bool)
    group = file.face_groups[name]
    if group.shape[1] != sides or len(group) == 0:
        raise ValueError(f"{what}: it has no facets of {sides} corners, as the cells have")
    near[group] = True
    around = np.flatnonzero(np.any(near[file.cells[:, : CORNERS[width]]], axis=1))
    facets = file.cells[around][:, columns]  # (cells, facets of a cell, nodes)
    rows = np.sort(facets[..., :sides].reshape(-1, sides), axis=1)
    wanted = np.unique(np.sort(group, axis=1), axis=0)
    _, number = distinct(np.vstack([rows, wanted]))
    count = np.bincount(number)
    in_cut = np.zeros(len(count), dtype=bool)
    in_cut[number[len(rows) :]] = True
    count[in_cut] -= 1
    off = int(np.sum(count[in_cut] != 2))
    if off:
        raise ValueError(f"{what}: {off} of its {len(wanted)} facets are not between two cells: a cut is inside a body")
    number = number[: len(rows)]
    order = np.argsort(number, kind="stable")
    both = order[np.repeat(count, count) == 2].reshape(-1, 2)
    cells, apart = both // len(columns), in_cut[number[both[:, 0]]]
    at_cut = np.any(near[rows[both[:, 0]]], axis=1)
    part = connected_components(_graph(cells[at_cut & ~apart], len(around)), directed=False)[1]
    across = part[cells[apart]]
    if np.any(across[:, 0] == across[:, 1]):
        first = rows[both[apart][np.argmax(across[:, 0] == across[:, 1]), 0]]
        place = in_words(file.points[first].mean(axis=0))
        raise ValueError(f"{what}: its two sides are connected near ({place}): it must go through the body")
    other = _sides(across, int(part.max()) + 1)[part]
    if np.any(other[cells[apart, 0]] == other[cells[apart, 1]]):
        raise ValueError(f"{what}: it has no two sides: cut one surface after the other")
    on_cut = np.unique(facets.reshape(len(rows), -1)[both[apart, 0]])
    twin = np.arange(len(file.points))
    twin[on_cut] = len(file.points) + np.arange(len(on_cut))
    turned = file.cells.copy()
    turned[around[other]] = twin[file.cells[around[other]]]
    of_other = rows[np.repeat(other, len(columns))]

    def moved(members: IntArray) -> IntArray:
        """Facets of another group, those of cells on the other side with its nodes."""
        if members.shape[1] != sides:
            return members
        _, number = distinct(np.vstack([of_other, np.sort(members, axis=1)]))
        beyond = np.isin(number[len(of_other) :], number[: len(of_other)])
        return np.where(beyond[:, None], twin[members], members)

    cut_rows = rows[both[apart, 0]]
    faces = {key: members if key == name else moved(members) for key, members in file.face_groups.items()}
    faces |= {name: cut_rows, other_side(name): twin[cut_rows]}
    nodes = {
        key: np.concatenate([members, twin[members[np.isin(members, on_cut)]]])
        for key, members in file.node_groups.items()
    }
    points = np.concatenate([file.points, file.points[on_cut]])
    numbers = None if file.numbers is None else np.concatenate([file.numbers, file.numbers[on_cut]])
    return replace(file, points=points, cells=turned, face_groups=faces, node_groups=nodes, numbers=numbers)


def _graph(pairs: IntArray, count: int) -> scipy.sparse.csr_matrix:
    return scipy.sparse.csr_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count))


def _sides(across: IntArray, count: int) -> BoolArray:
    """On which side of the cut each of the parts is, if each pair is on different ones, shape (count,)."""
    graph, side, seen = _graph(across, count), np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for start in range(count):
        if seen[start]:
            continue
        order, before = breadth_first_order(graph, start, directed=False)
        for one in order[1:]:
            side[one] = ~side[before[one]]
        seen[order] = True
    return side
