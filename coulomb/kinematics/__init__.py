"""Large motions: the names of bodies, materials and problems, which are in the rooms of those of small strains."""

from ..lazy_names import lazily_loaded

__all__, __getattr__ = lazily_loaded(__name__, __file__)
