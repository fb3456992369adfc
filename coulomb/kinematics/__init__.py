"""Large motions: Newton's method around the contact problem of small displacements, which is solved as ever at each
deformed place.  Bodies with a nonlinear residual, slip along curved surfaces, load steps; nothing below knows it.
"""

from ..lazy_names import lazily_loaded

__all__, __getattr__ = lazily_loaded(__name__, __file__)
