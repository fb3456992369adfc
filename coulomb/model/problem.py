"""A body, its loads, and the foundation it may touch: where the finite-element room and the algebra room meet."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.elasticity import Elasticity, Materials, PrescribedDisplacement, Spring, Traction
from ..fem.meshes import NamedMesh
from ..fem.obstacles import RigidFoundation
from ..fem.surface import ContactSurface
from ..fem.user_values import Amplitude, Field
from ..linalg.compliance import Compliance, ExplicitCompliance, MatrixFreeCompliance, SchurCompliance
from ..linalg.methods import LinearSolver, chosen, contact_last
from ..linalg.multifrontal import MultifrontalSolver
from ..linalg.stiffness import DirectSolver, StiffnessSolver
from ..solvers.automatic import default_solver
from ..solvers.friction_problem import CoulombSolver, FrictionProblem, QPSolver
from ..solvers.laws import FrictionLaw
from ..solvers.results import CoulombResult, NotConverged, ProgressCallback, QPResult
from .acceptance import CERTIFIED_FROM, Acceptance
from .contact import Contact, ContactFaces
from .evidence import Before
from .nodal_answer import closure
from .provenance import now
from .small_strain import known_mode
from .solution import Solution, warn
from .stopwatch import timed


class ContactProblem:
    """A linear elastic body in frictional contact with a rigid foundation.

    u = K^-1 (f - B^T x) with the contact forces x, which obey |x_t| <= c a + F x_n (`solvers/laws.py`).

    Args:
        mesh: The body.
        material: Its material, or a mapping of cell groups to theirs.
        clamps: Prescribed displacements; they and the springs must leave it no rigid motion.
        contact: The contact face, its foundation and friction; or several, which share no node; their laws may differ.
        tractions: Surface loads.
        body_force: Force per volume in N/m^3.
        springs: Elastic supports.
        body_force_amplitude: What it is multiplied by in the course of time.
        time: The time at which loads, prescribed displacements and the foundation's place are taken.
        linear_solver: DirectSolver or IterativeSolver for K^-1; by default chosen by size.
        explicit: Whether to form the matrix A; by default chosen by size.  Needs the direct solver.
        small_strain: Whether an answer outside the theory (`SmallStrain.violations`) does not count, "enforce", or is
            worth a warning, "warn".

    Attributes:
        elasticity: K, f and what belongs to them.
        surface: The contact nodes.
        law: Of friction at this rank's contact nodes.
        contacts: The contact faces.
        motions: Where their foundations are at this time, from where they were given, metres, shape (faces, 3).
        slip_origin: Displacement of the contact points at which they have not slipped, along n, t1, t2, metres, shape
            (m, 3): 0 at first, in a later load step that of the step before, carried along with the foundation.
        linear_solver: The one taken for K^-1 (DirectSolver also stands for MultifrontalSolver: `stiffness_method`).
        explicit: Whether A is formed.
        small_strain: As given.
        seconds: Wall time of each phase so far.
        started: When the work on it began.

    Raises:
        ValueError: If the input does not make a problem, on every rank; the text says what would be right.
    """

    def __init__(
        self,
        mesh: NamedMesh,
        material: Materials,
        clamps: Sequence[PrescribedDisplacement],
        contact: Contact | Sequence[Contact],
        tractions: Sequence[Traction] = (),
        body_force: Field = (0.0, 0.0, 0.0),
        springs: Sequence[Spring] = (),
        *,
        body_force_amplitude: Amplitude = 1.0,
        time: float = 0.0,
        linear_solver: LinearSolver | None = None,
        explicit: bool | None = None,
        small_strain: str = "enforce",
    ):
        self.small_strain = known_mode(small_strain)
        chosen(0, 0, mesh.comm.size, linear_solver, explicit)  # what cannot be is refused before the assembly
        self.mesh = mesh
        self.contacts = (contact,) if isinstance(contact, Contact) else tuple(contact)
        self.seconds: dict[str, float] = {}
        self.started = now()
        with timed(self.seconds, "assembly"):
            self.elasticity = Elasticity(
                mesh, material, clamps, tractions, body_force, springs, body_force_amplitude, time
            )
            self._faces = ContactFaces(self.contacts, self.comm)
            self.motions: FloatArray = np.zeros((len(self.contacts), 3))
            self.surface: ContactSurface = self._faces.surface(self.elasticity, self.motions)
            self._faces = self._faces.against(self.surface.foundations)  # where none was given, the face's own plane
            self.slip_origin: FloatArray = np.zeros((len(self.surface.nodes), 3))
            self._move_foundations()
            self.law: FrictionLaw = self._faces.law(self.surface)
        self.linear_solver, self.explicit = chosen(
            self.unknowns["displacement"], self.unknowns["contact"], self.comm.size, linear_solver, explicit
        )

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share the problem."""
        return self.mesh.comm

    @property
    def time(self) -> float:
        """The time at which loads, prescribed displacements and the foundation's place are taken."""
        return self.elasticity.time

    def at(self, time: float, before: Before | None = None) -> ContactProblem:
        """The problem at another time, K and its solver shared; collective.

        Args:
            time: When.
            before: What slip counts from, with the foundation carried along since; by default as in this problem.

        Raises:
            ValueError: On every rank, if an amplitude or the motion has no value then, or the foundation has moved so
                that other nodes than before can touch it.
        """
        self.stiffness_solver, self.A  # noqa: B018  (made once, shared by all times)
        other = self.unsolved_at(time)
        if before is not None:
            carried = (other.motions - self.motions_at(before.time))[other.surface.part]
            other.slip_origin = other.surface.rows(before.displacement) + other.surface.components(carried)
        return other

    def unsolved_at(self, time: float) -> ContactProblem:
        """The same, for who only wants to look at it: what was not made before is not shared."""
        other = copy.copy(self)
        other.seconds = {}
        for name in ("b", "_free_displacement"):
            other.__dict__.pop(name, None)
        with timed(other.seconds, "assembly"):
            other.elasticity = self.elasticity.at(time)
            other._move_foundations()
            other.slip_origin = other.surface.components(self.surface.vectors(self.slip_origin))
        return other

    @property
    def foundations(self) -> tuple[RigidFoundation, ...]:
        """Of all contact faces, where they were given; of a face without one, its own plane."""
        return tuple(foundation for foundation in self._faces.foundations if foundation is not None)

    def motions_at(self, time: float) -> FloatArray:
        """Translations of the foundations of all contact faces at a time in metres, shape (faces, 3); collective."""
        return self._faces.motions(time)

    def _move_foundations(self) -> None:
        """Gaps, and where they turn also frames, B and A, for where the foundations are at this time."""
        where = self.motions_at(self.time)
        if np.array_equal(where, self.motions):
            return
        self.motions, before = where, self.surface
        after = self._faces.surface(self.elasticity, where)
        if not self.comm.allreduce(np.array_equal(before.nodes, after.nodes), op=MPI.LAND):
            raise ValueError(f"contact: at time {self.time:g} the foundation has turned its normals to other nodes")
        turned = not np.allclose(before.frames, after.frames, rtol=0.0, atol=1e-14)
        if not self.comm.allreduce(turned, op=MPI.LOR):
            self.surface = replace(after, frames=before.frames, B=before.B)
            return
        self.surface = after
        if "A" in self.__dict__:
            turn = np.einsum("kij,klj->kil", after.frames, before.frames)
            A = self.A
            if isinstance(A, SchurCompliance):
                self.A = A.turned(after.B)
            elif isinstance(A, ExplicitCompliance):
                self.A = A.turned(turn)
            else:
                self.A = MatrixFreeCompliance(after.B, self.elasticity.K, self.stiffness_solver)

    @cached_property
    def unknowns(self) -> dict[str, int]:
        """Free displacement unknowns and contact unknowns, over all ranks."""
        free = int(np.count_nonzero(~self.elasticity.fixed))
        contact = 3 * len(self.surface.nodes)
        return {
            "displacement": self.comm.allreduce(free, op=MPI.SUM),
            "contact": self.comm.allreduce(contact, op=MPI.SUM),
        }

    @property
    def stiffness_method(self) -> str:
        """Name of the solver for K^-1: where A is formed on one rank, it gives the Schur complement as well."""
        return MultifrontalSolver.name if contact_last(self.explicit, self.comm.size) else self.linear_solver.name

    @cached_property
    def stiffness_solver(self) -> StiffnessSolver:
        """K^-1."""
        with timed(self.seconds, "stiffness"):
            if contact_last(self.explicit, self.comm.size):
                return MultifrontalSolver(self.elasticity.K, self.elasticity.x, self.surface.nodes_in_rows)
            return self.linear_solver(self.elasticity.K)

    @cached_property
    def A(self) -> Compliance:
        """Compliance B K^-1 B^T of the contact nodes, metres per newton."""
        solver = self.stiffness_solver
        with timed(self.seconds, "compliance"):
            if isinstance(solver, MultifrontalSolver):
                return SchurCompliance(self.surface.B, solver)
            if self.explicit:
                assert isinstance(solver, DirectSolver)
                return ExplicitCompliance.from_stiffness(self.surface.B, solver)
            return MatrixFreeCompliance(self.surface.B, self.elasticity.K, solver)

    @cached_property
    def b(self) -> FloatArray:
        """B K^-1 f - c in metres, this rank's part, shape (3 m,): how far the free body would pass the foundation.

        c is the gap along n, and along t1 and t2 the displacement from which slip counts.
        """
        free = self.closure(self._free_displacement)
        free[:, 0] -= self.surface.gap
        return free.ravel()

    def closure(self, u: FloatArray) -> FloatArray:
        """What u (k, 3) does to the gaps: u_n, and slip along t1 and t2, metres, shape (m, 3); collective."""
        return closure(self.surface.rows(u), self.slip_origin)

    @cached_property
    def mean_compliance(self) -> float:
        """Mean of diag(A) in metres per newton: the scale that turns a gap into a force."""
        return self.friction_problem.mean_diagonal

    def displacement(self, x: FloatArray) -> FloatArray:
        """K^-1 (f - B^T x) in metres, this rank's nodes, shape (k, 3); x in newtons, shape (3 m,)."""
        if "A" in self.__dict__ and isinstance(self.A, MatrixFreeCompliance):
            kept: FloatArray = self._free_displacement - self.A.response(x).array_r.reshape(-1, 3)
            return kept
        rhs, u = self.elasticity.K.createVecs()
        rhs.array[:] = -self.surface.at_nodes(x).ravel()
        rhs.axpy(1.0, self.elasticity.f)
        self.stiffness_solver.solve(rhs, u)
        values: FloatArray = u.array.reshape(-1, 3).copy()
        rhs.destroy()
        u.destroy()
        return values

    @cached_property
    def _free_displacement(self) -> FloatArray:
        """K^-1 f in metres, this rank's nodes, shape (k, 3): the body without contact."""
        u, solver = self.elasticity.K.createVecRight(), self.stiffness_solver
        with timed(self.seconds, "displacement"):
            solver.solve(self.elasticity.f, u)
        values: FloatArray = u.array.reshape(-1, 3).copy()
        u.destroy()
        return values

    def nodal_contact_force(self, x: FloatArray) -> FloatArray:
        """B^T x in newtons, this rank's nodes, shape (k, 3): minus the force on the body; collective."""
        return self.surface.at_nodes(x)

    def slip_bound(self, x: FloatArray) -> FloatArray:
        """Bound of the friction force of every node at the forces x (3 m,), newtons, shape (m,)."""
        return self.law.radius(x[0::3])

    @property
    def friction_problem(self) -> FrictionProblem:
        """A, b and the law, without the body."""
        return FrictionProblem(self.A, self.b, self.law)

    def tresca(self, slip_bound: FloatArray) -> FrictionProblem:
        """The Tresca problem with these slip bounds in newtons, shape (m,)."""
        return FrictionProblem.tresca(self.A, self.b, slip_bound)

    def solve(
        self,
        tolerance: float = 1e-8,
        solver: CoulombSolver | QPSolver | None = None,
        progress: ProgressCallback | None = None,
        start: FloatArray | None = None,
    ) -> Solution:
        """Solve, and certify the answer; whether it counts is `Solution.valid`.  What is outside the theory is logged.

        Args:
            tolerance: Residual of the problem at which to stop, once the certificate passes; a
                tolerance above 1e-8 asks for less, and the solver stops at it whatever the certificate says.
            solver: In place of the default (and of its tolerance).  Where friction grows with pressure Automatic (the
                default), OneLoop or SuccessiveTresca; where it does not, PathFollowing (the default) or KPRGP besides.
                Condensed Newton systems of these need explicit=False.
            progress: Called after every path-following step.
            start: Forces in newtons to start from, shape (3 m,), as those of a load step before, or of a coarser mesh
                (`interpolated_forces`); used where friction grows with pressure.

        Raises:
            NotConverged: If the residual stays above the tolerance, or the certificate does not pass however small the
                residual; `solution(error.result)` has what there is.
        """
        self.stiffness_solver, self.A, self.b  # noqa: B018  (each is timed on its own)
        problem = self.friction_problem
        chosen: Any = solver or default_solver(problem, tolerance)
        acceptance = Acceptance(self)
        if chosen.tolerance <= CERTIFIED_FROM:
            problem = replace(problem, accept=acceptance)
        with timed(self.seconds, "solve"):
            try:
                result: CoulombResult | QPResult = (
                    chosen.solve(problem, start=start, progress=progress)
                    if problem.sloped
                    else chosen.solve(problem, progress=progress)
                )
            except NotConverged as failure:
                raise acceptance.explained(failure, chosen.tolerance) from None
        answer = self.solution(result, acceptance)
        warn(answer)
        return answer

    def solution(self, result: CoulombResult | QPResult, acceptance: Acceptance | None = None) -> Solution:
        """Displacement and certificate of a solver's result, converged or not; from `acceptance` where it has them."""
        judged = (acceptance or Acceptance(self)).answer(result.x)
        x = judged.contact_force
        g = self.slip_bound(x)
        if isinstance(result, CoulombResult):
            g = np.where(g > 0.0, result.slip_bound, 0.0)  # as the forces, exactly zero at open nodes
        return Solution(self, x, judged.displacement, g, result, judged.certificate)
