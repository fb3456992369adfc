"""Problems made from a solution, compliances of contacts 16 decades apart or friction of 10: solved, and right."""

import numpy as np
import pytest

from coulomb import Status, solve_coulomb, solve_tresca
from coulomb.solvers import ConeInteriorPoint, FrictionProblem
from coulomb.solvers.rigid.matrix_problems import _compliance
from coulomb.solvers.rigid.own_units import OwnUnits


def far_apart(seed):
    """A (3 m, 3 m), b (3 m,) and F (m,) of up to 40 contacts: with full rank, half of it or that of rigid bodies."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 41))
    n, kind = 3 * m, str(rng.choice(["spd", "cond", "half", "rigid", "elastic", "blockzero"]))
    if kind == "cond":
        Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
        A = (Q * 10 ** rng.uniform(-10, 0, n)) @ Q.T
    elif kind == "rigid":
        A = of_rigid_bodies(m, rng)
    else:
        assert kind == "elastic", kind
        place = rng.uniform(size=(m, 3))
        A = np.kron(1.0 / (np.linalg.norm(place[:, None] - place[None], axis=2) + 0.05), np.eye(3))
        A += max(0.0, 1e-3 - np.linalg.eigvalsh(A)[0]) * np.eye(n)
    alike = rng.integers(0, 2)
    F = np.full(m, rng.choice([0.0, 0.5, 2.0, 5.0, 10.0])) if alike else rng.choice([0.0, 0.1, 1.0, 3.0, 10.0], size=m)
    scale = str(rng.choice(["none", "global", "contact"]))
    if scale == "contact":
        D = np.repeat(10 ** rng.uniform(-4, 4, m), 3)
        A = D[:, None] * A * D[None]
    elif scale == "global":
        A = A * 10 ** rng.uniform(-14, 8)
    A = 0.5 * (A + A.T)
    assert rng.integers(0, 3) > 0, "it has no known solution"
    return A, from_a_solution(A, F, rng), F


def of_rigid_bodies(m, rng):
    bodies = int(rng.integers(1, max(2, m // 3 + 1)))
    H = np.zeros((3 * m, 6 * bodies))
    for c in range(m):
        normal = rng.normal(size=3)
        normal /= np.linalg.norm(normal)
        q = np.linalg.qr(np.column_stack([normal, rng.normal(size=(3, 2))]))[0]
        q[:, 0] = normal
        first, second = rng.integers(bodies), rng.integers(bodies + 1)
        for body, sign in ((first, 1), (second, -1)):
            if body < bodies and not (first == second and sign == -1):
                arm = rng.normal(size=3)
                H[3 * c : 3 * c + 3, 6 * body : 6 * body + 3] += sign * q.T
                H[3 * c : 3 * c + 3, 6 * body + 3 : 6 * body + 6] += sign * np.cross(arm, q.T)
    return (H * np.repeat(10 ** rng.uniform(-3, 3, bodies), 6)) @ H.T


def from_a_solution(A, F, rng):
    """b = A x - w with x and w that obey Coulomb's law: a third each open, sticking and sliding."""
    a, m = np.diag(A).mean(), len(F)
    state, x, w = rng.integers(0, 3, m), np.zeros((m, 3)), np.zeros((m, 3))
    size = 10 ** rng.uniform(-1, 1, m)
    for k in range(m):
        angle = rng.uniform(0, 2 * np.pi)
        way = np.array([np.cos(angle), np.sin(angle)])
        if state[k] == 0:
            w[k] = [size[k] * a, *(rng.normal(size=2) * a)]
            continue
        x[k, 0] = size[k]
        x[k, 1:] = way * F[k] * size[k] * (rng.uniform(0, 0.98) if state[k] == 1 else 1.0)
        if state[k] == 2:
            w[k, 1:] = -way * a * 10 ** rng.uniform(-1, 1)
    return A @ x.ravel() - w.ravel()


def worst(A, b, x, bound):
    """Largest natural residual of a contact over its force, or 1e-2 of the largest, in the units of sqrt(a) of each in
    which all compliances are alike; numbers of extended precision."""
    own = np.sqrt(np.diag(A).reshape(-1, 3).mean(axis=1))
    w = (A.astype(np.longdouble) @ x - b).astype(float).reshape(-1, 3) / own[:, None]
    y, r = x.reshape(-1, 3) * own[:, None], bound * own
    p = (y - w)[:, 1:]
    shrink = np.minimum(1.0, r / np.maximum(np.hypot(*p.T), 1e-300))
    left = np.column_stack([np.minimum(y[:, 0], w[:, 0]), y[:, 1:] - shrink[:, None] * p])
    force = np.linalg.norm(y, axis=1)
    return (np.linalg.norm(left, axis=1) / np.maximum(force, 1e-2 * force.max())).max()


def rounding(A, b, x):
    """What rounding errors of A x - b in double precision are in `worst`, of n terms sqrt(n) times that of one."""
    own = np.sqrt(np.diag(A).reshape(-1, 3).mean(axis=1))
    w = np.sqrt(len(b)) * 2.0**-53 * (np.abs(A) @ np.abs(x) + np.abs(b)).reshape(-1, 3) / own[:, None]
    force = np.linalg.norm(x.reshape(-1, 3), axis=1) * own
    return (np.linalg.norm(w, axis=1) / np.maximum(force, 1e-2 * force.max())).max()


@pytest.mark.parametrize(
    ("seed", "times", "solver"),
    [(392, 1.0, None), (392, 0.9, None), (392, 2.3, None), (357, 1.0, ConeInteriorPoint(sweeps=False))],
)
def test_large_friction(seed, times, solver):
    """All methods ended on curves whose steps had become shorter than 1e-6; of a curve that had reached its end, by
    rounding errors (as with other kernels of BLAS, or in other units), the answer there was not taken."""
    A, b, F = far_apart(seed)
    A, b = times * A, times * b
    result = solve_coulomb(A, b, F, solver)
    assert result.status is Status.CONVERGED
    assert worst(A, b, result.x, F * np.maximum(result.x[::3], 0.0)) <= 3e-8


def test_friction_beyond_its_bound_in_the_given_units():
    """Of a contact of a compliance 1e-10 of the largest, by 2e-5 of its force: a rounding error in its own units."""
    A, b, F = far_apart(423)
    result = solve_coulomb(A, b, F)
    assert result.status is Status.CONVERGED
    assert worst(A, b, result.x, F * np.maximum(result.x[::3], 0.0)) <= 3e-8


def test_forces_that_move_nothing_hide_no_error_from_the_given_units():
    """A body between walls that penetrate by 1e-2, pressed with 1e6: small beside the forces, but not by the
    collection's measure.  Of scattered(30, 120, 2.0, 703) such an answer was taken at 1.5e-8."""
    n = np.array([1.0, 0.0, 0.0, -1.0, 0.0, 0.0])
    A = np.zeros((9, 9))
    A[:6, :6] = np.outer(n, n) + np.diag([0.0, 1.0, 1.0, 0.0, 1.0, 1.0])
    A[6:, 6:] = 100.0 * np.eye(3)
    b = np.array([1e-2, 0.0, 0.0, 1e-2, 0.0, 0.0, 0.0, 0.0, 0.0])
    problem = FrictionProblem.coulomb(_compliance(A), b, np.full(3, 0.5))
    own = OwnUnits.of(problem)
    pressed = 1e6 * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert (
        problem.law.natural_residual(pressed, problem.gradient(pressed), problem.mean_diagonal, problem.reductions)
        < 1e-6
    )
    assert not own.problem(1e-2).accept(pressed / own.units)
    b[3] = -1e-2  # the body goes along
    problem = FrictionProblem.coulomb(_compliance(A), b, np.full(3, 0.5))
    own = OwnUnits.of(problem)
    answer = np.array([1e-2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert own.problem(1e-2).accept(answer / own.units)


@pytest.mark.parametrize("seed", [95, 338, 370, 412, 420, 517])
def test_given_slip_bounds(seed):
    """Contacts at the edge of the disc without slip, where a path alone came no nearer than 1e-8 in 200 steps (338,
    370); and slips 10,000 times larger than what the friction forces there could move (95)."""
    A, b, F = far_apart(seed)
    bound = F * np.abs(b).max() / np.diag(A).mean() * np.random.default_rng(seed + 10**6).uniform(0, 1)
    result = solve_tresca(A, b, bound)
    assert result.status is Status.CONVERGED and result.newton_steps < 500
    assert worst(A, b, result.x, bound) <= 1e-8 + rounding(A, b, result.x)
