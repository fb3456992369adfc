"""Solvers of problems with friction, |x_t| <= c + F x_n: their methods, Newton systems, the law and the results.  Uses
`linalg`, knows A, b and the law, no meshes.
"""

from ..lazy_names import lazily_loaded

__all__, __getattr__ = lazily_loaded(__name__, __file__)
