"""Pictures and the report of a run, from its files alone.  Knows neither DOLFINx nor the solvers (see `apart`)."""
