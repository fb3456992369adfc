"""Pairs of faces: the weights of contact points on both sides, against exact integrals of linear fields."""

from itertools import product

import numpy as np
import pytest

import coulomb
from coulomb.fem import compat
from coulomb.fem.bodies.displacement_space import DisplacementSpace
from coulomb.fem.contact.facet_patch import facet_patch
from coulomb.fem.contact.mortar import mortar_rows

TURN = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
TURN *= np.linalg.det(TURN)
KINDS = list(product(("hexahedron", "tetrahedron"), (1, 2)))
GAP = 0.1


def side(size, cells, kind, face, place):
    """The space of displacements on a box, and the patch of one of its faces."""
    cell, degree = kind
    mesh = coulomb.box(size, cells, cell, place=place, degree=degree)
    space = DisplacementSpace(compat.functionspace(mesh.domain, degree, (3,)))
    return space, facet_patch(space, mesh.faces[face])


def upper(kind):
    """The slave: a unit cube."""
    return side((1.0, 1.0, 1.0), (3, 4, 1), kind, "bottom", lambda x: TURN @ x)


def lower(kind, size):
    """The master below it, turned about the vertical, as large as given."""
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    middle, place = np.array([[size / 2], [size / 2], [1.0]]), np.array([[0.5], [0.5], [-GAP]])
    return side((size, size, 1.0), (5, 4, 1), kind, "top", lambda x: TURN @ (turn @ (x - middle) + place))


def linear(x):
    """A linear field at points (k, 3)."""
    return x @ np.arange(9.0).reshape(3, 3) ** 2 + np.array([1.0, 2.0, 3.0])


OPPOSITE = [(3.0, kinds) for kinds in zip(KINDS, KINDS[::-1], strict=True)]


@pytest.mark.parametrize(("size", "kinds"), [*OPPOSITE, *((0.5, (kind, kind)) for kind in KINDS)], ids=str)
def test_linear_fields_are_averaged_exactly_across_plane_meshes(kinds, size):
    (space, slave), (other, master) = upper(kinds[0]), lower(kinds[1], size)
    rows = mortar_rows(slave, master, (0, slave.size))
    for weights in (rows.weights, rows.opposite):
        assert np.allclose(np.asarray(weights.sum(axis=1)), 1.0, rtol=0, atol=1e-12)
    assert np.allclose(rows.normal, -TURN[:, 2], rtol=0, atol=1e-12)
    assert np.allclose(rows.gap(rows.normal), GAP, rtol=0, atol=1e-12)
    before = rows.x + rows.gap(rows.normal)[:, None] * rows.normal
    assert np.allclose(rows.weights @ linear(space.x), linear(rows.x), rtol=0, atol=1e-11)
    assert np.allclose(rows.opposite @ linear(other.x), linear(before), rtol=0, atol=1e-11)
    assert rows.area.sum() == pytest.approx(min(size, 1.0) ** 2, rel=1e-12)
    # a uniform pressure has the exact nodal forces on the side that is wholly covered
    covered, force = (slave, rows.area @ rows.weights) if size > 1 else (master, rows.area @ rows.opposite)
    exact = np.bincount(covered.nodes.ravel(), covered.whole.ravel(), covered.size)
    assert np.allclose(force, exact, rtol=0, atol=1e-12)
