"""Other meshes of the same bodies: to estimate the error of an answer, and finer ones where the error is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from ...arrays import FloatArray
from .meshes import first_order, smooth_second_order
from .named_mesh import Grid, JoinedMesh, NamedMesh
from .refinement import refined
from .remeshing import remeshed
from .splitting import split

COARSER = 2
"""Number of coarser meshes, of which each costs an eighth of the one before: two show the order of convergence."""

LONGER, LEAST = 2.0, 1.3
"""Factor of the lengths of edges of coarser tetrahedra, and the least ratio of sizes that has to come of it."""

FEW = 1_000
"""Corners of tetrahedra, over the ranks, up to which second order on the same cells, with about eight times as many
unknowns, takes seconds: its bars are half as wide as those from coarser tetrahedra."""

REFINED, COARSENED = 0.25, 1.0
"""Bounds of the factor of sizes of tetrahedra in one refinement."""

GROWTH = 1.45
"""Factor of the cells along each edge of a box that becomes finer: three times as many in all."""

SHARE = 0.5
"""Part of the squared error that marked cells have: the largest errors first (Doerfler, SIAM J. Numer. Anal. 33, 1996).
What is less than a hundredth of it leaves a body as it is."""

STEEPEST = 3.0
"""Factor by which the width of a slab of a box changes at most in one refinement, over that of all others."""


def coarser_meshes(mesh: NamedMesh | JoinedMesh) -> Iterator[NamedMesh | JoinedMesh]:
    """Up to two coarser meshes, from fine to coarse, as far as every body has them: those from which it was refined,
    boxes with fewer cells, and first-order tetrahedra `remeshed`, but for FEW; collective.

    Raises:
        ValueError: As of `NamedMesh.coarser` and `remeshed`.
    """
    bodies = _bodies(mesh)
    if any(one.coarser is None for one in bodies.values()):
        if sum(one.domain.topology.index_map(0).size_global for one in bodies.values()) <= FEW:
            return
    for _ in range(COARSER):
        if not all(one.coarser or _first_order_tetrahedra(one) for one in bodies.values()):
            return
        bodies = {name: coarsened(one) if one.coarser is None else one.coarser() for name, one in bodies.items()}
        yield _like(mesh, bodies)


def coarsened(mesh: NamedMesh) -> NamedMesh:
    """The body with tetrahedra about twice as large; ValueError without many fewer, or as `remeshed`; collective."""
    cells = mesh.domain.topology.index_map(3)
    made = remeshed(mesh, np.full(cells.size_local, LONGER))
    if cells.size_global < LEAST**3 * made.domain.topology.index_map(3).size_global:
        raise ValueError("there is no coarser mesh: a body is a cell thick")
    return made


def _of_tetrahedra(mesh: NamedMesh) -> bool:
    return bool(mesh.domain.topology.cell_type.name == "tetrahedron")


def _first_order_tetrahedra(mesh: NamedMesh) -> bool:
    return mesh.degree == 1 and _of_tetrahedra(mesh)


def same_cells(mesh: NamedMesh | JoinedMesh) -> Iterator[NamedMesh | JoinedMesh]:
    """The same cells with elements of the other order, the second one with a smooth boundary; and first-order cells on
    the nodes of second order, but beside first-order hexahedra, whose second order has as many contact points.  None
    for bodies of both orders; collective."""
    bodies = _bodies(mesh)
    orders = {one.degree for one in bodies.values()}
    if len(orders) > 1:
        return
    first = orders == {1}
    other = {name: smooth_second_order(one) if first else first_order(one) for name, one in bodies.items()}
    yield _like(mesh, other)
    second = other if first else bodies
    if not first or any(_of_tetrahedra(one) for one in bodies.values()):
        yield _like(mesh, {name: split(one) for name, one in second.items()})


def finer(mesh: NamedMesh | JoinedMesh, squared: Mapping[str, FloatArray]) -> NamedMesh | JoinedMesh:
    """A mesh with smaller cells where the error is, of which the given one is the `coarser`; collective.

    Boxes have more planes, so that slabs between them have equal errors: their edges attract planes, at little cost.
    Other bodies of tetrahedra are `remeshed`, without MMG the marked cells are divided (SHARE); other hexahedra are all
    divided.

    Args:
        mesh: The bodies.
        squared: Of each body, by name ("" if it is alone), the squared errors of this rank's own cells.

    Raises:
        ValueError: On every rank, as `refined`.
    """
    bodies, comm = _bodies(mesh), mesh.comm
    errors = np.sort(np.concatenate([part for one in squared.values() for part in comm.allgather(one)]))[::-1]
    total = np.cumsum(errors)
    if total[-1] == 0.0:  # nothing is loaded: all cells alike
        return finer(mesh, {name: np.ones_like(one) for name, one in squared.items()})
    least = errors[np.searchsorted(total, SHARE * total[-1])]
    found = {}
    for name, one in bodies.items():
        mine = squared[name]
        if comm.allreduce(float(mine.sum())) < 0.01 * total[-1]:
            found[name] = one
        elif one.grid is not None:
            found[name] = _graded(one, one.grid, mine)
        elif _of_tetrahedra(one):
            found[name] = _finer_tetrahedra(one, mine, least)
        else:
            found[name] = refined(one)
    kept = {name: replace(one, coarser=partial(_itself, bodies[name])) for name, one in found.items()}
    return JoinedMesh(kept) if isinstance(mesh, JoinedMesh) else kept[""]


def _finer_tetrahedra(mesh: NamedMesh, squared: FloatArray, least: float) -> NamedMesh:
    """With about GROWTH^3 times as many cells, which have equal errors: the squared error of a cell of size h is about
    h^(2 p + 3) times a density, with elements of order p."""
    parts = squared ** (3.0 / (2.0 * mesh.degree + 3.0))
    whole, cells = mesh.comm.allreduce(float(parts.sum())), mesh.domain.topology.index_map(3).size_global
    factor = (GROWTH**3 * cells / whole * parts).clip(COARSENED**-3, REFINED**-3) ** (-1.0 / 3.0)
    try:
        return remeshed(mesh, factor)
    except ValueError:
        return refined(mesh, squared >= least)


def _itself(mesh: NamedMesh) -> NamedMesh:
    return mesh


def _graded(mesh: NamedMesh, grid: Grid, squared: FloatArray) -> NamedMesh:
    """A box with GROWTH times as many planes, by the squared errors of this rank's own cells.

    The squared error of a slab of width w is about w^(2 p + 1) times a density, with elements of order p: as many parts
    of the slab as its root of this order have equal errors.
    """
    planes = []
    for along, slab in zip(grid.planes, grid.slabs, strict=True):
        of_slab = mesh.comm.allreduce(np.bincount(slab, squared, minlength=len(along) - 1))
        parts = (of_slab / of_slab.mean()) ** (1.0 / (2.0 * mesh.degree + 1.0))
        ends = np.concatenate([[0.0], np.cumsum(np.clip(parts, 1.0 / STEEPEST, STEEPEST))])
        cells = int(np.ceil(GROWTH * len(parts)))
        planes.append(np.interp(np.linspace(0.0, ends[-1], cells + 1), ends, along))
    return grid.make((planes[0], planes[1], planes[2]))


def _bodies(mesh: NamedMesh | JoinedMesh) -> dict[str, NamedMesh]:
    return dict(mesh.bodies) if isinstance(mesh, JoinedMesh) else {"": mesh}


def _like(mesh: NamedMesh | JoinedMesh, bodies: dict[str, NamedMesh]) -> NamedMesh | JoinedMesh:
    return JoinedMesh(bodies) if isinstance(mesh, JoinedMesh) else bodies[""]
