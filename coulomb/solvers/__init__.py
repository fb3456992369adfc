"""Solvers of contact problems given by A, b and the law of friction.  Use numpy and petsc4py, but not DOLFINx."""
