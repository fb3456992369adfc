"""coulomb: 3D contact with Coulomb friction, solved by an interior-point method.

u = K^-1 (f - B^T x),   A = B K^-1 B^T,   b = B K^-1 f - c
min 1/2 x^T A x - b^T x   subject to   x_n >= 0,  |x_t| <= g,   with g = F x_n at the solution
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from .lazy_names import lazy_names
from .model import solution_writer
from .version import __version__

# Read when the library of OpenMP is loaded.  Threads that wait in busy loops, its default, make products of multigrid
# ten times as slow where other programs need the processors too.  With GNU's library they look a thousand times, for
# some microseconds, before they sleep: to be woken takes longer than many products do.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("GOMP_SPINCOUNT", "1000")

if TYPE_CHECKING:
    from .fem.bodies import (
        Body,
        Clamp,
        Elasticity,
        Material,
        OrthotropicMaterial,
        PrescribedDisplacement,
        PrescribedRotation,
        Pressure,
        Spring,
        SymmetryPlane,
        ThermalLoad,
        TotalForce,
        Traction,
        join,
    )
    from .fem.geometry import Cylinder, Plane, Rotation, SignedDistance, Sphere
    from .fem.meshes import NamedMesh, NodalField, box, moved, raised, read_mesh
    from .io.history_files import HistoryFiles
    from .load_curve import LoadCurve
    from .model.certificate import Certificate
    from .model.contact import Contact
    from .model.equilibrium import NoEquilibrium
    from .model.friction import SlipRateFriction, VariableFriction
    from .model.load_history import LoadHistory, StepFailed
    from .model.probes import Probe
    from .model.problem import ContactProblem
    from .model.solution import Solution
    from .model.stopping_criterion import certify
    from .solvers.interior_point import InteriorPoint
    from .solvers.results import NotConverged, Status
    from .solvers.rigid import solve_coulomb, solve_tresca
    from .solvers.successive_tresca import SuccessiveTresca

__all__ = [
    "Body",
    "Certificate",
    "Clamp",
    "Contact",
    "ContactProblem",
    "Cylinder",
    "Elasticity",
    "HistoryFiles",
    "InteriorPoint",
    "LoadCurve",
    "LoadHistory",
    "Material",
    "NamedMesh",
    "NoEquilibrium",
    "NodalField",
    "NotConverged",
    "OrthotropicMaterial",
    "Plane",
    "PrescribedDisplacement",
    "PrescribedRotation",
    "Pressure",
    "Probe",
    "Rotation",
    "SignedDistance",
    "SlipRateFriction",
    "Solution",
    "Sphere",
    "Spring",
    "Status",
    "StepFailed",
    "SuccessiveTresca",
    "SymmetryPlane",
    "ThermalLoad",
    "TotalForce",
    "Traction",
    "VariableFriction",
    "__version__",
    "box",
    "certify",
    "join",
    "moved",
    "raised",
    "read_mesh",
    "solve_coulomb",
    "solve_tresca",
]

_PUBLIC = {
    "fem.bodies": (
        "Body",
        "Clamp",
        "Elasticity",
        "Material",
        "OrthotropicMaterial",
        "PrescribedDisplacement",
        "PrescribedRotation",
        "Pressure",
        "Spring",
        "SymmetryPlane",
        "ThermalLoad",
        "TotalForce",
        "Traction",
        "join",
    ),
    "fem.geometry": (
        "Cylinder",
        "Plane",
        "Rotation",
        "SignedDistance",
        "Sphere",
    ),
    "fem.meshes": (
        "NamedMesh",
        "NodalField",
        "box",
        "moved",
        "raised",
        "read_mesh",
    ),
    "io.history_files": ("HistoryFiles",),
    "load_curve": ("LoadCurve",),
    "model.certificate": ("Certificate",),
    "model.stopping_criterion": ("certify",),
    "model.contact": ("Contact",),
    "model.equilibrium": ("NoEquilibrium",),
    "model.friction": (
        "SlipRateFriction",
        "VariableFriction",
    ),
    "model.load_history": (
        "LoadHistory",
        "StepFailed",
    ),
    "model.probes": ("Probe",),
    "model.problem": ("ContactProblem",),
    "model.solution": ("Solution",),
    "solvers.interior_point": ("InteriorPoint",),
    "solvers.results": (
        "NotConverged",
        "Status",
    ),
    "solvers.rigid": (
        "solve_coulomb",
        "solve_tresca",
    ),
    "solvers.successive_tresca": ("SuccessiveTresca",),
}
"""The public names by module; a module is loaded when one of its names is first used."""

_MOVED = {
    "solvers": (
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
    ),
    "model": (
        "Check",
        "Energy",
        "LoadStep",
        "ProbeValue",
        "Resultant",
    ),
    "fem": (
        "ContactSurface",
        "JoinedMesh",
    ),
    "fem.meshes": (
        "read_gmsh",
        "read_xdmf",
    ),
}
"""Names of the version before, by where they are now."""

if not TYPE_CHECKING:  # type checkers would accept every name
    __getattr__ = lazy_names(__name__, _PUBLIC, _MOVED)


def _write(solution: Solution, directory: str | Path, fields: Mapping[str, object]) -> None:
    """The writer of `Solution.write`, loaded when it is first needed."""
    import_module(".pictures.picture_of_run", __name__).write_with_picture(solution, directory, fields)


solution_writer.supply(_write)


def __dir__() -> list[str]:
    return sorted(globals().keys() | set(__all__))
