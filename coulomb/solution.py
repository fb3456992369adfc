"""The answer of a contact problem."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from .arrays import FloatArray
from .small_strain import SmallStrain, small_strain
from .solvers.results import CoulombResult, QPResult

if TYPE_CHECKING:
    from .certificate import Certificate
    from .problem import ContactProblem


@dataclass(frozen=True)
class Solution:
    """Answer of a contact problem.

    Attributes:
        problem: What was solved.
        contact_force: x in newtons, this rank's part, shape (3 m,), node by node (n, t1, t2); x_n >= 0 presses.
        displacement: In metres, this rank's nodes, shape (k, 3).
        slip_bound: The g in newtons that the solver used, shape (m,).
        result: What the solver says of it.
        certificate: What the problem says of it.
    """

    problem: ContactProblem
    contact_force: FloatArray
    displacement: FloatArray
    slip_bound: FloatArray
    result: CoulombResult | QPResult
    certificate: Certificate

    @cached_property
    def small_strain(self) -> SmallStrain:
        """Whether displacements are small enough for the theory; collective."""
        return small_strain(self.problem, self.contact_force, self.displacement)

    def write(self, directory: str) -> None:
        """Fields, history and summary into a directory; what is there is replaced when all is written."""
        from .output import write

        write(self, directory)
