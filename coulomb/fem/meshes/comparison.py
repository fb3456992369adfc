"""Other meshes of the same bodies: to estimate the error of an answer, and finer ones where the error is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from ...arrays import FloatArray
from .coarsening import coarsened
from .curving import split
from .meshes import first_order, off_surface, polygon, smooth_second_order
from .named_mesh import Grid, JoinedMesh, NamedMesh
from .refinement import refined

COARSER: Final = 2
"""Number of coarser meshes, of which each costs an eighth of the one before: two show the order of convergence."""

FEW: Final = 1_000
"""Corners of cells, over the ranks, up to which second order on the same cells, with about eight times as many
unknowns, takes seconds: its bars are half as wide as those from coarser meshes."""

GROWTH: Final = 3.0
"""Factor of the cells of boxes that become finer, all together."""

SHARE: Final = 0.5
"""Part of the squared error that marked cells have: the largest errors first (Doerfler, SIAM J. Numer. Anal. 33, 1996).
What is less than a hundredth of it leaves a body as it is."""

ROUNDER: Final = 0.75
"""Part of the volume between facets and the smooth surface for which they stand that divided facets have: each becomes
four with a quarter of it, so that less than half of all is left."""

STEEPER: Final = 1.2
"""Power of the density of parts of a slab, over that with which all parts have equal errors.  Forces converge faster
with more than 1, as they depend on singular edges more than the energy does; from 1.3 on the rest becomes too coarse
(refinement-rules.csv)."""

STEEPEST: Final = 3.0
"""Factor by which the width of a slab of a box changes at most in one refinement, over that of all others."""


def coarser_meshes(mesh: NamedMesh | JoinedMesh) -> Iterator[NamedMesh | JoinedMesh]:
    """Up to two coarser meshes, from fine to coarse, as far as every body has them: those from which it was refined,
    boxes with fewer cells, and others of first order `coarsened`, but for FEW; collective.

    Raises:
        ValueError: As of `NamedMesh.coarser` and `coarsened`.
    """
    bodies = _bodies(mesh)
    if any(body.coarser is None for body in bodies.values()):
        if sum(body.domain.topology.index_map(0).size_global for body in bodies.values()) <= FEW:
            return
    for made in range(COARSER):
        if not all(body.coarser or body.degree == 1 for body in bodies.values()):
            return
        bodies = {
            name: coarsened(one, again=made > 0) if one.coarser is None else one.coarser()
            for name, one in bodies.items()
        }
        yield _like(mesh, bodies)


def same_cells(mesh: NamedMesh | JoinedMesh) -> Iterator[NamedMesh | JoinedMesh]:
    """The same cells with elements of the other order, the second one with a smooth boundary; of bodies of both orders
    all with second order, and all with first.  Then first-order cells on the nodes of second order, but beside
    first-order hexahedra, whose second order has as many contact points; collective."""
    bodies = _bodies(mesh)
    orders = {body.degree for body in bodies.values()}
    second = {name: smooth_second_order(one) if one.degree == 1 else one for name, one in bodies.items()}
    if 1 in orders:
        yield _like(mesh, second)
    if 2 in orders:
        yield _like(mesh, {name: first_order(one) if one.degree == 2 else one for name, one in bodies.items()})
    if 2 in orders or any(body.tetrahedra for body in bodies.values()):
        yield _like(mesh, {name: split(one) for name, one in second.items()})


def smaller_cells(mesh: NamedMesh | JoinedMesh) -> Iterator[NamedMesh | JoinedMesh]:
    """Eight cells for each, of the same order: where a coarser mesh and the other order tell nothing; collective."""
    yield _like(mesh, {name: refined(one) for name, one in _bodies(mesh).items()})


def finer(
    mesh: NamedMesh | JoinedMesh, squared: Mapping[str, FloatArray], flat: float = math.inf
) -> NamedMesh | JoinedMesh:
    """A mesh with smaller cells where the error is, of which the given one is the `coarser`; collective.

    Boxes have more planes, so that slabs between them have equal errors: their edges attract planes, at little cost.
    Of other bodies of tetrahedra the marked ones are divided (SHARE), other hexahedra are all divided.  New nodes are
    on the smooth surface for which facets stand, and the facets farthest from it are divided as well (ROUNDER).

    Args:
        squared: Of each body, by name ("" if it is alone), the squared errors of this rank's own c cells, shape (c,);
            of a box the parts that planes across x, across y and across z make smaller, shape (3, c).
        flat: Volume between facets and the surface for which they stand, over that of a body (`polygon`), that is small
            enough.

    Raises:
        ValueError: On every rank, as `refined`.
    """
    bodies, comm = _bodies(mesh), mesh.comm
    of_cells = {name: np.atleast_2d(one).sum(axis=0) for name, one in squared.items()}
    least, total = _least([part for one in of_cells.values() for part in comm.allgather(one)], SHARE)
    if total == 0.0:  # nothing is loaded: all cells alike
        return finer(mesh, {name: np.ones_like(one) for name, one in squared.items()}, flat)
    meshes, graded = {}, {}
    for name, one in bodies.items():
        good = comm.allreduce(float(of_cells[name].sum())) < 0.01 * total
        uneven = one.grid is None and polygon(one) > flat
        if good and not uneven:
            meshes[name] = one
        elif one.grid is not None:
            graded[name] = _Slabs(one, one.grid, squared[name])
        elif one.tetrahedra:
            marked = (of_cells[name] >= least) & (not good)
            if uneven:
                off = off_surface(one)
                marked |= off >= _least(comm.allgather(off), ROUNDER)[0]
            meshes[name] = refined(one, marked, curved=True)
        else:
            meshes[name] = refined(one, curved=True)
    _more_planes(list(graded.values()))
    meshes |= {name: slabs.made() for name, slabs in graded.items()}
    kept = {name: replace(meshes[name], coarser=partial(_itself, one)) for name, one in bodies.items()}
    return JoinedMesh(kept) if isinstance(mesh, JoinedMesh) else kept[""]


def _least(parts: Sequence[FloatArray], share: float) -> tuple[float, float]:
    """The least one of the largest values that have a share of the sum of all, and this sum."""
    values = np.sort(np.concatenate(parts))[::-1]
    total = np.cumsum(values)
    return float(values[np.searchsorted(total, share * total[-1])]), float(total[-1])


def _itself(mesh: NamedMesh) -> NamedMesh:
    return mesh


class _Slabs:
    """The slabs of a box with their squared errors, summed over all ranks, and how many there will be; collective.

    The squared error of a slab of width w is w^(2 p + 1) times a density, with elements of order p.  As many parts of
    the slab as its root of this order have equal errors; n slabs in all, n^(-2 p) times the power 2 p + 1 of the sum of
    these roots.

    Attributes:
        counts: Numbers of slabs across x, y and z, to be made.
    """

    def __init__(self, mesh: NamedMesh, grid: Grid, squared: FloatArray):
        self._grid, self._order = grid, 2.0 * mesh.degree + 1.0
        of_slabs = [
            mesh.comm.allreduce(np.bincount(slab, part, minlength=len(along) - 1))
            for along, slab, part in zip(grid.planes, grid.slabs, squared, strict=True)
        ]
        least = 1e-6 * sum(of.sum() for of in of_slabs)  # across a direction without any error slabs are even
        self._roots = [(of + least / len(of)) ** (1.0 / self._order) for of in of_slabs]
        self.counts = np.array([len(roots) for roots in self._roots])
        self._single = np.array([roots.sum() ** self._order for roots in self._roots])

    @property
    def cells(self) -> int:
        """Number of bricks that are to be made."""
        return int(np.prod(self.counts))

    @property
    def gains(self) -> FloatArray:
        """Of one plane more across x, y and z, the decrease of the squared error over the further cells, but for a
        factor."""
        errors: FloatArray = self._single * self.counts ** (1.0 - self._order)
        return errors / self.cells

    def made(self) -> NamedMesh:
        """The box with the planes."""
        planes = []
        for along, roots, count in zip(self._grid.planes, self._roots, self.counts, strict=True):
            width = np.diff(along)
            parts = width * (roots / width) ** STEEPER
            ends = np.concatenate([[0.0], np.cumsum(np.clip(parts / parts.mean(), 1.0 / STEEPEST, STEEPEST))])
            planes.append(np.interp(np.linspace(0.0, ends[-1], count + 1), ends, along))
        return self._grid.make((planes[0], planes[1], planes[2]))


def _more_planes(boxes: Sequence[_Slabs]) -> None:
    """Count planes one after another where they gain most, until boxes have GROWTH times the cells in all."""
    wanted = GROWTH * sum(box.cells for box in boxes)
    while sum(box.cells for box in boxes) < wanted:
        best = max(boxes, key=lambda box: box.gains.max())
        best.counts[np.argmax(best.gains > (1.0 - 1e-9) * best.gains.max())] += 1  # on any ranks the first of equals


def _bodies(mesh: NamedMesh | JoinedMesh) -> dict[str, NamedMesh]:
    return dict(mesh.bodies) if isinstance(mesh, JoinedMesh) else {"": mesh}


def _like(mesh: NamedMesh | JoinedMesh, bodies: dict[str, NamedMesh]) -> NamedMesh | JoinedMesh:
    return JoinedMesh(bodies) if isinstance(mesh, JoinedMesh) else bodies[""]
