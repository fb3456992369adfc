"""The answer of a problem as a function of parameters, with its adjoint: what `coulomb.jax`, `coulomb.torch` and
`coulomb.pyadjoint` give to their frameworks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .arrays import FloatArray

Pose = Callable[..., Any]
"""Poses the `ContactProblem` of parameters."""

Owed = Callable[..., Sequence[Any]]
"""What a function owes to the parameters, in their order, from its `Gradient` and the parameters: the chain rule."""


class ParametricAnswer:
    """Answers of the problems of parameters; the last one is kept, for its adjoint.

    Attributes:
        like: A problem with as many nodes and contact points as those of all parameters.
        forces: Number of entries of the contact forces of this rank, 3 m.
        nodes: Number of its nodes, k.
    """

    def __init__(self, pose: Pose, owed: Owed, like: Any, tolerance: float):
        self._pose, self._owed, self.like, self._tolerance = pose, owed, like, tolerance
        self.forces, self.nodes = 3 * len(like.surface.nodes), len(like.elasticity.x)
        self._latest: tuple[list[FloatArray], Any] | None = None

    def refuse_ranks(self, framework: str) -> None:
        """ValueError on several ranks, the same on all of them."""
        if self.like.comm.size > 1:
            raise ValueError(
                f"answers as functions of {framework} are for one rank, but there are {self.like.comm.size}"
            )

    def at(self, parameters: Sequence[Any]) -> Any:
        """The `Solution` at parameters: arrays, numbers, or Functions of DOLFINx; collective.

        Raises:
            ValueError: On every rank, if the problem has other nodes or contact points than `like`; and as `pose`.
            NotConverged: As `ContactProblem.solve`.
        """
        values, over = [np.array(values_of(parameter)) for parameter in parameters], self.like.comm
        known = self._latest is not None and all(map(np.array_equal, values, self._latest[0]))
        if over.allreduce(int(not known)):
            solution = self._pose(*parameters).solve(self._tolerance)
            shape = solution.contact_force.size, len(solution.displacement)
            if over.allreduce(int(shape != (self.forces, self.nodes))):
                raise ValueError(
                    f"the problem of the parameters has {shape[0] // 3} contact points and {shape[1]} nodes on this "
                    f"rank, `like` has {self.forces // 3} and {self.nodes}: parameters may not change the mesh or faces"
                )
            self._latest = values, solution
        assert self._latest is not None
        return self._latest[1]

    def owed(self, parameters: Sequence[Any], of_force: Any, of_displacement: Any) -> list[FloatArray]:
        """What a function owes to parameters by this rank's part of the answer, of their shapes; collective.

        Args:
            parameters: As of `at`.
            of_force: Its derivatives along contact forces, per newton, shape (3 m,); None is 0.
            of_displacement: And along displacements, per metre, shape (k, 3); None is 0.

        Raises:
            ValueError: If the user's chain rule gives no number for every entry of the parameters; as
                `Solution.gradient`.
        """
        gradient = self.at(parameters).gradient(of_force, of_displacement)
        gradients = [np.asarray(one, dtype=np.float64) for one in self._owed(gradient, *parameters)]
        shapes = [values_of(parameter).shape for parameter in parameters]
        if [one.size for one in gradients] != [int(np.prod(shape)) for shape in shapes]:
            raise ValueError(
                f"owed: there must be derivatives of shapes {shapes}, those of the parameters, but they have "
                f"{[one.shape for one in gradients]}"
            )
        return [one.reshape(shape) for one, shape in zip(gradients, shapes, strict=True)]


def values_of(parameter: Any) -> FloatArray:
    """Of a number or an array; of a Function of DOLFINx those that this rank owns."""
    if not hasattr(parameter, "function_space"):
        return np.asarray(parameter, dtype=np.float64)
    dofs = parameter.function_space.dofmap
    return parameter.x.array[: dofs.index_map.size_local * dofs.index_map_bs]
