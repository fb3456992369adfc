"""coulomb: 3D contact with Coulomb friction, solved by path following.

u = K^-1 (f - B^T x),   A = B K^-1 B^T,   b = B K^-1 f - c
min 1/2 x^T A x - b^T x   subject to   x_n >= 0,  |x_t| <= g,   with g = F x_n at the solution
"""

from .certificate import Certificate, Check, certify
from .contact import Contact
from .fem.body import Material
from .fem.elasticity import Clamp, Elasticity, Spring, Traction
from .fem.meshes import NamedMesh, box, read_gmsh, read_xdmf
from .fem.obstacles import Cylinder, Plane, SignedDistance, Sphere
from .fem.surface import ContactSurface
from .general import solve_coulomb, solve_tresca
from .load_history import LoadHistory, StepFailed
from .load_step import Energy, LoadStep
from .problem import ContactProblem
from .solution import Solution
from .solvers.automatic import Automatic
from .solvers.condensed import CondensedConeSystem, CondensedSystem
from .solvers.cone_systems import DenseConeSystem, KrylovConeSystem
from .solvers.coulomb import CoulombProblem
from .solvers.dense_system import DenseSystem
from .solvers.fixed_point import SuccessiveTresca
from .solvers.kprgp import KPRGP
from .solvers.newton_systems import AugmentedSystem, RecyclingSystem, SchurComplementSystem
from .solvers.one_loop import OneLoop
from .solvers.path_following import PathFollowing
from .solvers.results import CoulombResult, NotConverged, Progress, QPResult, Status
from .solvers.stiffness import DirectSolver, IterativeSolver
from .solvers.tresca import TrescaQP
from .version import __version__

__all__ = [
    "KPRGP",
    "AugmentedSystem",
    "Automatic",
    "Certificate",
    "Check",
    "Clamp",
    "CondensedConeSystem",
    "CondensedSystem",
    "Contact",
    "ContactProblem",
    "ContactSurface",
    "CoulombProblem",
    "CoulombResult",
    "Cylinder",
    "DenseConeSystem",
    "DenseSystem",
    "DirectSolver",
    "Elasticity",
    "Energy",
    "IterativeSolver",
    "KrylovConeSystem",
    "LoadHistory",
    "LoadStep",
    "Material",
    "NamedMesh",
    "NotConverged",
    "OneLoop",
    "PathFollowing",
    "Plane",
    "Progress",
    "QPResult",
    "RecyclingSystem",
    "SchurComplementSystem",
    "SignedDistance",
    "Solution",
    "Sphere",
    "Spring",
    "Status",
    "StepFailed",
    "SuccessiveTresca",
    "Traction",
    "TrescaQP",
    "__version__",
    "box",
    "certify",
    "read_gmsh",
    "read_xdmf",
    "solve_coulomb",
    "solve_tresca",
]
