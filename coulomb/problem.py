"""A body, its loads, and the foundation it may touch: where the finite-element room and the algebra room meet."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from .arrays import FloatArray
from .fem.body import Material
from .fem.elasticity import Clamp, Elasticity, Traction
from .fem.fields import Coefficient, Field, evaluate_numbers
from .fem.meshes import NamedMesh
from .fem.obstacles import RigidFoundation
from .fem.surface import ContactSurface, contact_surface
from .solvers import schur
from .solvers.automatic import Automatic
from .solvers.compliance import Compliance, ExplicitCompliance, MatrixFreeCompliance
from .solvers.coulomb import CoulombProblem, CoulombSolver
from .solvers.fixed_point import SuccessiveTresca
from .solvers.kprgp import KPRGP
from .solvers.one_loop import OneLoop
from .solvers.path_following import PathFollowing
from .solvers.results import CoulombResult, ProgressCallback, QPResult
from .solvers.stiffness import DirectSolver, IterativeSolver, StiffnessSolver
from .solvers.tresca import QPSolver, TrescaQP

if TYPE_CHECKING:
    from .certificate import Certificate

DIRECT_UP_TO = 50_000
"""Displacement unknowns up to which K is factorised by default on one rank (measured: docs/measurements.md)."""

DIRECT_IN_PARALLEL_UP_TO = 4_000
"""The same on several ranks, where MUMPS gives no Schur complement through PETSc and A takes many solves."""

EXPLICIT_UP_TO = 10_000
"""Contact unknowns up to which A is formed by default, where K is factorised (measured: docs/measurements.md)."""


@dataclass(frozen=True)
class Contact:
    """Which face may touch which foundation, and how it rubs there; exactly one of the two friction laws.

    Attributes:
        face: Name of the contact face.
        friction: Coulomb's coefficient F >= 0, constant or a function of place.
        slip_stress: Tresca friction: the shear stress in pascals at which the face slips, whatever the pressure;
            constant or a function of place.
        foundation: Rigid foundation; by default the plane of the face itself (gap 0).

    Raises:
        ValueError: If not exactly one law is given, or its number is negative or not finite.
    """

    face: str
    friction: Coefficient | None = None
    slip_stress: Coefficient | None = None
    foundation: RigidFoundation | None = None

    def __post_init__(self) -> None:
        if (self.friction is None) == (self.slip_stress is None):
            raise ValueError("contact: give either friction (Coulomb) or slip_stress (Tresca), one of the two")
        for name, value in (("friction", self.friction), ("slip_stress", self.slip_stress)):
            if value is not None and not callable(value) and not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"contact: {name} must be a number >= 0, but is {value}")


class ContactProblem:
    """A linear elastic body in frictional contact with a rigid foundation.

    u = K^-1 (f - B^T x) with the contact forces x, of the Tresca problem with g = F x_n (Coulomb) or given g.

    Args:
        mesh: The body.
        material: Its material.
        clamps: Prescribed displacements; they must leave it no rigid motion.
        contact: The contact face, its foundation and friction.
        tractions: Surface loads.
        body_force: Force per volume in N/m^3.
        linear_solver: DirectSolver or IterativeSolver for K^-1; by default chosen by size.
        explicit: Whether to form the matrix A; by default chosen by size.  Needs the direct solver.

    Attributes:
        elasticity: K, f and what belongs to them.
        surface: The contact nodes.
        coefficient: Friction F, or slip stress in pascals, at this rank's contact nodes, shape (m,).
        seconds: Wall time of each phase so far.

    Raises:
        ValueError: If the input does not make a problem, on every rank; the text says what would be right.
    """

    def __init__(
        self,
        mesh: NamedMesh,
        material: Material,
        clamps: Sequence[Clamp],
        contact: Contact,
        tractions: Sequence[Traction] = (),
        body_force: Field = (0.0, 0.0, 0.0),
        *,
        linear_solver: type[DirectSolver] | type[IterativeSolver] | None = None,
        explicit: bool | None = None,
    ):
        if explicit and linear_solver is IterativeSolver:
            raise ValueError("explicit=True needs the factorised K: use linear_solver=DirectSolver")
        self.mesh, self.contact = mesh, contact
        self.seconds: dict[str, float] = {}
        with self._timed("assembly"):
            self.elasticity = Elasticity(mesh, material, clamps, tractions, body_force)
            self.surface: ContactSurface = contact_surface(self.elasticity, contact.face, contact.foundation)
            law, given = ("friction", contact.friction) if self.coulomb else ("slip_stress", contact.slip_stress)
            assert given is not None
            self.coefficient = evaluate_numbers(given, self.surface.x, f"contact: {law}", self.comm)
        if linear_solver is None:
            limit = DIRECT_UP_TO if self.comm.size == 1 else DIRECT_IN_PARALLEL_UP_TO
            small = self.unknowns["displacement"] <= limit
            linear_solver = DirectSolver if explicit or small else IterativeSolver
        self._linear_solver = linear_solver
        if explicit is None:
            explicit = linear_solver is DirectSolver and self.unknowns["contact"] <= EXPLICIT_UP_TO
        self._explicit = explicit

    @property
    def comm(self) -> MPI.Comm:
        return self.mesh.comm

    @cached_property
    def unknowns(self) -> dict[str, int]:
        """Free displacement unknowns and contact unknowns, over all ranks."""
        free = int(np.count_nonzero(~self.elasticity.fixed))
        contact = 3 * len(self.surface.nodes)
        return {
            "displacement": self.comm.allreduce(free, op=MPI.SUM),
            "contact": self.comm.allreduce(contact, op=MPI.SUM),
        }

    @cached_property
    def stiffness_solver(self) -> StiffnessSolver:
        """K^-1."""
        B = self.surface.B
        with self._timed("stiffness"):
            if self._explicit and schur.available(B.getComm()):
                return DirectSolver(self.elasticity.K, keep=np.unique(B.getValuesCSR()[1]).astype(np.int32))
            return self._linear_solver(self.elasticity.K)

    @cached_property
    def A(self) -> Compliance:
        """Compliance B K^-1 B^T of the contact nodes, metres per newton."""
        solver = self.stiffness_solver
        with self._timed("compliance"):
            if self._explicit:
                assert isinstance(solver, DirectSolver)
                if solver.kept is not None:
                    return ExplicitCompliance.from_schur_complement(self.surface.B, solver)
                return ExplicitCompliance.from_stiffness(self.surface.B, solver)
            return MatrixFreeCompliance(self.surface.B, self.elasticity.K, solver)

    @cached_property
    def b(self) -> FloatArray:
        """B K^-1 f - c in metres, this rank's part, shape (3 m,): how far the free body would pass the foundation."""
        closure = self.surface.components(self._free_displacement[self.surface.nodes])
        closure[:, 0] -= self.surface.gap
        return closure.ravel()

    @cached_property
    def mean_compliance(self) -> float:
        """Mean of diag(A) in metres per newton: the scale that turns a gap into a force."""
        return self.tresca(np.zeros(len(self.surface.nodes))).mean_diagonal

    def displacement(self, x: FloatArray) -> FloatArray:
        """K^-1 (f - B^T x) in metres, this rank's nodes, shape (k, 3); x in newtons, shape (3 m,)."""
        if "A" in self.__dict__ and isinstance(self.A, MatrixFreeCompliance):
            kept: FloatArray = self._free_displacement - self.A.response(x).array_r.reshape(-1, 3)
            return kept
        rhs, u = self.elasticity.K.createVecs()
        self._apply_BT(x, rhs)
        rhs.aypx(-1.0, self.elasticity.f)
        self.stiffness_solver.solve(rhs, u)
        values: FloatArray = u.array.reshape(-1, 3).copy()
        rhs.destroy()
        u.destroy()
        return values

    @cached_property
    def _free_displacement(self) -> FloatArray:
        """K^-1 f in metres, this rank's nodes, shape (k, 3): the body without contact."""
        u, solver = self.elasticity.K.createVecRight(), self.stiffness_solver
        with self._timed("displacement"):
            solver.solve(self.elasticity.f, u)
        values: FloatArray = u.array.reshape(-1, 3).copy()
        u.destroy()
        return values

    def nodal_contact_force(self, x: FloatArray) -> FloatArray:
        """B^T x in newtons, this rank's nodes, shape (k, 3): minus the force on the body."""
        rhs = self.elasticity.K.createVecRight()
        self._apply_BT(x, rhs)
        values: FloatArray = rhs.array.reshape(-1, 3).copy()
        rhs.destroy()
        return values

    def _apply_BT(self, x: FloatArray, rhs: Any) -> None:
        forces = self.surface.B.createVecLeft()
        forces.array[:] = x
        self.surface.B.multTranspose(forces, rhs)
        forces.destroy()

    def slip_bound(self, x: FloatArray) -> FloatArray:
        """g in newtons at the forces x: F x_n for Coulomb, slip stress times area for Tresca; shape (m,)."""
        bound: FloatArray = self.coefficient * (np.maximum(x[0::3], 0.0) if self.coulomb else self.surface.area)
        return bound

    @property
    def coulomb(self) -> bool:
        """Whether friction is Coulomb's; else Tresca's."""
        return self.contact.friction is not None

    @property
    def coulomb_problem(self) -> CoulombProblem:
        """A, b and friction, without the body."""
        return CoulombProblem(self.A, self.b, self.coefficient)

    def tresca(self, slip_bound: FloatArray) -> TrescaQP:
        """The Tresca problem with these slip bounds in newtons, shape (m,)."""
        return TrescaQP(self.A, self.b, slip_bound)

    def solve(
        self,
        tolerance: float = 1e-8,
        solver: CoulombSolver | QPSolver | None = None,
        progress: ProgressCallback | None = None,
    ) -> Solution:
        """Solve, and certify the answer.

        Args:
            tolerance: Residual of the problem (Coulomb or Tresca) at which to stop.
            solver: In place of the default (and of its tolerance).  For Coulomb friction Automatic (the default),
                OneLoop or SuccessiveTresca; for Tresca friction PathFollowing (the default) or KPRGP.  Condensed Newton
                systems of these need explicit=False.
            progress: Called after every path-following step.

        Raises:
            NotConverged: If the residual stays above the tolerance; `solution(error.result)` has what there is.
        """
        if self.coulomb and isinstance(solver, PathFollowing | KPRGP):
            raise ValueError("solver: Coulomb friction needs Automatic, OneLoop or SuccessiveTresca(qp_solver=...)")
        if not self.coulomb and isinstance(solver, Automatic | OneLoop | SuccessiveTresca):
            raise ValueError("solver: Tresca friction needs a QPSolver such as PathFollowing")
        self.stiffness_solver, self.A, self.b  # noqa: B018  (each is timed on its own)
        chosen: Any = solver or (Automatic(tolerance) if self.coulomb else PathFollowing(tolerance=tolerance))
        problem: Any = self.coulomb_problem if self.coulomb else self.tresca(self.slip_bound(self.b))
        with self._timed("solve"):
            result: CoulombResult | QPResult = chosen.solve(problem, progress=progress)
        return self.solution(result)

    def solution(self, result: CoulombResult | QPResult) -> Solution:
        """Displacement and certificate of a solver's result, converged or not."""
        from .certificate import certify

        with self._timed("displacement"):
            u = self.displacement(result.x)
        g = result.slip_bound if isinstance(result, CoulombResult) else self.slip_bound(result.x)
        with self._timed("certificate"):
            certificate = certify(self, result.x, u, g)
        return Solution(self, result.x, u, g, result, certificate)

    @contextmanager
    def _timed(self, phase: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[phase] = self.seconds.get(phase, 0.0) + time.perf_counter() - began


@dataclass(frozen=True)
class Solution:
    """Answer of a contact problem.

    Attributes:
        problem: What was solved.
        contact_force: x in newtons, this rank's part, shape (3 m,), node by node (n, t1, t2); x_n >= 0 presses.
        displacement: In metres, this rank's nodes, shape (k, 3).
        slip_bound: The g in newtons that the solver used, shape (m,).
        result: What the solver says of it.
        certificate: What the problem says of it.
    """

    problem: ContactProblem
    contact_force: FloatArray
    displacement: FloatArray
    slip_bound: FloatArray
    result: CoulombResult | QPResult
    certificate: Certificate

    def write(self, directory: str) -> None:
        """Fields, history and summary into a directory; what is there is replaced when all is written."""
        from .output import write

        write(self, directory)
