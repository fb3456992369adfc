"""The finite-element room: meshes, elasticity, contact surfaces.  Knows DOLFINx, and no solver."""
