"""Coulomb's law for an explicit matrix A, as rigid bodies have it: Gauss-Seidel, an interior point of second-order
cones and regularised Newton steps.  The door is `solve_coulomb`.
"""

from .cone_interior_point import ConeInteriorPoint
from .cones import cone_residual
from .matrix_problems import MatrixAutomatic, solve_coulomb, solve_tresca
from .regularised_newton import RegularisedNewton
