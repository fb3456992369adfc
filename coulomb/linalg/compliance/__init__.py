"""The Delassus operator A = B K^-1 B^T by factors, multigrid or as a dense matrix, and the Krylov methods, borders and
low-rank corrections of systems with it.
"""

from .border import ConstraintPreconditioner, Constraints, NodalMap
from .compliance import BodyCompliance, Compliance, Formed, MatrixCompliance, MatrixFreeCompliance
from .diagonal_estimate import estimated_diagonal
from .kept_responses import KeptResponses
from .krylov import CarryingKrylov
from .learnt_columns import LearntColumns
from .low_rank import REPLACED, LowRankApproximation, LowRankUpdate
from .methods import EXPLICIT_UP_TO, PREDICTED_UP_TO, LinearSolver, chosen, undecided
from .predicted_cost import Measures, Precision, factorise, fits, patience, seconds_direct, seconds_multigrid
from .schur_compliance import SchurCompliance
from .soft_motions import SoftMotions
from .stiffness import DirectSolver, IterativeSolver, StiffnessSolver

__all__ = [
    "EXPLICIT_UP_TO",
    "PREDICTED_UP_TO",
    "REPLACED",
    "BodyCompliance",
    "CarryingKrylov",
    "Compliance",
    "ConstraintPreconditioner",
    "Constraints",
    "DirectSolver",
    "Formed",
    "IterativeSolver",
    "KeptResponses",
    "LearntColumns",
    "LinearSolver",
    "LowRankApproximation",
    "LowRankUpdate",
    "MatrixCompliance",
    "MatrixFreeCompliance",
    "Measures",
    "NodalMap",
    "Precision",
    "SchurCompliance",
    "SoftMotions",
    "StiffnessSolver",
    "chosen",
    "estimated_diagonal",
    "factorise",
    "fits",
    "patience",
    "seconds_direct",
    "seconds_multigrid",
    "undecided",
]
