"""The Delassus operator A = B K^-1 B^T by factors, multigrid or as a dense matrix, and the Krylov methods, borders and
low-rank corrections of systems with it.
"""

from ..multigrid import stiffness_in_blocks
from .compliance import BodyCompliance, Compliance, Formed, MatrixFreeCompliance, estimated_diagonal
from .coupled import CoupledKrylov, Elimination
from .krylov import CarryingKrylov, ConstraintPreconditioner, Constraints, NodalMap
from .low_rank import REPLACED, LinearResponseCache, LowRankApproximation, LowRankUpdate, RecycledColumns
from .matrix_compliance import MatrixCompliance
from .predicted_cost import (
    EXPLICIT_UP_TO,
    LEAST,
    PREDICTED_UP_TO,
    LinearSolver,
    chosen,
    fits,
    patience,
    undecided,
    worth,
)
from .schur_compliance import SchurCompliance
from .stiffness import DirectSolver, IterativeSolver, SoftMotions, StiffnessSolver
