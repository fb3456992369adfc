"""Speed of this machine relative to the one on which `estimate` was fitted, measured in 0.1 s."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from threadpoolctl import threadpool_limits

_DENSE, _MEMORY, _PYTHON = 0.0091, 0.0212, 0.0031  # seconds of the three measures on one core of the reference machine


@dataclass(frozen=True)
class Slowness:
    """Ratios of run times here to those of the reference machine.

    Attributes:
        dense: Matrix products (LAPACK, BLAS): factorisations.
        memory: Scattered reading of memory: sparse products, multigrid.
        python: The interpreter: start, output, small problems.
    """

    dense: float = 1.0
    memory: float = 1.0
    python: float = 1.0


SAME = Slowness()


def measure(comm: MPI.Comm) -> Slowness:
    """Of the slowest rank, all ranks at once, by wall time, so that other load on the machine counts; collective."""
    random = np.random.default_rng(3)
    A = random.standard_normal((600, 600))
    x, places = random.standard_normal(2_000_000), random.integers(0, 2_000_000, 2_000_000)

    def loop() -> None:
        total = 0.0
        for k in range(100_000):
            total += k * 0.5

    with threadpool_limits(limits=1):
        taken = [_least(work) for work in (lambda: A @ A, lambda: x[places], loop)]
    slowest: list[float] = np.max(comm.allgather(taken), axis=0).tolist()
    return Slowness(*(here / there for here, there in zip(slowest, (_DENSE, _MEMORY, _PYTHON), strict=True)))


def _least(work: Callable[[], object]) -> float:
    """Smallest wall time of three runs, seconds."""
    times = []
    for _ in range(3):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)
