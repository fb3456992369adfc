"""A contact problem in one state, as A, b and the law of friction: what solvers and certificates work with; and its
error if K u = f is not solved by multigrid."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
from functools import cached_property
from typing import Any, Final, Generic, NamedTuple, TypeVar, cast

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from ..fem.bodies import Deformable, Loading, displacements_of
from ..fem.geometry import on_every_rank
from ..fem.meshes import NamedMesh
from ..linalg.compliance import BodyCompliance, StiffnessSolver
from ..linalg.reductions import Reductions
from ..linalg.solve_errors import CGNotConverged
from ..solvers.friction_problem import FrictionProblem
from ..solvers.results import NotConverged, Progress, ProgressCallback, SolverResult, Status
from ..solvers.rigid_motions import NO_MOTION, RigidMotions
from .certificate import Evidence
from .certificate_scales import components_of, lengths
from .contact_body import Before, ContactBody, ContactState, rigid_motions
from .contact_stiffness import FixedStiffness, explained
from .nodal_answer import relative_displacement
from .problem_evidence import gather_evidence
from .provenance import timed

_T = TypeVar("_T")

BALANCED: Final = 1e-13
"""Resultant force and moment of the residual, and 1e-2 of its norm, relative to the forces on the body."""

_ACCURACY: Final = 1e-6
"""Least relative residual of a correction: few more digits are left to gain by each."""

_BEYOND: Final = 0.1
"""Part of BALANCED at which a correction aims: its residual is not distributed like the one before."""

_MOST: Final = 4
"""Maximum number of corrections."""


def iteratively_refined(
    elasticity: Deformable, solver: StiffnessSolver, loading: Loading, on_body: FloatArray, u: FloatArray
) -> FloatArray:
    """The displacement u (k, 3) in metres by iterative refinement (Wilkinson 1963), until loads, springs, reactions and
    the contact forces `on_body` (k, 3) balance; collective.

    A solve with K leaves a residual relative to its right-hand side, which may be far larger than the forces on the
    body (K times a prescribed displacement that carries it along), or enough to move a body on soft springs.  So the
    residual is assembled anew from u and solved for again.  The springs at the anchors of free motions (`FreeMotions`)
    are among the forces in balance; at a solution they are zero.
    """
    over, x = Reductions(elasticity.comm), elasticity.x
    ends = np.array([[over.min(axis), over.max(axis)] for axis in x.T])
    half = np.full(len(x), 0.5 * np.linalg.norm(np.ptp(ends, axis=1)))
    rigid = elasticity.reduced(displacements_of(x - ends.mean(axis=1), half))

    def left_over(u: FloatArray) -> tuple[FloatArray, float]:
        """The residual at this rank's nodes, and its size relative to the forces on the body."""
        spring, anchored = elasticity.spring_force(u), elasticity.anchoring * elasticity.reduced(u, loading)
        forces = loading.load + spring + on_body - elasticity.internal_force(u)
        residual = elasticity.along_unknowns(forces, loading.time) - anchored
        reaction = elasticity.held_part(elasticity.transferred(forces))
        outer = (loading.load, spring - anchored[: len(u)], on_body, reaction)
        sums = over.total(np.einsum("kcj,kc->j", rigid, residual))
        scale = np.max([over.sum(lengths(part)) for part in outer])
        length = np.max([over.norm(part) for part in outer])
        return residual, float(
            np.max([np.max(np.abs(sums)) / (scale or 1.0), 1e-2 * over.norm(residual) / (length or 1.0)])
        )

    with np.errstate(all="ignore"):  # an answer that overflows fails its certificate
        residual, size = left_over(u)
        for _ in range(_MOST):
            if not BALANCED < size < math.inf:
                break
            accuracy = min(max(_BEYOND * BALANCED / size, _ACCURACY), _BEYOND)
            change, ended = _solved(elasticity.K, solver, residual, accuracy)
            changed = u + elasticity.free_part(change)
            after, smaller = left_over(changed)
            if not smaller < size:
                break
            u, residual, size, before = changed, after, smaller, size
            if ended or size > 0.5 * before:  # rounding
                break
    return u


def _solved(K: PETSc.Mat, solver: StiffnessSolver, residual: FloatArray, accuracy: float) -> tuple[FloatArray, bool]:
    """K^-1 of a residual (k, 3) to a relative accuracy; and whether the solve ended before."""
    rhs, change = K.createVecs()
    rhs.array[:] = residual.ravel()
    size = float(rhs.norm()) or 1.0  # scaled: solves start from combinations of earlier solutions of like size
    rhs.scale(1.0 / size)
    ended = False
    try:
        solver.solve(rhs, change, accuracy)
    except CGNotConverged:  # what was reached may still be better than before
        ended = True
    values: FloatArray = size * change.array_r.reshape(-1, 3)
    rhs.destroy()
    change.destroy()
    return values, ended


_ROUNDING: Final = 2.0**-48
"""Slip below this part of the displacements of which it is the difference is a rounding error."""

_BEFORE_REFINEMENT: Final = 1e-8
"""Residual of a solve with K that is refined: products by K have rounding errors of 1e-11 of the resultant forces."""


class StatePoints(NamedTuple):
    """This rank's nodes of contact points, and the numbers of their contact faces, shapes (m,)."""

    nodes: npt.NDArray[np.int32]
    part: npt.NDArray[np.int64]


class _OfStiffness(Generic[_T]):
    """A property of a `DiscreteProblem` that is computed once, and anew when K has changed (`ContactStiffness`)."""

    def __init__(self, compute: Callable[[Any], _T]):
        self._compute, self.__doc__ = compute, compute.__doc__

    def __get__(self, problem: Any, owner: type | None = None) -> _T:
        if problem is None:  # for documentation
            return cast(_T, self)
        version = problem.body.stiffness.version
        if problem.computed_for != version:
            problem.computed_for, problem.computed = version, {}
        if self not in problem.computed:
            problem.computed[self] = self._compute(problem)
        found: _T = problem.computed[self]
        return found


class DiscreteProblem:
    """A body in a state, u = K^-1 (f - B^T x) + R alpha with the contact forces x, which obey |x_t| <= c a + F x_n.

    R are the rigid motions that contact alone prevents (`FreeMotions`), alpha their amounts; without any, u = K^-1 (f -
    B^T x).

    Args:
        body: The time-independent part: K, K^-1, A, contact faces and foundations.
        state: The state at one time: loads, gaps, frames, law of friction, slip origin.
        small_strain: What becomes of an answer outside the theory, "enforce" or "warn".
        started: Date and time when it was set up.
        seconds: Wall time of each phase so far.
        before: End of the load step before, from which the certificate measures slip; by default from the state's
            `slip_origin`.

    Attributes:
        body, state, small_strain, started, seconds, before: The arguments.
        comm: The ranks that share the problem.
        contacts: The contact faces.
        unknowns: Free displacement unknowns and contact unknowns, over all ranks.
        elasticity: K, loads and supports at this time.
        loading: Loads and prescribed displacements.
        time: Time of loads, prescribed displacements and the foundation's position.
        surface: The contact points.
        law: Law of friction at this rank's contact points.
        computed: What was computed with K^-1, for the version `computed_for` of the body's stiffness.
    """

    def __init__(
        self,
        body: ContactBody,
        state: ContactState,
        small_strain: str,
        started: datetime,
        seconds: dict[str, float],
        before: Before | None = None,
    ):
        self.body, self.state, self.small_strain = body, state, small_strain
        self.started, self.seconds, self.before = started, seconds, before
        self.comm, self.contacts, self.unknowns = body.comm, body.contacts, body.unknowns
        self.elasticity, self.loading, self.time = state.elasticity, state.loading, state.time
        self.surface, self.law = state.surface, state.law
        self.computed: dict[object, Any] = {}
        self.computed_for = -1

    @property
    def points_of_states(self) -> StatePoints:
        """The contact points of the states of a load history."""
        return StatePoints(self.surface.nodes, self.surface.part)

    @property
    def mesh(self) -> NamedMesh:
        """The mesh of the body, if there is one body only."""
        return self.elasticity.alone.mesh

    @property
    def motions(self) -> FloatArray:
        """Translations of the foundations, metres, shape (faces, 3); rotations are in `state.foundation_motions`."""
        return np.array([motion.translation for motion in self.state.foundation_motions])

    @_OfStiffness
    def f(self) -> PETSc.Vec:
        """Load in newtons, with the prescribed displacements included; must not be modified."""
        return self.elasticity.f(self.loading)

    @_OfStiffness
    def stiffness(self) -> FixedStiffness:
        """K^-1 and A of the body at this time."""
        return self.body.stiffness.of(self.elasticity, self.seconds)

    @_OfStiffness
    def A(self) -> BodyCompliance:
        """Compliance B K^-1 B^T of the contact points, metres per newton."""
        return self.stiffness.compliance(self.surface, self.seconds)

    @_OfStiffness
    def b(self) -> FloatArray:
        """B K^-1 f - c in metres, this rank's part, shape (3 m,): penetration of the free body, and its slip.

        c is the gap along n, and along t1 and t2 the displacement from which slip counts.
        """
        free = self.relative_displacement(self._free_displacement)
        free[:, 0] -= self.surface.gap
        return free.ravel()

    def relative_displacement(self, u: FloatArray) -> FloatArray:
        """u_n, and slip along t1 and t2, of displacements u (k, 3), metres, shape (m, 3); collective.

        Where supports prescribe slips, those of the size of rounding errors are exactly 0: friction would be along
        them.
        """
        rows = self.surface.rows(u)
        closed = relative_displacement(rows, self.state.slip_origin)
        if not self.surface.slip_prescribed:
            return closed
        size = np.abs(rows).max(axis=1, initial=0.0) + np.abs(self.state.slip_origin).max(axis=1, initial=0.0)
        closed[:, 1:][np.abs(closed[:, 1:]) <= _ROUNDING * size[:, None]] = 0.0
        return closed

    def known_relative_displacement(self, x: FloatArray, alpha: FloatArray) -> FloatArray | None:
        """`relative_displacement` under forces x (3 m,) in newtons, moved by alpha, if it takes no solve with K; None
        otherwise, and where slips are prescribed; collective."""
        if self.surface.slip_prescribed:
            return None
        product = self.A.known_product(x)
        if product is None:
            return None
        closed = self.b - product
        if self.rigid is not None and len(alpha):
            closed += self.rigid.displacement(alpha)
        closed = closed.reshape(-1, 3)
        closed[:, 0] += self.surface.gap
        return closed

    @_OfStiffness
    def mean_compliance(self) -> float:
        """Mean of diag(A) in metres per newton."""
        return self.friction_problem.mean_diagonal

    @_OfStiffness
    def compliances(self) -> FloatArray:
        """diag(A) of every contact point, of both tangents the mean, metres per newton, shape (m, 3)."""
        return self.friction_problem.scales.compliance

    @cached_property
    def rigid(self) -> RigidMotions | None:
        """The motions that contact alone prevents, with the loads along them; None if supports prevent all."""
        return rigid_motions(self.elasticity, self.surface, self.loading)

    def displacement(self, x: FloatArray) -> FloatArray:
        """K^-1 (f - B^T x) in metres, before free motions, this rank's nodes, shape (k, 3); x in newtons, shape (3 m,);
        collective."""
        free_u = self.elasticity.reduced(self._free_displacement, self.loading)
        u = self._with_prescribed(self.A.displacement(x, self.f, free_u.ravel()).reshape(-1, 3))
        free = self.A.matrix_free
        if free is not None and free.found:
            return u
        return iteratively_refined(
            self.elasticity, self.stiffness.solver, self.loading, -self.nodal_contact_force(x), u
        )

    def moved(self, u: FloatArray, alpha: FloatArray) -> FloatArray:
        """u + R alpha, amounts alpha (q,) of the free motions; metres, shapes (k, 3)."""
        return u + self.elasticity.free_part(self.elasticity.free_unknowns @ alpha) if len(alpha) else u

    @_OfStiffness
    def _free_displacement(self) -> FloatArray:
        """K^-1 f in metres, this rank's nodes, shape (k, 3): the displacement without contact."""
        solver = self.stiffness.solver

        def solved() -> FloatArray:
            u = self.elasticity.K.createVecRight()
            with (
                suppress(CGNotConverged),
                explained(self.elasticity),
            ):  # with products by A its errors cancel (`under_load`)
                solver.solve(self.f, u, _BEFORE_REFINEMENT if solver.tolerance > 0.0 else 0.0)
            values = self._with_prescribed(u.array.reshape(-1, 3))
            u.destroy()
            if solver.tolerance > 0.0:  # errors of a factorised K cancel with those of A, from the same factors
                values = iteratively_refined(self.elasticity, solver, self.loading, np.zeros_like(values), values)
            return values

        with timed(self.seconds, "displacement"):
            return self.stiffness.responses.response(self.f.array_r, self.loading.prescribed, solved)

    def _with_prescribed(self, u: FloatArray) -> FloatArray:
        """The displacement (k, 3) of unknowns u (k + p, 3), with exactly the prescribed displacements, which a solver
        holds to its tolerance only."""
        return self.elasticity.free_part(u) + self.loading.prescribed

    def nodal_contact_force(self, x: FloatArray) -> FloatArray:
        """B^T x in newtons, this rank's nodes, shape (k, 3): minus the force on the body; collective."""
        return self.surface.at_nodes(x)

    def refuse_held_inside(self, times: Sequence[float] = ()) -> None:
        """Refuse supports that hold nodes of contact faces inside foundations now, or at other times; ValueError on
        every rank, with face, number of nodes and depth; collective."""
        given = [(self.elasticity, self.loading)]
        if times:
            bodies = map(self.body.elasticity.at_time, times)
            given = [(one, one.at(time)) for one, time in zip(bodies, times, strict=True)]
        for one, loading in given:
            self.body.refuse_held_inside(one, loading)

    def evidence(self, x: FloatArray, u: FloatArray, before: Before | None = None) -> Evidence:
        """The evidence for a certificate, from body, contact faces and foundations as given; collective.

        Args:
            x: Contact forces in newtons, shape (3 m,), point by point (n, t1, t2) of the surface.
            u: Displacement in metres, this rank's nodes, shape (k, 3).
            before: State after the load step before; by default slip is measured from `slip_origin`.
        """
        return gather_evidence(self.body, self.state, x, u, self.compliances, before)

    def slip_bound(self, x: FloatArray) -> FloatArray:
        """Bound of the friction force of every node at the forces x (3 m,), newtons, shape (m,)."""
        return self.law.radius(x[0::3])

    @property
    def friction_problem(self) -> FrictionProblem:
        """A, b and the law, without the body."""
        return FrictionProblem(self.A, self.b, self.law, rigid=self.rigid, elastic=True, body=self._bodies)

    @cached_property
    def _bodies(self) -> npt.NDArray[np.int64]:
        """The component of the meshes of every contact point, shape (m,), or its body where these are not known."""
        elasticity = self.elasticity
        members = [member.nodes for member in elasticity.members]
        return components_of(len(elasticity.x), elasticity.component, members)[self.surface.nodes]

    def prepare_products(self) -> None:
        """Let the products by A to come be as accurate as the displacement under load and contact forces is, also where
        soft springs alone hold the body; collective."""
        self.A.under_load(self.f, self.elasticity.reduced(self._free_displacement, self.loading).ravel())

    def tresca(self, slip_bound: FloatArray) -> FrictionProblem:
        """The Tresca problem with these slip bounds in newtons, shape (m,)."""
        posed = FrictionProblem.tresca(self.A, self.b, slip_bound)
        return replace(posed, rigid=self.rigid, elastic=True, body=self._bodies)


class LinearSolveFailed(NotConverged):
    """K u = f is not solved by multigrid: smaller load steps do not help."""


class CountedProgress:
    """The user's callback, if there is one, with the number of `steps` and whether it has `stopped` the solve, on any
    rank; a callback that fails on one rank ends the solve on all."""

    def __init__(self, progress: ProgressCallback | None, comm: MPI.Comm):
        self._progress, self._comm, self.steps, self.stopped = progress, comm, 0, False

    def __call__(self, progress: Progress) -> bool:
        self.steps += 1
        call = self._progress
        asked = on_every_rank(lambda: call is not None and bool(call(progress)), "progress", self._comm)
        self.stopped = any(asked)
        return self.stopped


def linear_solve_failed(
    posed: DiscreteProblem, problem: FrictionProblem, failure: CGNotConverged, progress: CountedProgress, method: str
) -> LinearSolveFailed:
    """The error of a contact problem in which a solve with K failed, with the last iterate; collective."""
    A, rigid = problem.A.matrix_free, NO_MOTION if problem.rigid is None else np.zeros(problem.rigid.count)
    x, gradient, residual = np.zeros_like(problem.b), -problem.b, np.inf
    if A is not None and Reductions(posed.comm).all(A.latest is not None) and A.latest is not None:
        x, gradient = problem.completed(A.latest), A.latest_product() - problem.b
        if problem.rigid is not None:
            rigid = problem.rigid_motion(x, gradient)
            gradient = gradient - problem.rigid.displacement(rigid)
        residual = problem.residual(x, gradient)
    remedies = ['K factorised (linear_solver = "direct")', "better-shaped cells"]
    if posed.elasticity.ground is not None:
        remedies.append("stiffer springs, or a clamp, against rigid motions")
    reached = f", with a residual of {residual:.1e}" if np.isfinite(residual) else ""
    message = (
        f"{failure}; {posed.unknowns['displacement']} displacement unknowns, time {posed.time:g} s, after "
        f"{progress.steps} steps of the contact solver{reached}"
    )
    result = SolverResult(
        x=x,
        gradient=gradient,
        slip_bound=problem.slip_bound(x),
        multipliers=np.zeros((problem.A.nodes, 2)),
        status=Status.INTERRUPTED if progress.stopped else Status.STAGNATED,
        outer_steps=0,
        newton_steps=progress.steps,
        products=problem.A.products,
        residual=residual,
        history=(),
        method=method,
        message=message,
        rigid=rigid,
    )
    return LinearSolveFailed(f"{message}; what may help: {', or '.join(remedies)}", result)
