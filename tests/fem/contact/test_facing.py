"""Facets that have met on straight ways, and those that never have."""

import numpy as np
import pytest
from mpi4py import MPI

from coulomb.fem.contact import body_boundary
from coulomb.fem.contact.body_boundary import in_boxes
from coulomb.fem.contact.facet_patch import FacetKind, FacetPatch
from coulomb.fem.contact.facing import Facets, near


def moved(x, u):
    """A body of triangles of their own nodes that move so."""
    patch = FacetPatch(FacetKind(3, 1), np.arange(3 * len(x)).reshape(-1, 3), x, 3 * len(x))
    return Facets.of(patch, u, np.zeros(len(x)), FacetPatch(patch.kind, patch.nodes, x + u, 0).middle_vectors)


def test_triangles_that_touch_at_any_time_have_met():
    rng, count = np.random.default_rng(41), 2000
    x, u = rng.normal(size=(2, 2, count, 3, 3)) * np.array([1.0, 0.3])[:, None, None, None, None]
    weights, time = rng.dirichlet(np.ones(3), (2, count)), rng.uniform(size=count)
    places = np.einsum("sfn,sfni->sfi", weights, x + time[:, None, None] * u)
    x[1] += (places[0] - places[1])[:, None]  # a point of one is at one of the other at that time
    one, other = (moved(*of) for of in zip(x, u, strict=True))
    same = np.arange(count)
    assert not np.any(one.never_met(same, other, same))
    assert np.mean(one.never_met(same, other, np.roll(same, 1))) > 0.2


def test_those_beside_an_edge_have_not_met_but_those_of_a_slot_that_closes():
    beside = np.array([[(0, 0, 0), (0, 1, 0), (-1, 0, 0)], [(0, 1.5, 0), (0, 1.5, -1), (0, 2.5, -1)]], dtype=float)
    slot = np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 0, 1), (0, 1, 1), (1, 0, 1)]], dtype=float)
    far = np.full(3, 5.0)
    for x, way, met in ((beside, 0.4, False), (slot, 0.2, False), (slot, 1.1, True)):
        u = np.zeros((2, 3, 3))
        u[0, :, 2] = way  # towards the other one
        u[1, :, 0] = 0.1 * x[1, :, 2]  # that turns so that they face each other
        assert near([moved(x, u)], far, MPI.COMM_SELF)[0][:, 0].tolist() == [met, met]
        apart = near([moved(x[:1], u[:1]), moved(x[1:], u[1:])], far, MPI.COMM_SELF)
        assert [of[:, 1].tolist() for of in apart] == [[True], [True]]


@pytest.mark.parametrize("few", [10**9, 0])  # looked at one by one, and by a tree
@pytest.mark.parametrize("count", [0, 1, 40, 700])
def test_boxes_that_meet_are_those_that_overlap_along_every_axis(count, few, monkeypatch):
    monkeypatch.setattr(body_boundary, "_FEW", few)
    rng = np.random.default_rng(17)
    low = np.round(rng.uniform(size=(2, count, 3)), 2)  # some touch
    high = low + np.round(0.3 * rng.uniform(size=(2, count, 3)), 2)
    met = np.ones((count, count), dtype=bool)
    for axis in range(3):
        met &= (low[0, :, None, axis] <= high[1, None, :, axis]) & (high[0, :, None, axis] >= low[1, None, :, axis])
    pairs = np.zeros_like(met)
    pairs[in_boxes((low[0], high[0]), (low[1], high[1]))] = True
    assert np.array_equal(pairs, met) and (count < 40 or 0.001 < met.mean() < 0.999)
