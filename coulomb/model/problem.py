"""The contact problem: a body, its loads and its foundations, as A, b and the law of friction for the solvers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from ..fem.elasticity import Elasticity, Materials, PrescribedDisplacement, Spring, Traction
from ..fem.loaded_body import Loading
from ..fem.meshes import NamedMesh
from ..fem.obstacles import RigidFoundation
from ..fem.surface import ContactSurface
from ..fem.user_values import Amplitude, Field
from ..linalg.compliance import BodyCompliance
from ..linalg.methods import LinearSolver
from ..solvers.automatic import Automatic
from ..solvers.friction_problem import FrictionProblem, Solver
from ..solvers.laws import FrictionLaw
from ..solvers.results import NotConverged, ProgressCallback, SolverResult
from .acceptance import CERTIFIED_FROM, Acceptance
from .contact import Contact
from .contact_body import ContactBody
from .evidence import Evidence
from .gathered_evidence import gather_evidence
from .nodal_answer import closure
from .provenance import now
from .small_strain import known_mode
from .solution import Solution, warn
from .state import Before, ContactState
from .stopwatch import timed


class ContactProblem:
    """A linear elastic body in frictional contact with a rigid foundation.

    u = K^-1 (f - B^T x) with the contact forces x, which obey |x_t| <= c a + F x_n (`solvers/laws.py`).

    Args:
        mesh: The body.
        material: Its material, or a mapping of cell groups to theirs.
        clamps: Prescribed displacements (`Clamp`, `PrescribedDisplacement`); with the springs they must prevent every
            rigid motion.
        contact: The contact face, its foundation and friction; or several, which share no node; their laws may differ.
        tractions: Surface loads.
        body_force: Force per volume in N/m^3.
        springs: Elastic supports.
        body_force_amplitude: Factor of the body force as a function of time.
        time: Time of loads, prescribed displacements and the foundation's position.
        linear_solver: DirectSolver or IterativeSolver for K^-1; by default chosen by size.
        explicit: Whether to form the matrix A; by default chosen by size.  Needs the direct solver.
        small_strain: Whether an answer outside the theory (`SmallStrain.violations`) does not count, "enforce", or
            causes a warning, "warn".

    Attributes:
        body: The time-independent part: K, K^-1, A, contact faces and foundations.
        state: The state at one time: loads, gaps, frames, law of friction, slip origin.
        small_strain: The argument.
        seconds: Wall time of each phase so far.
        started: Date and time when it was set up.

    Raises:
        ValueError: On every rank, if the input is invalid, with a remedy.
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
        contacts = (contact,) if isinstance(contact, Contact) else tuple(contact)
        self.small_strain = known_mode(small_strain)
        self.started = now()
        self.body = ContactBody(
            *(mesh, material, clamps, contacts, tractions, body_force, springs, body_force_amplitude),
            *(time, linear_solver, explicit),
        )
        self.seconds = self.body.seconds
        with timed(self.seconds, "assembly"):
            self.state = self.body.state(time)

    def at(self, time: float, before: Before | None = None) -> ContactProblem:
        """The problem at another time with the same body, K^-1 and A; collective.

        Args:
            time: The time.
            before: State after the load step before, from which slip is measured, moved with the foundation since;
                by default slip is measured from the undeformed body.

        Raises:
            ValueError: On every rank, if an amplitude or the motion has no value then, or the set of contact
                nodes changes.
        """
        seconds: dict[str, float] = {}
        with timed(seconds, "assembly"):
            state = self.body.state(time, before)
        return self.in_state(state, seconds)

    def in_state(self, state: ContactState, seconds: dict[str, float] | None = None) -> ContactProblem:
        """The problem of the same body in another state.

        Args:
            state: The state.
            seconds: Wall time that was spent on it.
        """
        return _InState(self, state, {} if seconds is None else seconds)

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share the problem."""
        return self.body.comm

    @property
    def mesh(self) -> NamedMesh:
        """The mesh of the body."""
        return self.body.mesh

    @property
    def elasticity(self) -> Elasticity:
        """K, loads and supports."""
        return self.body.elasticity

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contact faces."""
        return self.body.contacts

    @property
    def foundations(self) -> tuple[RigidFoundation, ...]:
        """Foundations of all contact faces before any motion; by default the plane of the face."""
        return self.body.foundations

    @property
    def unknowns(self) -> dict[str, int]:
        """Free displacement unknowns and contact unknowns, over all ranks."""
        return self.body.unknowns

    @property
    def time(self) -> float:
        """Time of loads, prescribed displacements and the foundation's position."""
        return self.state.time

    @property
    def loading(self) -> Loading:
        """Loads and prescribed displacements."""
        return self.state.loading

    @property
    def motions(self) -> FloatArray:
        """Translations of the foundations, metres, shape (faces, 3)."""
        return self.state.motions

    @property
    def surface(self) -> ContactSurface:
        """The contact points."""
        return self.state.surface

    @property
    def law(self) -> FrictionLaw:
        """Law of friction at this rank's contact points."""
        return self.state.law

    @property
    def slip_origin(self) -> FloatArray:
        """Displacement of the contact points from which slip is measured, along n, t1, t2, metres, shape (m, 3)."""
        return self.state.slip_origin

    @cached_property
    def f(self) -> PETSc.Vec:
        """Load in newtons, with the prescribed displacements included; must not be modified."""
        return self.elasticity.f(self.loading)

    @cached_property
    def A(self) -> BodyCompliance:
        """Compliance B K^-1 B^T of the contact points, metres per newton."""
        return self.body.compliance(self.surface, self.seconds)

    @cached_property
    def b(self) -> FloatArray:
        """B K^-1 f - c in metres, this rank's part, shape (3 m,): penetration of the free body, and its slip.

        c is the gap along n, and along t1 and t2 the displacement from which slip counts.
        """
        free = self.closure(self._free_displacement)
        free[:, 0] -= self.surface.gap
        return free.ravel()

    def closure(self, u: FloatArray) -> FloatArray:
        """u_n, and slip along t1 and t2, of displacements u (k, 3), metres, shape (m, 3); collective."""
        return closure(self.surface.rows(u), self.slip_origin)

    @cached_property
    def mean_compliance(self) -> float:
        """Mean of diag(A) in metres per newton."""
        return self.friction_problem.mean_diagonal

    def displacement(self, x: FloatArray) -> FloatArray:
        """K^-1 (f - B^T x) in metres, this rank's nodes, shape (k, 3); x in newtons, shape (3 m,); collective."""
        return self.A.displacement(x, self.f, self._free_displacement.ravel()).reshape(-1, 3)

    @cached_property
    def _free_displacement(self) -> FloatArray:
        """K^-1 f in metres, this rank's nodes, shape (k, 3): the displacement without contact."""
        u, solver = self.elasticity.K.createVecRight(), self.body.stiffness_solver
        with timed(self.seconds, "displacement"):
            solver.solve(self.f, u)
        values: FloatArray = u.array.reshape(-1, 3).copy()
        u.destroy()
        return values

    def nodal_contact_force(self, x: FloatArray) -> FloatArray:
        """B^T x in newtons, this rank's nodes, shape (k, 3): minus the force on the body; collective."""
        return self.surface.at_nodes(x)

    def evidence(self, x: FloatArray, u: FloatArray, before: Before | None = None) -> Evidence:
        """The evidence for a certificate, from body, contact faces and foundations as given; collective.

        Args:
            x: Contact forces in newtons, shape (3 m,), point by point (n, t1, t2) of the surface.
            u: Displacement in metres, this rank's nodes, shape (k, 3).
            before: State after the load step before; by default slip is measured from `slip_origin`.
        """
        return gather_evidence(self.body, self.state, x, u, self.mean_compliance, before)

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
        solver: Solver | None = None,
        progress: ProgressCallback | None = None,
        start: FloatArray | None = None,
    ) -> Solution:
        """Solve, and certify the answer; `Solution.valid` is the verdict.  Violations of the small-strain theory are
        logged.

        Args:
            tolerance: Residual of the problem at which to stop, once the certificate passes; a
                tolerance above 1e-8 ends the solver whether or not the certificate passes.
            solver: Replaces the default (and its tolerance): Automatic (the default), InteriorPoint or
                SuccessiveTresca; where no friction grows with pressure, also KPRGP.  Condensed Newton systems need
                explicit=False.
            progress: Called after every step.
            start: Forces in newtons to start from, shape (3 m,), as those of a load step before, or of a coarser mesh
                (`interpolated_forces`).

        Raises:
            NotConverged: If the residual stays above the tolerance, or the certificate fails for any residual
                reached; `solution(error.result)` is the best answer.
        """
        problem = self.friction_problem  # K^-1, A and b are timed separately
        chosen = solver or Automatic(tolerance)
        acceptance = Acceptance(self)
        if chosen.tolerance <= CERTIFIED_FROM:
            problem = replace(problem, accept=acceptance)
        with timed(self.seconds, "solve"):
            try:
                result = chosen.solve(problem, start, progress=progress)
            except NotConverged as failure:
                raise acceptance.explained(failure, chosen.tolerance) from None
        answer = self.solution(result, acceptance)
        warn(answer)
        return answer

    def solution(self, result: SolverResult, acceptance: Acceptance | None = None) -> Solution:
        """Displacement and certificate of a solver's result, converged or not; from `acceptance` if it has them."""
        judged = (acceptance or Acceptance(self)).answer(result.x)
        x = judged.contact_force
        g = np.where(self.slip_bound(x) > 0.0, result.slip_bound, 0.0)  # exactly zero at open nodes, as the forces
        return Solution(self, x, judged.displacement, g, result, judged.certificate)


class _InState(ContactProblem):
    """A contact problem made of parts of another one."""

    def __init__(self, of: ContactProblem, state: ContactState, seconds: dict[str, float]):
        self.body, self.state, self.seconds = of.body, state, seconds
        self.small_strain, self.started = of.small_strain, of.started
