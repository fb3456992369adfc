"""The answer of a peer; the block, its load history, and its matrices, for peers that cannot use a ContactProblem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse

from coulomb.arrays import FloatArray
from coulomb.model.problem import ContactProblem

LENGTHS = (3.0, 1.0, 1.0)
YOUNG, POISSON, FRICTION = 2.119e11, 0.277, 0.3
TRACTIONS = {"top": (0.0, 1e7, -4e7), "right": (2e7, 0.0, 0.0)}
"""The block of benchmarks.block, metres and pascals; a discrepancy would appear as force_error."""


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


def free_system(problem: ContactProblem) -> tuple[Any, Any, FloatArray, FloatArray]:
    """K, B and f without the clamped displacements (which are 0), and c: gap and zeros, shape (3 m,)."""
    if np.any(problem.elasticity.held.oblique):
        raise ValueError("the other packages take supports along the axes only: others are not rows of K to leave out")
    fixed = problem.elasticity.held.components.ravel()
    free = np.flatnonzero(~fixed)
    c = np.zeros((len(problem.surface.gap), 3))
    c[:, 0] = problem.surface.gap
    K, B = (_csr(matrix, len(fixed)) for matrix in (problem.elasticity.K, problem.surface.B))
    return K[free][:, free], B[:, free], problem.loading.load.ravel()[free], c.ravel()


def _csr(matrix: Any, columns: int) -> Any:
    indptr, indices, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, indices, indptr), shape=(len(indptr) - 1, columns))


STEPS = 24
"""Load steps of a history: the block is pressed in 4, then dragged to and fro in 20; friction by slip increments.
The last is at the time STEPS."""

_PRESSED = ((0.0, 4.0, STEPS), (0.0, 1.0, 1.0))
_DRAGGED = ((0.0, 4.0, 9.0, 19.0, STEPS), (0.0, 0.0, 1.0, -1.0, 0.0))


def pressed(time: float) -> float:
    """Factor of the normal traction on the top at a time."""
    return float(np.interp(time, *_PRESSED))


def dragged(time: float) -> float:
    """Factor of the tractions on the top and on the right that drag the block along the foundation."""
    return float(np.interp(time, *_DRAGGED))


def tractions(time: float) -> dict[str, tuple[float, float, float]]:
    """Tractions in pascals on the faces at a time; 4 steps after the last dragging those of a single run."""
    return {face: (dragged(time) * x, dragged(time) * y, pressed(time) * z) for face, (x, y, z) in TRACTIONS.items()}


def stacked(forces: Sequence[FloatArray]) -> FloatArray:
    """Forces of all steps, each (m, 3), as one array of a row per node, shape (m, 3 steps)."""
    return np.concatenate(forces, axis=1)
