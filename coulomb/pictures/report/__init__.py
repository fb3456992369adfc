"""Pictures and the report of a run, from its files alone; imports neither DOLFINx nor the solvers (see `apart`)."""
