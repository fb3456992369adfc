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
    from .fem.contact import ContactSurface
    from .fem.geometry import Cylinder, Plane, Rotation, SignedDistance, Sphere
    from .fem.meshes import JoinedMesh, NamedMesh, NodalField, box, moved, raised, read_gmsh, read_mesh, read_xdmf
    from .io.history_files import HistoryFiles
    from .linalg.compliance import DirectSolver, IterativeSolver
    from .load_curve import LoadCurve
    from .model.certificate import Certificate, Check
    from .model.contact import Contact
    from .model.equilibrium import NoEquilibrium
    from .model.friction import SlipRateFriction, VariableFriction
    from .model.load_history import LoadHistory, StepFailed
    from .model.load_step import Energy, LoadStep
    from .model.probes import Probe, ProbeValue
    from .model.problem import ContactProblem
    from .model.resultants import Resultant
    from .model.solution import Solution
    from .model.stopping_criterion import certify
    from .solvers.automatic import Automatic
    from .solvers.condensed import CondensedSystem
    from .solvers.dense_system import DenseSystem
    from .solvers.friction_problem import FrictionProblem
    from .solvers.interior_point import InteriorPoint
    from .solvers.kprgp import KPRGP
    from .solvers.laws import FrictionLaw
    from .solvers.newton_systems import AugmentedSystem, SchurComplementSystem
    from .solvers.results import NotConverged, Progress, SolverResult, Status
    from .solvers.rigid import ConeInteriorPoint, MatrixAutomatic, RegularisedNewton, solve_coulomb, solve_tresca
    from .solvers.rigid_motions import RigidMotions
    from .solvers.successive_tresca import SuccessiveTresca

__all__ = [
    "KPRGP",
    "AugmentedSystem",
    "Automatic",
    "Body",
    "Certificate",
    "Check",
    "Clamp",
    "CondensedSystem",
    "ConeInteriorPoint",
    "Contact",
    "ContactProblem",
    "ContactSurface",
    "Cylinder",
    "DenseSystem",
    "DirectSolver",
    "Elasticity",
    "Energy",
    "FrictionLaw",
    "FrictionProblem",
    "HistoryFiles",
    "InteriorPoint",
    "IterativeSolver",
    "JoinedMesh",
    "LoadCurve",
    "LoadHistory",
    "LoadStep",
    "Material",
    "MatrixAutomatic",
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
    "ProbeValue",
    "Progress",
    "RegularisedNewton",
    "Resultant",
    "RigidMotions",
    "Rotation",
    "SchurComplementSystem",
    "SignedDistance",
    "SlipRateFriction",
    "Solution",
    "SolverResult",
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
    "read_gmsh",
    "read_mesh",
    "read_xdmf",
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
    "fem.contact": ("ContactSurface",),
    "fem.geometry": (
        "Cylinder",
        "Plane",
        "Rotation",
        "SignedDistance",
        "Sphere",
    ),
    "fem.meshes": (
        "JoinedMesh",
        "NamedMesh",
        "NodalField",
        "box",
        "moved",
        "raised",
        "read_gmsh",
        "read_mesh",
        "read_xdmf",
    ),
    "io.history_files": ("HistoryFiles",),
    "linalg.compliance": (
        "DirectSolver",
        "IterativeSolver",
    ),
    "load_curve": ("LoadCurve",),
    "model.certificate": (
        "Certificate",
        "Check",
    ),
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
    "model.load_step": (
        "Energy",
        "LoadStep",
    ),
    "model.probes": (
        "Probe",
        "ProbeValue",
    ),
    "model.problem": ("ContactProblem",),
    "model.resultants": ("Resultant",),
    "model.solution": ("Solution",),
    "model.stopping_criterion": ("certify",),
    "solvers.automatic": ("Automatic",),
    "solvers.condensed": ("CondensedSystem",),
    "solvers.dense_system": ("DenseSystem",),
    "solvers.friction_problem": ("FrictionProblem",),
    "solvers.interior_point": ("InteriorPoint",),
    "solvers.kprgp": ("KPRGP",),
    "solvers.laws": ("FrictionLaw",),
    "solvers.newton_systems": (
        "AugmentedSystem",
        "SchurComplementSystem",
    ),
    "solvers.results": (
        "NotConverged",
        "Progress",
        "SolverResult",
        "Status",
    ),
    "solvers.rigid": (
        "ConeInteriorPoint",
        "MatrixAutomatic",
        "RegularisedNewton",
        "solve_coulomb",
        "solve_tresca",
    ),
    "solvers.rigid_motions": ("RigidMotions",),
    "solvers.successive_tresca": ("SuccessiveTresca",),
}
"""The public names by module; a module is loaded when one of its names is first used."""

_HOMES = {name: home for home, names in _PUBLIC.items() for name in names}


if not TYPE_CHECKING:  # type checkers would accept every name

    def __getattr__(name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value: object = getattr(import_module(f".{_HOMES[name]}", __name__), name)
        globals()[name] = value
        return value


def _write(solution: Solution, directory: str | Path, fields: Mapping[str, object]) -> None:
    """The writer of `Solution.write`, loaded when it is first needed."""
    import_module(".pictures.picture_of_run", __name__).write_with_picture(solution, directory, fields)


solution_writer.supply(_write)


def __dir__() -> list[str]:
    return sorted(globals().keys() | _HOMES.keys())
