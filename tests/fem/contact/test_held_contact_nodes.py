"""Contact nodes with prescribed directions: random problems with A = P C P, P the projection on free directions."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from conftest import dense_compliance, objective, random_spd
from shared_problems import by_clarabel

import coulomb
from coulomb import InteriorPoint, SuccessiveTresca
from coulomb.solvers import KPRGP, FrictionLaw, FrictionProblem
from coulomb.solvers.newton_systems import AugmentedSystem, DenseSystem, SchurComplementSystem

FREE, T1, T2, TANGENT, PLANE, OBLIQUE, LINE = range(7)
"""Nothing held; t1; t2; a direction between t1 and t2; both; a direction between n and t1; all but one direction."""


def held(kind, rng):
    """Orthonormal held directions of a node in its frame n, t1, t2, shape (3, h)."""
    c, s = np.cos(angle := rng.uniform(0.3, 1.2)), np.sin(angle)
    e = np.eye(3)
    if kind == LINE:
        return np.linalg.qr(rng.standard_normal((3, 2)))[0]
    chosen = {FREE: [], T1: [e[1]], T2: [e[2]], PLANE: [e[1], e[2]]}
    return np.array({**chosen, TANGENT: [c * e[1] + s * e[2]], OBLIQUE: [c * e[0] + s * e[1]]}[kind]).reshape(-1, 3).T


@dataclass
class Held:
    """A random problem: A, b, the kinds of the nodes, and a force of the size of the answer."""

    A: np.ndarray
    b: np.ndarray
    kind: np.ndarray
    force: float

    @property
    def m(self):
        return len(self.kind)


@cache
def held_problem(seed, nodes=21, condition=1e3, still=False):
    """Every kind of node; the known slips are of the size of the others, or all 0."""
    rng = np.random.default_rng(seed)
    kind = rng.permutation(np.arange(nodes) % 7)
    C = 1e-9 * random_spd(3 * nodes, condition, rng)
    P = np.eye(3 * nodes)
    for k in range(nodes):
        H = held(kind[k], rng)
        P[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] -= H @ H.T
    P[np.abs(P) < 1e-15] = 0.0
    b = 1e-4 * rng.standard_normal(3 * nodes)
    b[0::3] = np.abs(b[0::3]) * rng.choice([-1, 1, 1], nodes)
    return Held(P @ C @ P, P @ b if still else b, kind, np.abs(b).mean() / np.diag(C).mean())


TRESCA = {
    "P_SC": InteriorPoint(tolerance=1e-10),
    "P_AM": InteriorPoint(tolerance=1e-10, newton=AugmentedSystem()),
    "paper's P_AM": InteriorPoint(tolerance=1e-10, newton=AugmentedSystem(rank=0)),
    "dense": InteriorPoint(tolerance=1e-10, newton=DenseSystem()),
    "KPRGP": KPRGP(tolerance=1e-8),
}


@cache
def tresca_friction(seed):
    """A problem, its slip bounds, and Clarabel's answer."""
    p = held_problem(seed)
    g = p.force * np.random.default_rng(seed).uniform(0.05, 1.0, p.m)
    return p, g, by_clarabel(p.A, p.b, g, np.zeros(p.m))


@pytest.mark.parametrize("solver", TRESCA.values(), ids=TRESCA)
@pytest.mark.parametrize("seed", [1, 2])
def test_tresca_friction_agrees_with_clarabel(solver, seed):
    p, g, theirs = tresca_friction(seed)
    qp = FrictionProblem.tresca(dense_compliance(p.A), p.b, g)
    result = solver.solve(qp)
    assert result.residual <= solver.tolerance
    assert objective(qp, result.x) == pytest.approx(objective(qp, theirs), rel=1e-7)
    assert np.linalg.norm(result.x - theirs) <= 1e-3 * np.linalg.norm(theirs)


def by_fixed_point(p, friction, cohesion, steps=200):
    """Coulomb's problem by Tresca problems of Clarabel's, of which few are needed from our answer on."""
    law = FrictionLaw(cohesion, friction)
    near = coulomb.solvers.Automatic(1e-10).solve(FrictionProblem(dense_compliance(p.A), p.b, law)).x
    g = cohesion + friction * np.maximum(near[0::3], 0.0)
    for _ in range(steps):
        x = by_clarabel(p.A, p.b, g, np.zeros(p.m))
        wanted = cohesion + friction * np.maximum(x[0::3], 0.0)
        if np.linalg.norm(wanted - g) <= 1e-7 * np.linalg.norm(wanted):
            return x
        g = 0.5 * (g + wanted)
    raise AssertionError("the fixed point does not settle")


@cache
def coulomb_friction(seed, cohesive):
    """A problem, its friction and cohesion, and the answer by Tresca problems."""
    p, rng = held_problem(seed), np.random.default_rng(seed)
    friction, cohesion = rng.uniform(0.1, 0.4, p.m), cohesive * 0.1 * p.force * rng.uniform(0.0, 1.0, p.m)
    return p, friction, cohesion, by_fixed_point(p, friction, cohesion)


COULOMB = {
    "FGMRES": InteriorPoint(tolerance=1e-10),
    "dense": InteriorPoint(tolerance=1e-10, newton=DenseSystem()),
    "paper's preconditioner": InteriorPoint(tolerance=1e-10, newton=SchurComplementSystem(rank=0)),
    "successive Tresca": SuccessiveTresca(tolerance=1e-10),
    "successive Tresca, KPRGP": SuccessiveTresca(tolerance=1e-7, qp_solver=KPRGP()),
    "auto": coulomb.solvers.Automatic(1e-10),
}


@pytest.mark.parametrize("solver", COULOMB.values(), ids=COULOMB)
@pytest.mark.parametrize(("seed", "cohesive"), [(4, False), (5, True)])
def test_coulomb_friction_agrees_with_tresca_problems_of_clarabel(solver, seed, cohesive):
    p, friction, cohesion, theirs = coulomb_friction(seed, cohesive)
    problem = FrictionProblem(dense_compliance(p.A), p.b, FrictionLaw(cohesion, friction))
    result = solver.solve(problem)
    assert result.residual <= solver.tolerance
    assert np.linalg.norm(result.x - theirs) <= 1e-4 * np.linalg.norm(theirs)
    x, known = result.x.reshape(-1, 3), p.kind == PLANE
    assert np.array_equal(problem.known_slip, known)
    slip = p.b.reshape(-1, 3)[known, 1:]
    expected = (cohesion + friction * x[:, 0])[known, None] * slip / np.linalg.norm(slip, axis=1)[:, None]
    assert np.allclose(x[known, 1:], expected, rtol=1e-14, atol=0.0)
    assert np.array_equal(result.slip_bound[known], problem.slip_bound(result.x)[known])


@pytest.mark.parametrize("cohesive", [False, True])
def test_tresca_problems_whose_steps_block_are_solved_from_another_start(cohesive):
    """The last Tresca problems start near their answers, where steps block for some rounding errors of the data."""
    p, friction, cohesion, theirs = coulomb_friction(4, cohesive)
    for seed in range(3):
        noise = 1e-15 * np.random.default_rng(seed).standard_normal((len(p.b) + 1, len(p.b)))
        A, b = p.A * (1.0 + noise[1:] + noise[1:].T), p.b * (1.0 + noise[0])
        problem = FrictionProblem(dense_compliance(A), b, FrictionLaw(cohesion, friction))
        result = SuccessiveTresca(tolerance=1e-10).solve(problem)
        assert np.linalg.norm(result.x - theirs) <= 1e-4 * np.linalg.norm(theirs)


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_held_without_slip(friction):
    """Friction of a plane without slip is 0; with a known slip of 0 the answer satisfies the laws all the same."""
    p = held_problem(6, still=True)
    problem = FrictionProblem.coulomb(dense_compliance(p.A), p.b, np.full(p.m, friction))
    for solver in (InteriorPoint(tolerance=1e-10), SuccessiveTresca(tolerance=1e-10)):
        x = solver.solve(problem).x.reshape(-1, 3)
        assert np.all(x[p.kind == PLANE, 1:] == 0.0)
        for kind, row in ((T1, 1), (T2, 2)):  # zero rows: a cold start leaves them at 0
            assert np.abs(x[p.kind == kind, row]).max() <= 1e-9 * np.abs(x).max()


def test_all_nodes_held_in_their_planes():
    """Friction has no influence on the pressures: they are those without friction, and friction is the law's."""
    rng = np.random.default_rng(7)
    m, e = 12, np.diag(np.tile([1.0, 0.0, 0.0], 12))
    A = e @ (1e-9 * random_spd(3 * m, 1e2, rng)) @ e
    b = 1e-4 * rng.standard_normal(3 * m)
    frictionless = coulomb.solve_coulomb(A, b, 0.0, InteriorPoint(tolerance=1e-12))
    for solver in (InteriorPoint(tolerance=1e-12), SuccessiveTresca(tolerance=1e-12), coulomb.solvers.Automatic(1e-12)):
        x = coulomb.solve_coulomb(A, b, 0.3, solver).x.reshape(-1, 3)
        assert np.allclose(x[:, 0], frictionless.x[0::3], rtol=1e-9, atol=1e-9 * np.abs(x).max())
        slip = b.reshape(-1, 3)[:, 1:]
        assert np.allclose(x[:, 1:], 0.3 * x[:, :1] * slip / np.linalg.norm(slip, axis=1)[:, None], rtol=1e-13)


def test_kprgp_along_a_zero_row():
    """An open node whose slip along t1 is known: the objective is linear in x_t1, which goes to its bound."""
    A, b = np.diag([1.0, 0.0, 2.0]), np.array([-1.0, 1.0, 0.0])
    for sign in (1.0, -1.0):
        x = coulomb.solve_tresca(A, sign * np.array([sign, 1.0, 1.0]) * b, 0.5, solver=KPRGP()).x
        assert x == pytest.approx([0.0, sign * 0.5, 0.0], abs=1e-8)


def test_only_zero_rows_along_tangents_are_accepted():
    rng = np.random.default_rng(8)
    A = random_spd(6, 10.0, rng)
    for row, others in ((3, True), (4, False)):  # a zero normal row; a zero on the diagonal alone
        wrong = A.copy()
        wrong[row, row] = 0.0
        if others:
            wrong[row], wrong[:, row] = 0.0, 0.0
        with pytest.raises(
            ValueError, match="A must be positive semidefinite, but has a diagonal entry that is not positive"
        ):
            coulomb.solve_coulomb(wrong, np.ones(6), 0.3)
