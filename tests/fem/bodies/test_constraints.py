"""Held directions of nodes, and the rows of supports that meet."""

import numpy as np
import pytest

from coulomb.fem.bodies.constraints import HeldDirections, prescribed_rows

Z = np.zeros(3)
X, Y = np.eye(3)[:2]
TILTED = np.array([0.6, 0.8, 0.0])


def rows(*directions):
    """Directions of one node."""
    return np.array([[*directions, *[Z] * (3 - len(directions))]])


def at_one_node(*supports):
    return prescribed_rows(2, [(np.array([1]), given) for given in supports])


def projector(*directions):
    q, _ = np.linalg.qr(np.array(directions).T)
    return q @ q.T


@pytest.mark.parametrize(
    ("supports", "owners", "span"),
    [
        ([rows(X)], [0], [X]),
        ([rows(X, Y), rows(X)], [0, 1], [X, Y]),
        ([rows(X), rows(X, Y)], [1, 1], [X, Y]),
        ([rows(X), rows(TILTED)], [0, 1], [X, Y]),
        ([rows(X, Y), rows(TILTED)], [0, 1], [X, Y]),
        ([rows(*np.eye(3)), rows(TILTED)], [0, 0, 1], np.eye(3)),
        ([rows(TILTED), rows(*np.eye(3))], [1, 1, 1], np.eye(3)),
        ([rows(TILTED), rows(TILTED + 1e-7 * X)], [1], [TILTED]),
        ([rows(X), rows(TILTED), rows(Y)], [1, 2], [X, Y]),
    ],
)
def test_the_later_support_applies_where_directions_depend(supports, owners, span):
    found = at_one_node(*supports)
    assert sorted(found.support) == owners and np.all(found.node == 1)
    assert np.allclose(found.held.projector[0], projector(*span), atol=1e-6)
    assert found.held.number == len(span) and list(found.held.nodes) == [1]
    assert np.allclose(np.linalg.norm(found.direction, axis=1), 1.0)


def test_values_are_met_along_every_direction_and_forces_belong_to_theirs():
    found = at_one_node(rows(X), rows(TILTED))
    values = np.array([2.0, 5.0])[found.support]
    u = found.displacement(values)
    assert np.allclose(np.einsum("ri,ri->r", found.direction, u[found.node]), values) and np.allclose(u[0], 0.0)
    force = np.zeros((2, 3))
    force[1] = 3.0 * X - 7.0 * TILTED
    shares = found.forces(force)
    assert np.allclose(shares[found.support == 0], 3.0 * X) and np.allclose(shares[found.support == 1], -7.0 * TILTED)


def test_an_earlier_support_keeps_what_is_orthogonal_to_the_later():
    """Held along x and y to go by (1, 2), then along a tilted direction by 0: what remains is the part across it."""
    found = at_one_node(rows(X, Y), rows(TILTED))
    values = np.where(found.support == 0, found.direction @ [1.0, 2.0, 0.0], 0.0)
    across = np.array([-0.8, 0.6, 0.0])
    assert np.allclose(found.displacement(values)[1], across * (across @ [1.0, 2.0, 0.0]))


def test_parts_are_exact_along_axes_and_add_up_otherwise():
    nodes, v = np.array([0, 2]), np.random.default_rng(1).standard_normal((3, 3))
    directions = np.concatenate([rows(X, Y), rows(np.array([1.0, 2.0, 2.0]) / 3.0)])
    held = prescribed_rows(3, [(nodes, directions)]).held
    assert np.array_equal(held.held_part(v)[0], [*v[0, :2], 0.0]) and np.array_equal(held.free_part(v)[1], v[1])
    assert np.allclose(held.held_part(v) + held.free_part(v), v, rtol=1e-15)
    assert abs(held.free_part(v)[2] @ [1.0, 2.0, 2.0]) <= 1e-15
    assert np.array_equal(held.components, [[True, True, False], [False] * 3, [False] * 3])
    again = HeldDirections.of_fields(held.fields["held"], held.fields["held_oblique"])
    assert np.array_equal(again.nodes, nodes) and np.allclose(again.projector, held.projector, atol=1e-15)
