"""Answers as functions of JAX: its own test of gradients."""

import numpy as np
import pytest

import coulomb

jax = pytest.importorskip("jax")


def pose(friction, young):
    return coulomb.ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (4, 2, 2)),
        coulomb.Material(float(young), 0.3),
        [coulomb.Clamp("left")],
        coulomb.Contact("bottom", friction=float(friction)),
        [coulomb.Traction("top", (0.0, 1e7, -4e7)), coulomb.Traction("right", (2e7, 0.0, 0.0))],
    )


def owed(gradient, friction, young):
    return gradient.friction.sum(), gradient.young[""].sum() / young


def test_gradients_are_those_of_differences():
    from coulomb.jax import solver

    with pytest.raises(ValueError, match="jax_enable_x64"):
        solver(pose, owed, pose(0.3, 2e11))
    jax.config.update("jax_enable_x64", True)
    solve = solver(pose, owed, pose(0.3, 2e11), tolerance=1e-12)

    def energy(friction, young):
        forces, displacements = solve(friction, 1e11 * young)
        return 1e-14 * jax.numpy.sum(forces**2) + 1e6 * jax.numpy.sum(displacements[:, 0] ** 2)

    found = jax.jit(jax.grad(energy, argnums=(0, 1)))(0.3, 2.0)
    for k, h in enumerate((1e-5, 1e-5)):
        more, less = (energy(*(np.array([0.3, 2.0]) + side * h * np.eye(2)[k])) for side in (1.0, -1.0))
        assert float(found[k]) == pytest.approx(float(more - less) / (2.0 * h), rel=1e-5)
