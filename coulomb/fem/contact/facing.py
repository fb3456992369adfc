"""Which facets can have come through which: those that face each other, and are near or have passed each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, IntArray, unit_vectors
from .body_boundary import boxes_of, in_boxes
from .facet_patch import FacetPatch

_FACING: Final = -1e-6
"""Cosine of the angle between the normals of facets below which they face each other."""

_ALONG: Final = np.array([way for way in np.ndindex(3, 3, 3) if way > (1, 1, 1)]) - 1.0
"""Directions along which places are compared, of both senses one, shape (13, 3)."""


class Facets(NamedTuple):
    """Facets of a body after deformation.

    Attributes:
        nodes: Numbers of their corners, shape (f, 4).
        component: The component of the meshes that each is in, shape (f,).
        n: Their outward normals, shape (f, 3).
        low, high: Ends of the boxes around them, metres, shape (f, 3).
        first, last: Ends along `_ALONG` of their places before and after motions three times as long, that end as long
            after them as they begin before, metres, shape (f, 26).
    """

    nodes: IntArray
    component: FloatArray
    n: FloatArray
    low: FloatArray
    high: FloatArray
    first: FloatArray
    last: FloatArray

    @classmethod
    def of(cls, patch: FacetPatch, u: FloatArray, component: FloatArray, vectors: FloatArray) -> Facets:
        """From displacements u (f, n, 3) of their nodes in metres and outward vectors (f, 3)."""
        ways = np.concatenate([(patch.x - u) @ _ALONG.T, (patch.x + 2.0 * u) @ _ALONG.T], axis=2)
        nodes = patch.nodes[:, [0, 1, 2, patch.kind.corners - 1]]
        return cls(nodes, component, unit_vectors(vectors), *boxes_of(patch.x + u), *boxes_of(ways))

    def of_all_ranks(self, comm: MPI.Comm) -> Facets:
        return self if comm.size == 1 else Facets(*(np.concatenate(comm.allgather(of)) for of in self))

    def facing(self, others: Facets, reach: FloatArray) -> tuple[IntArray, IntArray]:
        """Pairs with others that face each other and are not farther apart than this in metres, shape (3,)."""
        facet, other = in_boxes((self.low - reach, self.high + reach), (others.low, others.high))
        use = np.einsum("pi,pi->p", self.n[facet], others.n[other]) < _FACING
        return facet[use], other[use]

    def never_met(self, facet: IntArray, others: Facets, other: IntArray) -> BoolArray:
        """In which pairs none can have come through the other on straight ways: along a direction they are one after
        the other, in the same order at both ends of the ways."""
        before, after = self.last[facet] < others.first[other], self.first[facet] > others.last[other]
        k = len(_ALONG)
        return np.any((before[:, :k] & before[:, k:]) | (after[:, :k] & after[:, k:]), axis=1)


def near(bodies: Sequence[Facets], reach: FloatArray, comm: MPI.Comm) -> list[BoolArray]:
    """Which of this rank's facets of each body face one of it, without a common node, that is so near that it can have
    come through, and which one of another body; shape (f, 2) each; collective.

    Args:
        bodies: Their facets on this rank.
        reach: How near, metres, shape (3,); of one component those alone that have met.
    """
    every = [of.of_all_ranks(comm) for of in bodies]
    ends = [(of.low.min(axis=0, initial=np.inf), of.high.max(axis=0, initial=-np.inf)) for of in every]
    flags_of: list[BoolArray] = [np.zeros((len(of.n), 2), dtype=bool) for of in bodies]
    for part, (of, flags) in enumerate(zip(bodies, flags_of, strict=True)):
        facet, against = of.facing(every[part], reach)
        use = ~np.any(of.nodes[facet, :, None] == every[part].nodes[against, None], axis=(1, 2))
        facet, against = facet[use], against[use]
        use = of.component[facet] != every[part].component[against]
        flags[facet[use | ~of.never_met(facet, every[part], against)], 0] = True
        for other, (low, high) in enumerate(ends):
            if other == part or not np.all((low <= ends[part][1] + reach) & (high >= ends[part][0] - reach)):
                continue
            if comm.size > 1:
                flags[of.facing(every[other], reach)[0], 1] = True
            elif other > part:  # both sides at once
                facet, against = of.facing(every[other], reach)
                flags[facet, 1] = flags_of[other][against, 1] = True
    return flags_of
