"""Problems with known answers, one per module: physics, formula, computed values, and tolerances with their reasons.

`python -m verification` prints the table; tests/verification asserts its rows.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from . import (
    bolted,
    cattaneo_mindlin,
    curved_pairs,
    error_bars,
    glued,
    hertz,
    hertz_elements,
    hertz_pairs,
    locking,
    nafems_cb1,
    nafems_cb2,
    orthotropic,
    patch,
    patch_pairs,
    press_fit,
    ring_pair,
    roller,
    sliding_block,
    ssnp121,
    ssnv128,
    stack,
    stress_error,
    thermal,
)
from .table import Verified

__all__ = ["CASES", "Verified"]

CASES: dict[str, Callable[[], Verified]] = {
    "patch": patch.verify,
    "patch-pairs": patch_pairs.verify,
    "ssnv128": ssnv128.verify,
    "hertz": hertz.verify,
    "hertz-elements": hertz_elements.verify,
    "roller": roller.verify,
    "cattaneo-mindlin": cattaneo_mindlin.verify,
    "sliding-block": sliding_block.verify,
    "press-fit": press_fit.verify,
    "locking": locking.verify,
    "orthotropic": orthotropic.verify,
    "thermal": thermal.verify,
    "hertz-pairs": hertz_pairs.verify,
    "mindlin-pair": cattaneo_mindlin.verify_pair,
    "ring-pair": ring_pair.verify,
    "glued": glued.verify,
    "bolted": bolted.verify,
    "stack": stack.verify,
    "nafems-cb1": nafems_cb1.verify,
    "nafems-cb2": nafems_cb2.verify,
    "ssnp121": ssnp121.verify,
    "curved-pairs": curved_pairs.verify,
    "error_bars": error_bars.verify,
    "stress_error": stress_error.verify,
}

COARSE: dict[str, Callable[[], Verified]] = {
    "hertz": partial(hertz.verify, (3, 5)),
    "hertz-elements": partial(hertz_elements.verify, (6, 4, 7)),
    "hertz-pairs": partial(hertz_pairs.verify, (6, 4), (1.0,)),
    "mindlin-pair": partial(cattaneo_mindlin.verify_pair, (4, 3), 2),
    "roller": partial(roller.verify, (4, 6)),
    "ring-pair": partial(ring_pair.verify, (2, 4), (2,)),
    "stack": partial(stack.verify, (4,)),
    "nafems-cb1": partial(nafems_cb1.verify, (10, 8)),
    "curved-pairs": partial(curved_pairs.verify, (1,), (12, 16), ("first-order hexahedra", "10-node tetrahedra")),
    "nafems-cb2": partial(nafems_cb2.verify, (4, 5)),
    "error_bars": partial(error_bars.verify, error_bars.few),
    "stress_error": partial(stress_error.verify, stress_error.few),
}
"""Cases on coarser meshes than those of the table, for the tests."""
