"""Problems with friction of bodies that contact alone holds: w = A x - b - G^T alpha, G x = e."""

import numpy as np
import pytest
from floating_blocks import WEIGHT, FloatingBlock, floating_problem

from coulomb import DenseSystem, FrictionProblem, InteriorPoint, SchurComplementSystem
from coulomb.solvers.rigid_motions import RigidMotions

BLOCK = FloatingBlock()


@pytest.mark.parametrize("newton", [DenseSystem(), SchurComplementSystem()])
@pytest.mark.parametrize("ratio", [0.52, 0.87])
def test_a_block_on_a_plane(ratio, newton):
    """In at most 20 steps, in equilibrium, and alpha closes the contact."""
    problem = floating_problem(BLOCK, ratio)
    result = InteriorPoint(1e-8, newton=newton).solve(problem)
    x, w = result.x.reshape(-1, 3), result.gradient.reshape(-1, 3)
    size = np.abs(problem.b).max()
    assert result.newton_steps <= 20
    assert np.allclose(problem.rigid.G @ result.x, problem.rigid.e, atol=1e-8 * WEIGHT)
    assert np.allclose(problem.gradient(result.x, result.rigid), result.gradient, atol=1e-12 * size)
    pressed = x[:, 0] > 1e-6 * WEIGHT
    assert pressed.sum() >= 3 and np.abs(w[pressed, 0]).max() <= 1e-6 * size


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: RigidMotions(r.G[:, :-1], r.e), r"rigid: G must have shape \(6, 45\).*but has \(6, 44\)"),
        (lambda r: RigidMotions(r.G[:2], r.e), r"rigid: G must have shape \(6, 45\).*but has \(2, 45\)"),
        (
            lambda r: RigidMotions(r.G[:0], r.e[:0]),
            r"rigid: e must have shape \(q,\) with q > 0 motions, but has \(0,\)",
        ),
        (lambda r: RigidMotions(r.G * np.nan, r.e), "rigid: G has entries that are not finite"),
        (lambda r: RigidMotions(r.G, r.e + np.inf), "rigid: e has entries that are not finite"),
        (
            lambda r: RigidMotions(r.G, r.e, ("x", "y")),
            r"rigid: names must be one per motion \(6\), or none, but are 2",
        ),
    ],
)
def test_wrong_motions_are_refused(change, message):
    good = floating_problem(BLOCK, 0.5)
    with pytest.raises(ValueError, match=message):
        FrictionProblem(good.A, good.b, good.law, rigid=change(good.rigid))
