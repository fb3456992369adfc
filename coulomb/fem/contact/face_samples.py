"""Places on a face between its nodes, where it may be inside an obstacle that no contact point touches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ..bodies import DisplacementSpace
from ..meshes import fetched, starts_of
from .facet_functions import FacetKind
from .facet_patch import facet_patch
from .near_facets import normals_at_nodes

_STEPS = 4
"""Intervals between the first places along an edge."""

_HALVINGS = 8
"""Of the distance between places around the lowest one: an obstacle of a tenth of a facet is found to 1e-4 of it."""


@dataclass(frozen=True)
class FaceSamples:
    """The f facets of a face that this rank owns.

    Attributes:
        kind: Triangles or quadrilaterals, of first or second order.
        x: Their nodes, metres, shape (f, n, 3).
        u: The displacements of these, metres, shape (f, n, 3).
        chord: How far the facets are from the smooth face for which they may stand, metres, shape (f,): of first order
            h^2/(8 R), of second order with the square of that over the facet's diameter as a bound.
        middle: The middles of the smooth faces, metres, shape (f, 3).
        nodal: Whether the corners are contact points, if the face can touch there.
    """

    kind: FacetKind
    x: FloatArray
    u: FloatArray
    chord: FloatArray
    middle: FloatArray
    nodal: bool

    @property
    def corners(self) -> FloatArray:
        """Corners of the facets, metres, shape (f, c, 3)."""
        return self.x[:, : self.kind.corners]

    def bend(self, distance: Callable[[FloatArray], FloatArray]) -> FloatArray:
        """How far a distance, a function of places (k, 3) in metres, in the middles of the smooth faces is from the
        mean of those at the corners, before deformation: about h^2/(8 R), R of the gap; shape (f,)."""
        means = distance(self.corners.reshape(-1, 3)).reshape(self.corners.shape[:2]).mean(axis=1)
        smooth = distance(self.middle) - means
        bend: FloatArray = np.abs(smooth)
        if self.kind.degree == 1:  # at the ends of a face its own bend is known to a third only
            flat = distance(self.corners.mean(axis=1)) - means
            shared = (flat * smooth > 0.0) & (bend < np.abs(flat))
            bend = np.where(shared, np.maximum(bend - 2.0 * np.abs(flat - smooth), 0.0), bend)
        return bend

    def least(self, which: npt.NDArray[np.bool_], value: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
        """The least value in some facets, shape (f,).

        Args:
            which: The facets.
            value: A function of places (k, 3) before deformation and after it, metres; shape (k,).
        """
        x, u = self.x[which], self.u[which]
        step = 1.0 / _STEPS
        along = np.arange(_STEPS + 1) * step
        offsets = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        grid = np.array([(i, j) for i in along for j in along])
        at: FloatArray = np.broadcast_to(grid, (len(x), *grid.shape))
        for _ in range(_HALVINGS + 1):
            if self.kind.corners == 3:
                at = at / np.maximum(at.sum(axis=2), 1.0)[:, :, None]
            functions = np.stack(self.kind.values(at[..., 0], at[..., 1]))
            before, way = (np.einsum("nfq,fni->fqi", functions, of) for of in (x, u))
            values = value(before.reshape(-1, 3), (before + way).reshape(-1, 3)).reshape(at.shape[:2])
            best = np.argmin(values, axis=1)[:, None]
            step *= 0.5
            at = np.clip(np.take_along_axis(at, best[:, :, None], axis=1) + step * offsets, 0.0, 1.0)
        least: FloatArray = np.take_along_axis(values, best, axis=1)[:, 0]
        return least


def face_samples(space: DisplacementSpace, facets: npt.NDArray[np.int32], u: FloatArray) -> FaceSamples:
    """The facets of a face with displacements u (k, 3) of this rank's nodes in metres; collective."""
    patch, comm = facet_patch(space, facets), space.comm
    kind, starts = patch.kind, starts_of(comm, space.numbering.local)
    moved = fetched(comm, starts, patch.nodes, u)
    middle = np.stack(kind.values(*kind.points[: kind.corners].mean(axis=0)[:, None]))[:, 0] @ patch.x
    if kind.degree == 1:
        bulges = patch.bulges_with(normals_at_nodes(patch, starts, comm))
        chord, middle = np.linalg.norm(bulges, axis=1), middle + bulges
    else:
        straight = np.einsum("jn,fji->fni", kind.vertex_functions, patch.x[:, : kind.corners])
        off = np.linalg.norm(patch.x - straight, axis=2).max(axis=1, initial=0.0)
        chord = off**2 / patch.diameters
    return FaceSamples(kind, patch.x, moved, chord, middle, space.positive)
