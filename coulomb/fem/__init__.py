"""Finite elements: meshes, elasticity, contact surfaces.  Uses DOLFINx, but no solver."""
