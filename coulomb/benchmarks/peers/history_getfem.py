"""GetFEM on the load history: Newton's method from the state after the step before, friction by slip increments.

The basic contact brick of `getfem_newton` takes friction against B_T (u + gamma wt): with gamma = 1 and wt minus the
displacement after the step before, that is the slip since then.  K is assembled once; every Newton step factorises the
tangent matrix.
"""

from __future__ import annotations

import time

from ...arrays import FloatArray
from .answer import Answer, Unsolved
from .getfem_newton import forces_of, model_of, solved
from .history import STEPS, stacked, tractions


def solve(p: int) -> Answer:
    """Iterations are Newton's."""
    began = time.perf_counter()
    model, x, _kept = model_of(p, incremental=True)
    forces: list[FloatArray] = []
    first, iterations = 0.0, 0
    for number in range(1, STEPS + 1):
        steps, converged = solved(model, tractions(float(number)))
        if not converged:
            raise Unsolved(f"load step {number} not converged in {steps} steps")
        forces.append(forces_of(model))
        iterations += int(steps)
        model.set_variable("before", -model.variable("u"))
        first = first or time.perf_counter() - began
    return Answer(time.perf_counter() - began, iterations, x, stacked(forces), first_seconds=first)
