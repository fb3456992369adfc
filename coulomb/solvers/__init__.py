"""Solvers of problems with friction, |x_t| <= c + F x_n: their methods, Newton systems, the law and the results.  Uses
`linalg`, knows A, b and the law, no meshes.
"""

from ..lazy_names import stubbed

__all__, __getattr__ = stubbed(__name__, __file__)
