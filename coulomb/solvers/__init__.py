"""Solvers of problems with friction, |x_t| <= c + F x_n: their methods, Newton systems, the law and the results.  Uses
`linalg`, knows A, b and the law, no meshes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_names import lazy_names

if TYPE_CHECKING:
    from ..linalg.compliance import DirectSolver, IterativeSolver
    from .automatic import Automatic
    from .condensed import CondensedSystem
    from .dense_system import DenseSystem
    from .friction_problem import FrictionProblem
    from .kprgp import KPRGP
    from .laws import FrictionLaw
    from .newton_systems import AugmentedSystem, SchurComplementSystem
    from .results import Progress, SolverResult
    from .rigid import ConeInteriorPoint, MatrixAutomatic, RegularisedNewton
    from .rigid_motions import RigidMotions

__all__ = [
    "KPRGP",
    "AugmentedSystem",
    "Automatic",
    "CondensedSystem",
    "ConeInteriorPoint",
    "DenseSystem",
    "DirectSolver",
    "FrictionLaw",
    "FrictionProblem",
    "IterativeSolver",
    "MatrixAutomatic",
    "Progress",
    "RegularisedNewton",
    "RigidMotions",
    "SchurComplementSystem",
    "SolverResult",
]

if not TYPE_CHECKING:  # type checkers would accept every name
    __getattr__ = lazy_names(
        __name__,
        {
            "kprgp": ("KPRGP",),
            "newton_systems": (
                "AugmentedSystem",
                "SchurComplementSystem",
            ),
            "automatic": ("Automatic",),
            "condensed": ("CondensedSystem",),
            "rigid": (
                "ConeInteriorPoint",
                "MatrixAutomatic",
                "RegularisedNewton",
            ),
            "dense_system": ("DenseSystem",),
            ".linalg.compliance": (
                "DirectSolver",
                "IterativeSolver",
            ),
            "laws": ("FrictionLaw",),
            "friction_problem": ("FrictionProblem",),
            "results": (
                "Progress",
                "SolverResult",
            ),
            "rigid_motions": ("RigidMotions",),
        },
    )
