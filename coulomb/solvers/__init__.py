"""The algebra room: contact problems as quadratic programmes.  Knows numpy and petsc4py, and no DOLFINx."""
