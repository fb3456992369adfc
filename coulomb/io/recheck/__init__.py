"""Recheck of the files of a run from the files alone, without the solver, K and A: `coulomb check`."""

from .history import check

__all__ = ["check"]
