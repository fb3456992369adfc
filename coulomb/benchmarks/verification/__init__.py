"""Problems with known answers, one per module: physics, formula, computed values, and tolerances with their reasons.

`coulomb benchmark verification` prints the table; tests/verification asserts its rows.
"""

from __future__ import annotations

from collections.abc import Callable

from . import (
    cattaneo_mindlin,
    hertz,
    hertz_elements,
    locking,
    orthotropic,
    patch,
    press_fit,
    sliding_block,
    ssnv128,
    thermal,
)
from .table import Verified

__all__ = ["CASES", "Verified"]

CASES: dict[str, Callable[[], Verified]] = {
    "patch": patch.verify,
    "ssnv128": ssnv128.verify,
    "hertz": hertz.verify,
    "hertz-elements": hertz_elements.verify,
    "cattaneo-mindlin": cattaneo_mindlin.verify,
    "sliding-block": sliding_block.verify,
    "press-fit": press_fit.verify,
    "locking": locking.verify,
    "orthotropic": orthotropic.verify,
    "thermal": thermal.verify,
}
"""The cases by name."""
