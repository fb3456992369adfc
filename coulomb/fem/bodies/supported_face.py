"""The face on which a support acts: its nodes, their normals, and its plane."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ..geometry import RigidFoundation, first_place, on_all_ranks

_FOLDED = 0.8
"""Length of the mean normal of the facets around a node below which they meet at an edge: two facets at more than 74
degrees, or a corner."""

_SAME_SIDE = 0.5
"""Cosine of the angle between the normals of a surface and of the facets below which the face is no part of it."""

_CLEAN = 1e-12
"""A component of a normal below this is a rounding error."""

_OFF_PLANE = 1e-5
"""Largest distance of a node from the plane of a plane face, relative to the extent of the face: single precision."""


class SupportedFace:
    """What a support needs of its face; this rank's q nodes.

    Args:
        nodes: Among this rank's, ascending, shape (q,).
        x: Their coordinates in metres, shape (q, 3).
        integrals: Of the hat functions over the face, m^2, shape (q,), and of the outward normal against them, (q, 3);
            collective.
    """

    def __init__(
        self,
        nodes: npt.NDArray[np.int32],
        x: FloatArray,
        comm: MPI.Comm,
        integrals: Callable[[], tuple[FloatArray, FloatArray]],
    ):
        self.nodes, self.x, self.comm, self._compute = nodes, x, comm, integrals

    @cached_property
    def _integrals(self) -> tuple[FloatArray, FloatArray]:
        return self._compute()

    def normals(self, what: str, surface: RigidFoundation | None = None) -> FloatArray:
        """Unit normals of the nodes, shape (q, 3); collective.

        They are outward, the mean of the facets weighted by hat functions; or those of the exact surface, on its side.

        Raises:
            ValueError: On every rank, if the facets around a node of any rank meet at an edge, or if the surface has
                no normal or one far from that of the facets; the message begins with `what`.
        """
        area, outward = self._integrals

        def unit() -> FloatArray:
            if surface is not None:
                return exact() if len(self.x) else np.zeros((0, 3))
            length = np.linalg.norm(outward, axis=1)
            folded = length < _FOLDED * area
            if np.any(folded):
                at = first_place(self.x, folded)
                raise ValueError(f"the face has an edge at x = {at}, and no normal there; name its sides separately")
            return _clean(outward)

        def exact() -> FloatArray:
            n = surface.normal(self.x) if surface is not None else outward
            along = np.abs(np.einsum("ki,ki->k", n, outward))
            other = ~(along > _SAME_SIDE * np.linalg.norm(outward, axis=1))  # also where it is not finite
            if np.any(other):
                at = first_place(self.x, other)
                raise ValueError(f"the face is no part of the surface: at x = {at} their normals are far apart")
            return _clean(n)

        return on_all_ranks(unit, what, self.comm)

    def plane(self, what: str) -> FloatArray:
        """Outward unit normal of a plane face, shape (3,); ValueError on every rank, beginning with `what`, if it is
        not plane; collective."""
        area, outward = self._integrals
        total = self.comm.allreduce(float(area.sum()), op=MPI.SUM)
        mean = self.comm.allreduce(outward.sum(axis=0), op=MPI.SUM) / total
        centre = self.comm.allreduce(area @ self.x, op=MPI.SUM) / total
        r = self.x - centre
        extent = self.comm.allreduce(float(np.max(np.abs(r), initial=0.0)), op=MPI.MAX)
        n: FloatArray = _clean(mean[None, :] if np.any(mean) else np.ones((1, 3)))[0]
        off = np.abs(r @ n) if len(r) else np.zeros(0)
        furthest = self.comm.allreduce(float(np.max(off, initial=0.0)), op=MPI.MAX)
        if np.linalg.norm(mean) < _FOLDED or furthest > _OFF_PLANE * extent:
            raise ValueError(
                f"{what}: the face must be plane, but its nodes are up to {furthest:.3g} m off its mean plane; "
                'for a curved face use a clamp with components = "normal"'
            )
        return n


def _clean(normals: FloatArray) -> FloatArray:
    """Vectors (q, 3) at length 1, without components that are rounding errors."""
    unit: FloatArray = normals / np.linalg.norm(normals, axis=1)[:, None]
    unit[np.abs(unit) < _CLEAN] = 0.0
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    return unit
