"""The inverse of a Newton system of contact with A as a matrix, without conditions on the forces alone."""

import numpy as np
import pytest

from coulomb.solvers.contact_equations import ContactDerivative
from coulomb.solvers.contact_preconditioner import FormedInverse

OPEN, STICK, SLIP, FRICTIONLESS = range(4)


def posed(states, friction, rng):
    """A, and the derivative of the equations with these states: P, Q and M = P + Q A."""
    m = len(states)
    B = rng.standard_normal((3 * m, 3 * m))
    A = B @ B.T + 0.3 * m * np.eye(3 * m)
    P, Q = np.zeros((2, m, 3, 3))
    for node, state in enumerate(states):
        here = A.diagonal()[3 * node : 3 * node + 3]
        e, part = rng.standard_normal(2), rng.uniform(1e-3, 1.0)
        e /= np.linalg.norm(e)
        T = {SLIP: part * (np.eye(2) - np.outer(e, e)), FRICTIONLESS: np.zeros((2, 2))}.get(state, np.eye(2))
        P[node, 1:, 1:], Q[node, 0, 0], Q[node, 1:, 1:] = np.eye(2) - T, 1.0 / here[0], T / here[1:].mean()
        P[node, 1:, 0] = -friction * e if state == SLIP else 0.0
        if state == OPEN:
            P[node], Q[node] = np.eye(3), 0.0
    M = np.einsum("iab,ibjc->iajc", Q, A.reshape(m, 3, m, 3))
    M[range(m), :, range(m)] += P
    return A, ContactDerivative(np.zeros((m, 3)), P, Q, np.array(states)), M.reshape(A.shape)


@pytest.mark.parametrize("precision", [np.float64, np.float32])
def test_inverse_transpose_and_sign_of_the_determinant(precision):
    """Against dense algebra; large friction makes determinants of either sign.  A slipping node has two rows."""
    rng, signs = np.random.default_rng(7), []
    for friction in (0.3, 20.0, 40.0, 60.0):
        states = [OPEN, *rng.integers(0, 4, 12), SLIP]
        A, at, M = posed(states, friction, rng)
        inverse = FormedInverse(A.astype(precision), A.diagonal().reshape(-1, 3))
        inverse.move(at)
        assert len(inverse._factors) == sum((0, 3, 2, 1)[state] for state in states)
        r, accuracy = rng.standard_normal((len(states), 3, 2)), np.linalg.cond(M) * 10.0 * inverse.precision
        for found, of in ((inverse(r), M), (inverse.transposed(r), M.T)):
            right = np.linalg.solve(of, r.reshape(-1, 2))
            assert np.linalg.norm(found.reshape(-1, 2) - right) <= max(accuracy, 1e-6) * np.linalg.norm(right)
        signs.append(np.linalg.det(M) < 0.0)
        assert inverse.negative == signs[-1]
    assert len(set(signs)) == 2


def test_points_that_are_all_open():
    A, at, _ = posed([OPEN, OPEN], 0.3, np.random.default_rng(1))
    inverse, r = FormedInverse(A, A.diagonal().reshape(-1, 3)), np.ones((2, 3))
    inverse.move(at)
    assert np.array_equal(inverse(r), r) and np.array_equal(inverse.transposed(r), r)
    assert inverse.condition == 1.0 and not inverse.negative
