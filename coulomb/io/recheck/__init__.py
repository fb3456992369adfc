"""Recheck of the files of a run, from the files alone: `coulomb check`."""
