"""The facets of a face as data: nodes, coordinates, orientation; to be paired with those of another face."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from .. import compat
from ..bodies import DisplacementSpace
from ..geometry import RigidFoundation
from ..meshes import lagrange_points, lagrange_values
from .facet_functions import FacetKind

STRAIGHT = 1e-10
"""Distortion below which the map of a facet is taken as affine."""

_CREASE = 0.9
"""Cosine of the angle between a facet and the mean of those around a corner below which the face has an edge there."""

_OFF_SURFACE = 0.1
"""Distance of a corner from a given surface over its facet's diameter above which that is the wrong surface."""


@dataclass(frozen=True)
class FacetPatch:
    """Facets of a face with the nodes of the displacements on them.

    Attributes:
        kind: Triangles or quadrilaterals, of first or second order.
        nodes: Global numbers of the nodes of every facet, in VTK's order, counterclockwise seen from outside; (f, n).
        x: Their coordinates in metres, shape (f, n, 3).
        size: Number of nodes of the space in all.
        curved: Nodes of second-order facets through the surface for which the facets stand, in VTK's order, metres,
            shape (f, 6 or 9, 3): between them gaps are measured.  None: the facets themselves.
    """

    kind: FacetKind
    nodes: npt.NDArray[np.int64]
    x: FloatArray
    size: int
    curved: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.nodes)

    @cached_property
    def whole(self) -> FloatArray:
        """Integrals of the functions over every facet in m^2, shape (f, n)."""
        points, weights = self.kind.rule(3 * self.kind.polynomial_degree)
        values = np.stack(self.kind.values(points[:, 0], points[:, 1]))
        whole: FloatArray = np.einsum("q,fq,nq->fn", weights, np.linalg.norm(self.area_vectors(points), axis=2), values)
        return whole

    @cached_property
    def areas(self) -> FloatArray:
        areas: FloatArray = self.whole.sum(axis=1)
        return areas

    def area_vectors(self, points: FloatArray) -> FloatArray:
        """Outward normals times the area per area of the reference facet, at its points (q, 2), shape (f, q, 3)."""
        along_r, along_s = (
            np.stack([np.broadcast_to(slope, len(points)) for slope in slopes])
            for slopes in self.kind.slopes(points[:, 0], points[:, 1])
        )
        r, s = (np.einsum("nq,fni->fqi", slopes, self.x) for slopes in (along_r, along_s))
        vectors: FloatArray = np.cross(r, s)
        return vectors

    @cached_property
    def distortion(self) -> FloatArray:
        """How far the nodes of every facet are from those of a triangle or parallelogram with straight edges and the
        nodes of its edges in their middles, over its diameter; 0 where its map is affine; shape (f,)."""
        corners = self.kind.points[:3] if self.kind.corners == 3 else self.kind.points[[0, 1, 3]]
        affine = np.linalg.solve(
            np.column_stack([np.ones(3), corners]).T, np.column_stack([np.ones(self.kind.width), self.kind.points]).T
        ).T
        three = self.x[:, :3] if self.kind.corners == 3 else self.x[:, [0, 1, 3]]
        off = np.linalg.norm(self.x - np.einsum("nc,fci->fni", affine, three), axis=2).max(axis=1, initial=0.0)
        share: FloatArray = off / self.diameters
        return share

    @cached_property
    def straight(self) -> bool:
        return bool(np.all(self.distortion < STRAIGHT))

    @cached_property
    def diameters(self) -> FloatArray:
        """Twice the distance of the farthest node of every facet from the mean of its nodes, metres, shape (f,)."""
        away = np.linalg.norm(self.x - self.x.mean(axis=1, keepdims=True), axis=2)
        diameters: FloatArray = 2.0 * away.max(axis=1, initial=0.0)
        return diameters

    @cached_property
    def bulges(self) -> FloatArray:
        """The way from the middle of every facet to the smooth face for which the facets may stand, metres, shape
        (f, 3).

        The smooth face has the mean normals n_k of the facets around the nodes: to second order the middle is off by
        1/2 of the mean of ((x_k - x) . n_k) n_k.  0 of second-order facets, where `curved` is known, and at edges
        between facets that differ by more than about 50 degrees.
        """
        vectors = np.repeat(self.middle_vectors, self.kind.width, axis=0)
        return self.bulges_with(mean_normals(self.nodes.ravel(), vectors, self.size)[self.nodes])

    @cached_property
    def middle_vectors(self) -> FloatArray:
        """`area_vectors` in the middles of the facets, shape (f, 3)."""
        return self.area_vectors(self.kind.points.mean(axis=0)[None])[:, 0]

    def bulges_with(self, n: FloatArray) -> FloatArray:
        """`bulges` with the `mean_normals` at the nodes of each facet, shape (f, n, 3)."""
        if self.kind.degree == 2 or self.curved is not None or not len(self):
            return np.zeros((len(self), 3))
        creased, n = self._creased(n), _unit(n)
        away = np.einsum("fki,fki->fk", self.x - self.x.mean(axis=1, keepdims=True), n)
        bulges: FloatArray = 0.5 * (away[:, :, None] * n).mean(axis=1)
        return np.where(creased[:, None], 0.0, bulges)

    @property
    def multiplier_columns(self) -> npt.NDArray[np.int64]:
        """Columns of the nodes that are contact points: all, of 6-node triangles the corners."""
        return np.arange(3 if self.kind.width == 6 else self.kind.width)

    def only(self, which: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> FacetPatch:
        curved = None if self.curved is None else self.curved[which]
        return replace(self, nodes=self.nodes[which], x=self.x[which], curved=curved)

    @property
    def second_order(self) -> FacetKind:
        return FacetKind(self.kind.corners, 2)

    def on_surface(self, surface: RigidFoundation) -> FacetPatch:
        """The facets with `curved` at the nearest points of a surface; ValueError if a corner is farther from it than a
        tenth of its facet."""
        if not len(self):
            return replace(self, curved=self._in_second_order)
        x = self.x[:, : self.kind.corners].reshape(-1, 3)
        off = np.abs(surface.signed_distance(x)) / np.repeat(self.diameters, self.kind.corners)
        if np.max(off) > _OFF_SURFACE:
            where = ", ".join(f"{c:.6g}" for c in x[np.argmax(off)])
            raise ValueError(
                f"has a node off the surface given for it by {100 * np.max(off):.3g} % of its facet, at x = {where}: "
                "give the surface on which its nodes are"
            )
        places: FloatArray = self._in_second_order.reshape(-1, 3)
        for _ in range(2):  # signed distances may be so to first order only
            places = places - surface.signed_distance(places)[:, None] * surface.normal(places)
        return replace(self, curved=places.reshape(len(self), -1, 3))

    def smoothed(self, n: FloatArray) -> FacetPatch:
        """The facets with `curved` on the smooth surface with the normals n: `mean_normals` at the corners of each,
        shape (f, corners, 3).

        To second order the middle of an edge is off by 1/2 of the mean of ((x_k - x) . n_k) n_k over its ends.
        """
        if self.kind.degree == 2:
            return self
        creased, n, straight, count = self._creased(n), _unit(n), self.x, self.kind.corners
        ends = np.stack([np.arange(count), np.roll(np.arange(count), -1)], axis=1)
        half = 0.5 * (straight[:, ends[:, 0]] - straight[:, ends[:, 1]])
        rise = [sign * np.einsum("fei,fei->fe", half, n[:, ends[:, k]]) for k, sign in enumerate((1.0, -1.0))]
        offset = 0.25 * sum(r[:, :, None] * n[:, ends[:, k]] for k, r in enumerate(rise))
        offset[creased] = 0.0
        if count == 4:
            offset = np.concatenate([offset, 0.5 * offset.sum(axis=1, keepdims=True)], axis=1)
        curved = self._in_second_order
        curved[:, count:] += offset
        return replace(self, curved=curved)

    @property
    def _in_second_order(self) -> FloatArray:
        """Nodes of second-order facets of the same shape, (f, 6 or 9, 3)."""
        points = self.second_order.points
        values = np.stack(self.kind.values(points[:, 0], points[:, 1]))
        places: FloatArray = np.einsum("nq,fni->fqi", values, self.x)
        return places

    def _creased(self, n: FloatArray) -> npt.NDArray[np.bool_]:
        """Facets that differ by more than about 50 degrees from those beside them, by mean normals n at the corners:
        one is aslant to them, or they are short, since the facets around a corner differ."""
        area = self.middle_vectors
        aslant = np.einsum("fki,fi->fk", _unit(n), area) < _CREASE * np.linalg.norm(area, axis=1)[:, None]
        creased: npt.NDArray[np.bool_] = np.any(aslant | (np.linalg.norm(n, axis=2) < _CREASE), axis=1)
        return creased


def mean_normals(node: npt.NDArray[np.int64], vectors: FloatArray, size: int) -> FloatArray:
    """Means of the unit normals of the facets around each of `size` nodes, weighted by their area, shape (size, 3), of
    `FacetPatch.middle_vectors` (k, 3) and the nodes at which they count (k,)."""
    sums, areas = np.zeros((size, 3)), np.bincount(node, np.linalg.norm(vectors, axis=1), size)
    np.add.at(sums, node, vectors)
    means: FloatArray = sums / np.maximum(areas, 1e-300)[:, None]
    return means


def _unit(n: FloatArray) -> FloatArray:
    unit: FloatArray = n / np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-300)
    return unit


def facet_patch(space: DisplacementSpace, facets: npt.NDArray[np.int32]) -> FacetPatch:
    topology = space.domain.topology
    kind = FacetKind(3 if topology.cell_type.name == "tetrahedron" else 4, space.degree)
    cell, columns = space.in_cells(facets)
    dofs = compat.cell_dofs(space.V)[cell[:, None], columns]
    nodes = np.asarray(space.V.dofmap.index_map.local_to_global(dofs.ravel().astype(np.int32)), dtype=np.int64)
    degree = compat.geometry_degree(space.domain)
    in_cells = space.domain.geometry.x[compat.cell_geometry(space.domain)[cell]]
    if degree != space.degree:
        values = lagrange_values(topology.cell_type, degree, lagrange_points(topology.cell_type, space.degree))
        in_cells = np.einsum("ac,kci->kai", np.round(values, 12), in_cells)
    x = np.take_along_axis(in_cells, columns[:, :, None], axis=1)
    patch = FacetPatch(kind, nodes.reshape(-1, kind.width), x, int(space.V.dofmap.index_map.size_global))
    outward = x[:, : kind.corners].mean(axis=1) - in_cells.mean(axis=1)
    inside = np.einsum("fi,fi->f", patch.area_vectors(kind.points[: kind.corners]).sum(axis=1), outward) < 0.0
    nodes, x = patch.nodes.copy(), x.copy()
    nodes[inside], x[inside] = nodes[inside][:, kind.mirrored], x[inside][:, kind.mirrored]
    return replace(patch, nodes=nodes, x=x)
