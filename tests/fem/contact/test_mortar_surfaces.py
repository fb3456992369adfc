"""Pairs of curved, partly covered, layered and far faces; parts of a face on different ranks."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse

from coulomb.fem.contact.facet_patch import FacetKind, FacetPatch
from coulomb.fem.contact.mortar import LEAST_SHARE, mortar_rows
from coulomb.fem.contact.mortar_parts import areas, clipped

Q1, Q2, P1, P2 = FacetKind(4, 1), FacetKind(4, 2), FacetKind(3, 1), FacetKind(3, 2)


def surface(cells, kind, place, outward=1):
    """Facets of the image of the unit square; `outward` is -1 if dr x ds points into the body."""
    n, m = (kind.degree * count for count in cells)
    r, s = (axis.ravel() for axis in np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij"))
    x = place(r / n, s / m)
    i, j = (kind.degree * axis.ravel()[:, None] for axis in np.meshgrid(*map(np.arange, cells), indexing="ij"))
    steps = np.round(kind.points * kind.degree).astype(int)
    halves = [steps] if kind.corners == 4 else [steps, kind.degree - steps]
    cells = np.concatenate([(i + half[:, 0]) * (m + 1) + j + half[:, 1] for half in halves])
    _, first, number = np.unique(np.round(x, 9), axis=0, return_index=True, return_inverse=True)  # a closed surface
    nodes = number.ravel()[cells][:, kind.mirrored if outward < 0 else slice(None)].astype(np.int64)
    return FacetPatch(kind, nodes, x[first][nodes], len(first))


def cylinder(radius, length, phase=0.0):
    def place(r, s):
        angle = 2.0 * np.pi * r + phase
        return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), length * s])

    return place


def cap(radius, width, phase=0.0):
    """The lower part of a sphere, or its mould."""

    def place(r, s):
        x, y = width * (2 * r - 1), width * (2 * s - 1)
        c, w = np.cos(phase), np.sin(phase)
        d = np.column_stack([c * x - w * y, w * x + c * y, -np.ones_like(x)])
        return radius * d / np.linalg.norm(d, axis=1)[:, None]

    return place


def flat(size, z, at=(0.0, 0.0)):
    return lambda r, s: np.column_stack([size * (r - 0.5) + at[0], size * (s - 0.5) + at[1], np.full(len(r), z)])


def both(one, other):
    return FacetPatch(
        one.kind, np.concatenate([one.nodes, other.nodes + one.size]), np.concatenate([one.x, other.x]), 2 * one.size
    )


def whole(slave, master, **options):
    return mortar_rows(slave, master, (0, slave.size), **options)


@pytest.mark.parametrize(
    ("slave", "master", "gap"),
    [(Q1, Q1, 0.01), (P1, Q1, -0.01), (Q2, Q2, 0.01), (P2, P2, -0.01), (Q1, P2, 0.01)],
    ids=str,
)
def test_gaps_of_concentric_faces_are_second_order(slave, master, gap):
    """A pin in a hole, a ball in a socket, with other facets: the sagitta of the facets is all that is wrong."""
    pins, balls = [], []
    coarse = 8 if Q1 in (slave, master) else 4
    for n in (coarse, 2 * coarse):
        pin = whole(
            surface((4 * n, 2), slave, cylinder(1.0, 0.5, 0.1)),
            surface((5 * n, 3), master, cylinder(1.0 + gap, 0.5), -1),
        )
        ball = whole(
            surface((n, n), slave, cap(1.0, 0.4), -1),
            surface((3 * n // 2, 3 * n // 2), master, cap(1.0 + gap, 0.6, 0.3)),
        )
        for rows, errors in ((pin, pins), (ball, balls)):
            assert len(rows.dropped) == 0 and rows.lost == 0.0 and rows.layered == 0
            errors.append(np.abs(rows.gap(rows.normal) - gap).max())
    sagitta = (2.0 * np.pi / (4 * coarse)) ** 2 / 8.0
    assert pins[0] < 1.1 * sagitta and pins[1] < pins[0] / 2.5
    assert balls[0] < 0.5 * (0.8 / coarse) ** 2 and balls[1] < balls[0] / 3.0


@pytest.mark.parametrize(("curved", "plane"), [(Q1, P1), (P1, Q2), (Q2, P2), (P2, Q1), (P2, P2)], ids=str)
@pytest.mark.parametrize(("slave", "shift"), [("roller", 0.0), ("plate", 0.3), ("roller", 0.5)])
def test_a_gap_that_is_nowhere_negative_makes_no_interference(curved, plane, slave, shift):
    """A roller of any facets on a plate, with a vertex or the middle of a facet at the lowest place, partly over its
    edge: the means of the gap with dual functions are down to -h^2/(12 R)."""

    def roller(r, s):
        angle = -0.5 * np.pi + 2.0 * np.pi / 16 * (8 * (r - 0.5) + shift)
        return np.column_stack([np.cos(angle), s - 0.5, 1.0 + np.sin(angle)])

    patch = surface((8, 3), curved, roller, -1)
    r, s = np.random.default_rng(7).dirichlet((1.0, 1.0, 1.0), 2000)[:, :2].T
    lowest = min(np.einsum("nq,fn->fq", np.stack(curved.values(r, s)), patch.x[:, :, 2]).min(), patch.x[:, :, 2].min())
    plate = surface((7, 4), plane, flat(1.3, lowest - 1e-5, (0.1, 0.05)))
    rows = whole(patch, plate) if slave == "roller" else whole(plate, patch)
    gap = rows.gap(rows.normal)
    assert gap.min() >= 0.0 and gap.min() < 0.02


@pytest.mark.parametrize("kind", [Q1, Q2, P2], ids=str)
def test_normals_of_curved_faces(kind):
    """Along a cylinder the means over the facets around a point are the normals of the cylinder, where as many are on
    both sides."""
    rows = whole(surface((24, 2), kind, cylinder(1.0, 0.5)), surface((30, 3), Q1, cylinder(1.1, 0.5), -1))
    radial = rows.x * (1.0, 1.0, 0.0)
    assert np.allclose(rows.normal, radial / np.linalg.norm(radial, axis=1)[:, None], atol=2e-3)


@pytest.mark.parametrize("distance", [1e-9, 1.0, 1e4])
def test_the_master_may_be_anywhere_before_the_slave(distance):
    slave = surface((4, 4), Q1, flat(1.0, 0.0), -1)
    rows = whole(slave, surface((3, 3), P1, flat(2.0, -distance)))
    assert np.allclose(rows.gap(rows.normal), distance, rtol=1e-12) and rows.area.sum() == pytest.approx(1.0, rel=1e-12)
    assert len(whole(slave, surface((3, 3), P1, flat(2.0, -distance), -1)).node) == 0  # it turns its back
    assert len(whole(slave, surface((3, 3), P1, flat(2.0, -distance, (2.0, 0.0)))).node) == 0  # it is beside


@pytest.mark.parametrize("other", [-0.5, 0.2])
def test_of_several_layers_the_nearest_counts(other):
    """Another master facet behind the nearest one, or above it inside the slave's body."""
    slave = surface((4, 4), Q1, flat(1.0, 0.0), -1)
    master = both(surface((5, 5), Q1, flat(2.0, other)), surface((3, 3), Q1, flat(2.0, -0.1)))
    rows = whole(slave, master)
    assert np.allclose(rows.gap(rows.normal), 0.1, atol=1e-12) and rows.layered == len(slave)
    assert rows.area.sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("at", [(0.0, 0.0), (1.0, 1.0), (4.9, 4.9)])
def test_a_master_smaller_than_a_slave_facet_is_not_missed(at):
    slave, master = surface((2, 2), Q1, flat(10.0, 0.0), -1), surface((3, 3), Q1, flat(0.3, -0.1, at))
    rows = whole(slave, master)
    overlap = (min(at[0] + 0.15, 5.0) - at[0] + 0.15) ** 2
    assert len(rows.node) == 1 and rows.area[0] == pytest.approx(overlap, rel=1e-10)
    assert rows.gap(rows.normal)[0] == pytest.approx(0.1, rel=1e-10)
    assert len(rows.dropped) >= 3


@pytest.mark.parametrize("kind", [Q1, P1, Q2, P2], ids=str)
def test_a_master_that_ends_before_the_slave(kind):
    """Whatever the share of the last facets: a uniform pressure acts on the covered area, with its moment."""
    slave = surface((4, 4), kind, flat(1.0, 0.0), -1)
    for end in (1e-12, 1e-7, 1e-3, 0.05, 0.3, 0.6, 0.95):
        edge = 0.25 * end
        master = surface((5, 3), Q1, lambda r, s, e=edge: np.column_stack([(1 + e) * r - 1, 2 * s - 1, 0 * r - 0.1]))
        rows = whole(slave, master)
        area, moment = 0.5 + edge, 0.5 * (edge**2 - 0.25)
        assert rows.area.sum() == pytest.approx(area, rel=1e-5)
        assert rows.area @ rows.x[:, 0] == pytest.approx(moment, abs=1e-5)
        assert np.allclose(rows.gap(rows.normal), 0.1, atol=1e-10)
        assert np.all(rows.area > 0.9 * LEAST_SHARE * rows.whole)
        assert np.abs(rows.weights).max() < 10.0 and np.abs(rows.opposite).max() < 10.0


@pytest.mark.parametrize("kind", [Q1, P1, Q2, P2], ids=str)
def test_nodes_left_out_pass_their_part_on(kind):
    """The edges of a face: the others bear a uniform pressure on the whole face; of all nodes, no one is left."""
    slave, master = surface((4, 4), kind, flat(1.0, 0.0), -1), surface((3, 3), Q1, flat(2.0, -0.1))
    nodes, first = np.unique(slave.nodes, return_index=True)
    x = slave.x.reshape(-1, 3)[first]
    edges = nodes[np.any(np.abs(np.abs(x[:, :2]) - 0.5) < 1e-9, axis=1)]
    rows = whole(slave, master, left_out=edges)
    assert not np.any(np.isin(rows.node, edges)) and rows.lost == 0.0
    assert rows.area.sum() == pytest.approx(1.0, rel=1e-12)
    force = np.zeros(slave.size)
    np.add.at(force, slave.nodes, slave.whole)
    assert np.allclose(rows.area @ rows.weights, force, atol=1e-13)
    none = whole(slave, master, left_out=nodes)
    assert len(none.node) == 0 and none.lost == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("kind", [Q1, P1, P2], ids=str)
def test_parts_of_a_face_are_those_of_the_whole(kind):
    """The rows of ranks with consecutive nodes, together: with nodes left out, and a master that ends before."""
    slave, master = surface((9, 7), kind, flat(1.0, 0.0), -1), surface((5, 4), Q1, flat(0.83, -0.1, (0.2, 0.1)))
    clamped = np.arange(3, slave.size, 7)
    one = whole(slave, master, left_out=clamped)
    bounds = [0, slave.size // 5, slave.size // 2, slave.size]
    parts = [mortar_rows(slave, master, owned, left_out=clamped) for owned in pairwise(bounds)]
    for name in ("node", "area", "whole", "normal", "x", "separation", "overlap", "dropped"):
        assert np.allclose(np.concatenate([getattr(part, name) for part in parts]), getattr(one, name), atol=1e-13)
    for name in ("weights", "opposite"):
        together = scipy.sparse.vstack([getattr(part, name) for part in parts])
        assert abs(together - getattr(one, name)).max() < 1e-12
    assert sum(part.layered for part in parts) == one.layered
    assert sum(part.lost for part in parts) == pytest.approx(one.lost)


def test_normals_that_cancel_are_refused():
    """Both sides of a thin plate as one face: what is before them is no one's."""
    sheet = surface((2, 2), Q1, flat(1.0, 0.0), -1)
    double = FacetPatch(Q1, np.concatenate([sheet.nodes, sheet.nodes[:, Q1.mirrored]]), np.tile(sheet.x, (2, 1, 1)), 9)
    double.x[4:] = sheet.x[:, Q1.mirrored]
    master = both(surface((3, 3), Q1, flat(2.0, -0.1)), surface((3, 3), Q1, flat(2.0, 0.1), -1))
    with pytest.raises(ValueError, match=r"normals of the facets around x = .* cancel"):
        whole(double, master)


def quadrilaterals(number, seed):
    """Random convex ones, counterclockwise."""
    random = np.random.default_rng(seed)
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) + 0.2 * random.random((number, 4, 2)) - 0.1
    angle, middle = 2.0 * np.pi * random.random(number), 0.8 * random.random((number, 1, 2))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.einsum("ijk,knj->kni", turn, corners) + middle


@pytest.mark.parametrize("noise", [0.0, 1e-16, 1e-15, 1e-12])
def test_polygons_that_nearly_coincide_are_clipped(noise):
    """Matching meshes: sides on sides up to rounding errors; each polygon is its own part, in either orientation."""
    one = quadrilaterals(20_000, 0)
    other = one + noise * np.random.default_rng(1).normal(size=one.shape)
    for subject in (one, one[:, ::-1]):
        parts, pairs = clipped(subject, other)
        assert len(pairs) == len(one)
        assert np.allclose(np.abs(areas(parts)), areas(one), rtol=0, atol=10.0 * noise + 1e-14)


def test_sagittas_are_those_of_the_smooth_face():
    """h^2/(8 R) of a cylinder; 0 of a plane, of second-order facets, and where facets meet at an edge."""
    assert np.allclose(
        np.linalg.norm(surface((32, 3), Q1, cylinder(2.0, 1.0)).bulges, axis=1),
        2.0 * (1 - np.cos(np.pi / 32)),
        rtol=0.01,
    )
    for plane in (surface((4, 4), P1, flat(1.0, 0.0)), surface((5, 1), Q1, cylinder(1.0, 3.0))):
        assert np.allclose(plane.bulges, 0.0, atol=1e-15)
    assert np.all(surface((8, 3), Q2, cylinder(2.0, 1.0)).bulges == 0.0)
