"""Contact problems of elastic bodies: from bodies and contacts to the solution with its certificate, load steps and
histories.  Here are the types of results; what a user makes is at the top of the package.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_names import lazy_names

if TYPE_CHECKING:
    from .certificate import Check
    from .load_step import Energy, LoadStep
    from .probes import ProbeValue
    from .resultants import Resultant

__all__ = [
    "Check",
    "Energy",
    "LoadStep",
    "ProbeValue",
    "Resultant",
]

if not TYPE_CHECKING:  # type checkers would accept every name
    __getattr__ = lazy_names(
        __name__,
        {
            "certificate": ("Check",),
            "load_step": (
                "Energy",
                "LoadStep",
            ),
            "probes": ("ProbeValue",),
            "resultants": ("Resultant",),
        },
    )
