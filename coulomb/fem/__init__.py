"""Finite elements: meshes, bodies, contact surfaces, in rooms of these names.  Uses DOLFINx, but no solver."""

from ..lazy_names import lazily_loaded

__all__, __getattr__ = lazily_loaded(__name__, __file__)
