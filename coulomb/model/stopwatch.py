"""Wall time by phases."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def timed(seconds: dict[str, float], phase: str) -> Iterator[None]:
    """Add the wall time of the block to a phase, without that of phases inside the block."""
    began, others = time.perf_counter(), sum(seconds.values())
    try:
        yield
    finally:
        others = sum(seconds.values()) - others
        seconds[phase] = seconds.get(phase, 0.0) + time.perf_counter() - began - others
