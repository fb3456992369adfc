"""Cholesky factors of K by nested dissection and multifrontal elimination, on one rank and several, refined to double
precision.
"""

from .distributed_multifrontal import DistributedMultifrontalSolver, SharedSymbolic
from .frontal_factors import NotPositiveDefinite
from .multifrontal import SINGLE_FROM, MultifrontalSolver, Work, inverse_factor, predicted_work, symbolic
from .nested_dissection import Front
