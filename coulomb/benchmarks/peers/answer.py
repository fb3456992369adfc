"""The answer of a peer, and the data of the block for peers that cannot use a ContactProblem."""

from __future__ import annotations

from typing import NamedTuple

from ...arrays import FloatArray
from ...model.problem import ContactProblem

LENGTHS = (3.0, 1.0, 1.0)
YOUNG, POISSON, FRICTION = 2.119e11, 0.277, 0.3
TRACTIONS = {"top": (0.0, 1e7, -4e7), "right": (2e7, 0.0, 0.0)}
"""The block of coulomb.benchmarks.block, metres and pascals; a discrepancy would appear as force_error."""


class Figures(NamedTuple):
    """A few figures of an answer of the two blocks.

    Attributes:
        normal_force: Between the blocks, in newtons.
        tangential_force: Size of the sum of the friction forces, in newtons.
        largest_slip: Largest tangential displacement of a node of the upper block's lower face over the face under it,
            in metres, where it is open too.
        displacement: Size of the mean displacement of the nodes of the upper block, in metres.
    """

    normal_force: float
    tangential_force: float
    largest_slip: float
    displacement: float


class Answer(NamedTuple):
    """The answer of one peer.

    Attributes:
        seconds: From the description of the problem to the contact forces, without imports and warm-up.
        iterations: Iterations of its outer loop (of Newton's method if there is none).
        points: Contact nodes in metres, shape (m, 3), in any order.
        forces: On the body at these nodes in newtons, shape (m, 3).
        peak_memory_bytes: Peak memory of a child process that does the work; 0 if this process does it.
        figures: Others that the packages are compared by; those of the two blocks.
        first_seconds: Of a load history, until the end of its first step; 0 if that is not known.
        products: Products by A, of coulomb on a load history.
    """

    seconds: float
    iterations: int
    points: FloatArray
    forces: FloatArray
    peak_memory_bytes: int = 0
    figures: Figures | None = None
    first_seconds: float = 0.0
    products: int = 0


class Unsolved(Exception):
    """A peer gave no answer; the message has the reason."""


def on_body(problem: ContactProblem, x: FloatArray) -> FloatArray:
    """Forces on the body in newtons, shape (m, 3), of contact forces x (n, t1, t2), shape (3 m,)."""
    return -problem.surface.vectors(x.reshape(-1, 3))
