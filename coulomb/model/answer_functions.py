"""Fields of an answer as Functions of DOLFINx, and what functionals of them owe to the answer, by UFL's derivative."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Member, compiled
from ..fem.compat import ufl
from ..linalg.reductions import Reductions
from .discrete_problem import DiscreteProblem
from .nodal_answer import HELD, NodalAnswer

Fields = Mapping[str, Mapping[str, FloatArray]]
"""By the names of bodies and fields, the fields of contact at this rank's nodes, shapes (k,) or (k, 3)."""


class AnswerFunctions:
    """Displacement and fields of contact as Functions, one object for each, made when first asked for.

    Args:
        u: The displacement, metres, shape (k, 3).
        fields: Gives the fields of contact; collective.
    """

    def __init__(self, problem: DiscreteProblem, u: FloatArray, fields: Callable[[], Fields]):
        self._problem, self._u, self._asked = problem, u, fields
        self._made = dict[tuple[str, str], Any]()

    @cached_property
    def of_bodies(self) -> dict[str, Any]:
        """The displacement of each body by the body's name, which gives its fields of contact by name; collective."""
        return {
            member.name: member.body.function(self._u[member.nodes], fields=partial(self._field, member))
            for member in self._problem.elasticity.members
        }

    @cached_property
    def _fields(self) -> Fields:
        return self._asked()

    def _field(self, member: Member, name: str) -> Any:
        """ValueError if there is none of this name; collective."""
        if name == "displacement":
            return self.of_bodies[member.name]
        if (member.name, name) not in self._made:
            fields = self._fields.get(member.name, {})
            if name not in fields:
                there = ", ".join(("displacement", *fields)) if fields else "displacement; no contact is on this body"
                raise ValueError(f"there is no field {name!r}; there are {there}")
            values, body = fields[name], member.body
            made = body.scalar(values, name) if values.ndim == 1 else body.function(values, name)
            self._made[member.name, name] = made
        return self._made[member.name, name]

    def owed_by(self, functional: Any, answer: NodalAnswer) -> tuple[FloatArray, FloatArray]:
        """What a functional owes to contact forces, per newton, shape (3 m,), and to displacements, per metre, shape
        (k, 3), where the mesh stays; collective.

        Args:
            functional: A form of UFL without arguments, of displacements, pressures and tractions.
            at: The answer at the contact points.

        Raises:
            ValueError: On every rank, if it is no such form, or of pressures elsewhere than at contact points of the
                face itself, or in large motions, where areas change.
        """
        of_x, of_u = np.zeros_like(answer.force), np.zeros_like(self._u)
        if not isinstance(functional, ufl.Form) or functional.arguments():
            raise ValueError("functional must be a form of UFL without arguments, as inner(u, u) * dx")
        coefficients, of_displacement = functional.coefficients(), False
        for member in self._problem.elasticity.members:
            names = ["displacement", *(name for body, name in self._made if body == member.name)]
            for name in names:
                function = self._field(member, name)
                if not any(coefficient is function for coefficient in coefficients):
                    continue
                if name not in ("displacement", "pressure", "traction"):
                    raise ValueError(
                        f"functional: derivatives along the field {name!r} are not known, but along the displacement, "
                        "pressure and traction"
                    )
                of_displacement, way = True, ufl.TestFunction(member.body.V)
                derivative = ufl.derivative(functional, function, way[0] if name == "pressure" else way)
                owed = compiled(derivative, "functional", answer.comm).vector()
                if name == "displacement":
                    of_u[member.nodes] += owed
                else:
                    of_x += self._of_points(member, name, owed, answer)
        if not of_displacement:
            raise ValueError("functional: there is no function of this answer in it, such as solution.function")
        return of_x.ravel(), of_u

    def _of_points(self, member: Member, name: str, owed: FloatArray, answer: NodalAnswer) -> FloatArray:
        """What is owed to the forces of contact points, shape (m, 3), from what is owed to pressures, in the first
        column, or tractions at the nodes of a body, shape (k, 3); collective."""
        surface, over = self._problem.surface, Reductions(answer.comm)
        if self._problem.body.undeformed is not None:
            raise ValueError(f"functional: in large motions areas change, and derivatives along {name} are not known")
        node, values = surface.nodes - member.nodes.start, self._fields[member.name][name]
        whole = answer.pressure if name == "pressure" else answer.on_body / answer.area[:, None]
        mine = np.flatnonzero((node >= 0) & (node < len(owed)))
        same = values[node[mine]] == whole[mine]
        mine = mine[same if same.ndim == 1 else np.all(same, axis=1)]
        _, first = np.unique(node[mine], return_index=True)
        mine = mine[first]  # of a node in several contacts
        known = self._fields[member.name]["status"] == HELD  # where all fields are 0
        known[node[mine]] = True
        if over.any(bool(np.any(owed[~known]))):
            raise ValueError(
                f"functional: {name} is wanted where no contact point of the body's own faces is: on the face opposite "
                "in a pair, or between the vertices of 10-node tetrahedra: give the derivatives along contact forces "
                "(contact_force)"
            )
        owed_forces = np.zeros_like(answer.force)
        if name == "pressure":
            owed_forces[mine, 0] = owed[node[mine], 0]
        else:
            owed_forces[mine] = -np.einsum("kij,kj->ki", answer.frames[mine], owed[node[mine]])
        return owed_forces / answer.area[:, None]
