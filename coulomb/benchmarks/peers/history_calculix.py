"""CalculiX on the load history: a *STEP per load step, otherwise as `calculix`."""

from __future__ import annotations

import time

import numpy as np

from .answer import Answer
from .calculix import grid, preamble
from .ccx import CONTROLS, Job, run
from .history import STEPS, stacked, tractions


def solve(p: int) -> Answer:
    """Iterations are those of the equilibrium; reading and writing the files is counted."""
    began = time.perf_counter()
    x, cells, whole = grid(p)
    contact = np.flatnonzero((x[:, 2] == 0.0) & (x[:, 0] > 0.0))
    ever = np.argwhere(whole != 0.0)  # a load of an earlier step stays until it is replaced
    lines, loads = preamble(x, cells, contact), []
    for number in range(1, STEPS + 1):
        load = grid(p, tractions(float(number)))[2]
        loads.append(load)
        lines += ["*STEP, INC=1000", "*STATIC, DIRECT", "1.,1.", "*CONTROLS, PARAMETERS=FIELD", CONTROLS, "*CLOAD"]
        lines += [f"{node + 1},{axis + 1},{load[node, axis]:.16g}" for node, axis in ever]
        lines += ["*NODE PRINT, NSET=CONTACT", "RF", "*END STEP"]
    job: Job = run(lines, STEPS)
    forces = [values - load[job.nodes] for values, load in zip(job.tables, loads, strict=True)]
    return Answer(time.perf_counter() - began, job.iterations, x[job.nodes], stacked(forces), job.peak_memory_bytes)
