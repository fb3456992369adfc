"""Finite elements: meshes, bodies, contact surfaces, in rooms of these names.  Uses DOLFINx, but no solver."""

from ..lazy_names import stubbed

__all__, __getattr__ = stubbed(__name__, __file__)
