"""Three methods for the compliance A on one rank: Schur complement, many right-hand sides, matrix-free."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from ..linalg.compliance import Compliance, DirectSolver, SchurCompliance
from .block import block
from .by_columns import compliance_by_columns


class Row(NamedTuple):
    """Seconds of factorisation and A by each method, of one product, and the relative difference of the two A."""

    p: int
    contact: int
    schur: float
    right_hand_sides: float
    product_explicit: float
    product_matrix_free: float
    difference: float


def measure(p: int) -> Row:
    """Measure the block with p cells per metre."""
    schur, many, free = block(p, explicit=True), block(p, explicit=True), block(p, explicit=False)
    began = time.perf_counter()
    A = schur.A
    schur_seconds = time.perf_counter() - began
    assert isinstance(A, SchurCompliance)

    began = time.perf_counter()
    b = compliance_by_columns(many.surface.free_B, DirectSolver(many.elasticity.K))
    many_seconds = time.perf_counter() - began
    a = A.dense()
    difference = float(np.abs(a - b).max() / np.abs(b).max())

    def product(A: Compliance) -> float:
        x, y = np.ones(3 * A.nodes), np.empty(3 * A.nodes)
        A.mult(x, y)
        began = time.perf_counter()
        for _ in range(10):
            A.mult(x, y)
        return (time.perf_counter() - began) / 10

    contact = schur.unknowns["contact"]
    return Row(p, contact, schur_seconds, many_seconds, product(A), product(free.A), difference)
