"""Answers as functions of JAX, which it differentiates by their adjoints (`pip install jax`).

    solve = coulomb.jax.solver(pose, owed, pose(0.3))
    forces, displacements = solve(0.3)
    jax.grad(lambda friction: solve(friction)[0][0::3].max())(0.3)

A call is a solve, in a callback, so that `jax.jit` takes it; the gradient is `Solution.gradient`, one linear system for
all parameters, in place of derivatives through the iterations of the solver (the implicit function theorem at a root:
M. Blondel et al., Efficient and modular implicit differentiation, NeurIPS 35, 2022, section 2).  Forward derivatives
(`jax.jvp`), `jax.vmap` and second ones are not known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .parametric import Owed, ParametricAnswer, Pose


def solver(pose: Pose, owed: Owed, like: Any, tolerance: float = 1e-10) -> Callable[..., tuple[Any, Any]]:
    """The answer of a problem as a function of its parameters, arrays or numbers of JAX.

    Args:
        pose: Poses the `ContactProblem` of parameters, which it is given as arrays of NumPy.
        owed: What a function owes to the parameters, in their order, from its `Gradient` and the parameters: the chain
            rule, as `lambda gradient, friction: [gradient.friction.sum()]` for one coefficient of friction.
        like: A problem with as many nodes and contact points.
        tolerance: Of the solves.

    Returns:
        A function of the parameters with contact forces in newtons, shape (3 m,), and displacements in metres, shape
        (k, 3), as `Solution` has them.

    Raises:
        ImportError: Without JAX.
        ValueError: If JAX has no double precision, or on several ranks; and as `Solution.gradient`, in the function.
    """
    import jax

    if not jax.config.jax_enable_x64:
        raise ValueError('answers are in double precision: call jax.config.update("jax_enable_x64", True) before')
    answer = ParametricAnswer(pose, owed, like, tolerance)
    answer.refuse_ranks("JAX")

    def forward(*parameters: Any) -> tuple[Any, Any]:
        solution = answer.at([np.asarray(parameter) for parameter in parameters])
        return solution.contact_force, solution.displacement

    def backward(parameters: Sequence[Any], of_force: Any, of_displacement: Any) -> tuple[Any, ...]:
        given = [np.asarray(parameter) for parameter in parameters]
        return tuple(answer.owed(given, np.asarray(of_force), np.asarray(of_displacement)))

    def shaped(shape: tuple[int, ...]) -> Any:
        return jax.ShapeDtypeStruct(shape, np.float64)

    shapes = shaped((answer.forces,)), shaped((answer.nodes, 3))

    solve: Any = jax.custom_vjp(lambda *parameters: jax.pure_callback(forward, shapes, *parameters))

    def with_parameters(*parameters: Any) -> tuple[Any, tuple[Any, ...]]:
        given = tuple(jax.numpy.asarray(parameter, dtype=np.float64) for parameter in parameters)
        return solve(*given), given

    def pulled_back(parameters: tuple[Any, ...], cotangents: tuple[Any, Any]) -> Any:
        return jax.pure_callback(backward, tuple(shaped(one.shape) for one in parameters), parameters, *cotangents)

    solve.defvjp(with_parameters, pulled_back)
    return solve
