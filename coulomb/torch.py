"""Answers as functions of PyTorch, which it differentiates by their adjoints (`pip install torch`).

    solve = coulomb.torch.solver(pose, owed, pose(0.3))
    friction = torch.tensor(0.3, requires_grad=True)
    forces, displacements = solve(friction)
    forces[0::3].max().backward()  # friction.grad

A call is a solve, the gradient is `Solution.gradient`, one linear system for all parameters, in place of derivatives
through the iterations of the solver (the implicit function theorem at a root: M. Blondel et al., Efficient and modular
implicit differentiation, NeurIPS 35, 2022, section 2).  Forward and second derivatives are not
known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .parametric import Owed, ParametricAnswer, Pose


def solver(pose: Pose, owed: Owed, like: Any, tolerance: float = 1e-10) -> Callable[..., tuple[Any, Any]]:
    """The answer of a problem as a function of its parameters, tensors of PyTorch or numbers.

    Args:
        pose: Poses the `ContactProblem` of parameters, which it is given as arrays of NumPy.
        owed: What a function owes to the parameters, in their order, from its `Gradient` and the parameters: the chain
            rule, as `lambda gradient, friction: [gradient.friction.sum()]` for one coefficient of friction.
        like: A problem with as many nodes and contact points.
        tolerance: Of the solves.

    Returns:
        A function of the parameters with contact forces in newtons, shape (3 m,), and displacements in metres, shape
        (k, 3), as `Solution` has them, in double precision on the CPU.

    Raises:
        ImportError: Without PyTorch.
        ValueError: On several ranks; and as `Solution.gradient`, in the backward call.
    """
    import torch

    answer = ParametricAnswer(pose, owed, like, tolerance)
    answer.refuse_ranks("PyTorch")

    class Answer(torch.autograd.Function):  # type: ignore[misc]
        @staticmethod
        def forward(ctx: Any, *parameters: Any) -> tuple[Any, Any]:
            ctx.save_for_backward(*parameters)
            solution = answer.at([parameter.detach().numpy() for parameter in parameters])
            return torch.from_numpy(solution.contact_force.copy()), torch.from_numpy(solution.displacement.copy())

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, *of: Any) -> tuple[Any, ...]:
            parameters = [tensor.detach().numpy() for tensor in ctx.saved_tensors]
            return tuple(map(torch.from_numpy, answer.owed(parameters, *(one.numpy() for one in of))))

    def solve(*parameters: Any) -> tuple[Any, Any]:
        given = (torch.as_tensor(parameter, dtype=torch.float64, device="cpu") for parameter in parameters)
        return Answer.apply(*given)

    return solve
