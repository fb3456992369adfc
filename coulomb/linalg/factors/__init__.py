"""Cholesky factors of K by nested dissection and multifrontal elimination, on one rank, for all of them, refined to
double precision.
"""

from .first_rank import FirstRankSolver
from .frontal_factors import NotPositiveDefinite
from .multifrontal import (
    SINGLE_FROM,
    MultifrontalSolver,
    Work,
    inverse_factor,
    inverse_of,
    predicted_work,
    symbolic,
    usual_work,
)
from .nested_dissection import Front
