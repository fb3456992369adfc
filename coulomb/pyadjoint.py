"""Answers on the tape of pyadjoint, for dolfinx-adjoint (`pip install dolfinx-adjoint`) or for numbers alone
(`pip install pyadjoint-ad`).

    solve = coulomb.pyadjoint.solver(pose, owed, pose(0.3))
    friction = pyadjoint.AdjFloat(0.3)
    J = dolfinx_adjoint.assemble_scalar(ufl.inner(solve(friction), n) * ds)
    pyadjoint.ReducedFunctional(J, pyadjoint.Control(friction)).derivative()

A call is a solve, a block of the tape (S. K. Mitusch, S. W. Funke, J. S. Dokken: dolfin-adjoint 2018.1, Journal of Open
Source Software 4(38), 2019); the gradient is `Solution.gradient`, one linear system for all parameters, on any number
of ranks.
Tangent linear models and second derivatives are not known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .arrays import FloatArray
from .parametric import Owed, ParametricAnswer, Pose

Measure = Callable[[Any], tuple[float, FloatArray | None, FloatArray | None]]
"""A number of a `Solution`, the same on all ranks, with its derivatives along this rank's contact forces, shape (3 m,),
and displacements, shape (k, 3), as `Solution.gradient` takes them."""


def solver(
    pose: Pose, owed: Owed, like: Any, measure: Measure | None = None, tolerance: float = 1e-10
) -> Callable[..., Any]:
    """The answer of a problem as a function of its parameters: an `AdjFloat` or number each, or a Function of
    dolfinx-adjoint.

    Args:
        pose: Poses the `ContactProblem` of parameters, which it is given as numbers and Functions.
        owed: What a function owes to the parameters, in their order, from its `Gradient` and the parameters: the chain
            rule, as `lambda gradient, friction: [gradient.friction.sum()]` for one coefficient of friction.  This
            rank's part, which is summed for numbers; of a Function an entry for each value that this rank owns.
        like: A problem with as many nodes and contact points.
        measure: The number of the answer that is the result; by default this is the displacement of the only body.
        tolerance: Of the solves.

    Returns:
        A function of the parameters with an `AdjFloat`, or with the displacement in metres as a Function of
        dolfinx-adjoint in the space of the body of `like`.

    Raises:
        ImportError: Without pyadjoint, or without dolfinx-adjoint where it is needed.
        ValueError: Without `measure`, if there are several bodies; and as `Solution.gradient`, in derivatives.
    """
    import pyadjoint

    answer, comm = ParametricAnswer(pose, owed, like, tolerance), like.comm
    body = like.elasticity.alone if measure is None else None

    def result(parameters: Sequence[Any]) -> Any:
        solution = answer.at(parameters)
        if measure is not None:
            return pyadjoint.AdjFloat(measure(solution)[0])
        import dolfinx_adjoint

        assert body is not None
        function = dolfinx_adjoint.Function(body.V, name="displacement")
        function.x.array[:] = body.function(solution.displacement).x.array
        return function

    def dual(parameter: Any, value: FloatArray) -> Any:
        if not hasattr(parameter, "function_space"):
            return float(comm.allreduce(float(value)))
        from dolfinx_adjoint.blocks.function_assigner import create_function_with_special_vector

        vector = create_function_with_special_vector(parameter).x
        vector.array[: value.size] = value
        vector.scatter_forward()
        return vector

    class ContactBlock(pyadjoint.Block):  # type: ignore[misc]
        def prepare_evaluate_adj(self, inputs: Any, adj_inputs: Any, relevant_dependencies: Any) -> list[FloatArray]:
            if measure is None:
                owned = np.array(adj_inputs[0].array[: 3 * answer.nodes])
                return answer.owed(inputs, None, owned.reshape(-1, 3))
            along = (None if of is None else adj_inputs[0] * of for of in measure(answer.at(inputs))[1:])
            return answer.owed(inputs, *along)

        def evaluate_adj_component(
            self, inputs: Any, adj_inputs: Any, block_variable: Any, idx: int, prepared: Any = None
        ) -> Any:
            return dual(inputs[idx], prepared[idx])

        def recompute_component(self, inputs: Any, block_variable: Any, idx: int, prepared: Any) -> Any:
            return result(inputs)

    def solve(*parameters: Any) -> Any:
        given = [one if hasattr(one, "block_variable") else pyadjoint.AdjFloat(one) for one in parameters]
        with pyadjoint.stop_annotating():
            output = result(given)
        if pyadjoint.annotate_tape():
            block = ContactBlock()
            for one in given:
                block.add_dependency(one)
            pyadjoint.get_working_tape().add_block(block)
            block.add_output(output.block_variable)
        return output

    return solve
