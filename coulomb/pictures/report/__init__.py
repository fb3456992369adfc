"""Pictures and the report of a run, from its files alone, by a process without DOLFINx (`drawing_process`)."""
