"""What exact derivatives of the block's answer cost beside the answer."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from .block import block

SIZES = (10, 16, 24, 32, 46)


class Row(NamedTuple):
    """A row of the table; processor seconds, of the answer from the mesh on.

    Attributes:
        product: Of a product by A, as accurate as any.
        inputs: Number of inputs, each with the derivatives of all forces and displacements,
        forward: and what they take together.
        adjoint: Of one displacement along all fields.
    """

    p: int
    unknowns: int
    contact: int
    method: str
    solve: float
    product: float
    inputs: int
    forward: float
    adjoint: float


def measure(sizes: Iterable[int]) -> Iterator[Row]:
    """Rows as they are measured."""
    for p in sizes:
        clock = [time.process_time()]
        answer = block(p).solve()
        clock.append(time.process_time())
        forces = np.random.default_rng(p).standard_normal(answer.contact_force.size)
        answer.problem.A.mult(forces, np.empty_like(forces))
        clock.append(time.process_time())
        found = answer.sensitivities()
        clock.append(time.process_time())
        corner = np.zeros_like(answer.displacement)
        corner[-1, 2] = 1.0
        answer.gradient(displacement=corner)
        clock.append(time.process_time())
        unknowns, method = answer.problem.unknowns, answer.problem.linear.methods["stiffness"]
        sizes_and_method = unknowns["displacement"], unknowns["contact"], method
        solve, product, forward, adjoint = (after - before for before, after in itertools.pairwise(clock))
        yield Row(p, *sizes_and_method, solve, product, len(found), forward, adjoint)
