"""The files of a run checked again, from themselves alone: `coulomb check`."""
