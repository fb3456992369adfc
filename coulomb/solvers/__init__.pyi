"""The names of the package, with the modules that have them: for type checkers, and read by `lazy_names`."""

from ..linalg.compliance import DirectSolver as DirectSolver
from ..linalg.compliance import IterativeSolver as IterativeSolver
from .automatic import Automatic as Automatic
from .condensed import CondensedSystem as CondensedSystem
from .friction_problem import FrictionProblem as FrictionProblem
from .kprgp import KPRGP as KPRGP
from .laws import FrictionLaw as FrictionLaw
from .newton_systems import AugmentedSystem as AugmentedSystem
from .newton_systems import DenseSystem as DenseSystem
from .newton_systems import SchurComplementSystem as SchurComplementSystem
from .results import Progress as Progress
from .results import SolverResult as SolverResult
from .rigid import ConeInteriorPoint as ConeInteriorPoint
from .rigid import MatrixAutomatic as MatrixAutomatic
from .rigid import RegularisedNewton as RegularisedNewton
from .rigid_motions import RigidMotions as RigidMotions
