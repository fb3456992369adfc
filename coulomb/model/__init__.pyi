"""The names of the package, with the modules that have them: for type checkers, and read by `lazy_names`."""

from .certificate import Check as Check
from .load_step import LoadStep as LoadStep
from .probes import ProbeValue as ProbeValue
from .resultants import BoltForce as BoltForce
from .resultants import Resultant as Resultant
from .resultants import RigidFaceMotion as RigidFaceMotion
from .state import Energy as Energy
