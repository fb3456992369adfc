"""Large motions: Newton's method around the contact problem of small displacements, by load steps.

At a displacement u the tangent, the residual, and frames, gaps and weights at the deformed place pose a linear contact
problem of du with Coulomb's law, which is solved as every other.  Its forces x are the next ones, and u + du the next
displacement (a sequential quadratic method: contact and friction are exact in every linear problem, nothing is
regularised).  Slip is measured from the start of the load step (`FaceMotion`).

The answer is certified at the deformed place: residual assembled anew, gaps, frames and slip found anew from faces and
foundations.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.bodies import Deformable, JoinedBodies, rigid_modes
from ..fem.contact import ContactSurface, face_samples
from ..fem.geometry import RigidFoundation, moved
from ..linalg.factors import NotPositiveDefinite
from ..linalg.reductions import Reductions
from ..linalg.unsolved import Unsolved
from ..model.certificate import Certificate, judge
from ..model.contact import Contact
from ..model.contact_body import Before
from ..model.evidence import Evidence, rounding_forces
from ..model.load_history import LoadHistory
from ..model.nodal_answer import NodalAnswer
from ..model.problem import ContactProblem
from ..model.problem_evidence import gather_evidence
from ..model.small_strain import SmallStrain, small_strain
from ..model.solution import Solution
from ..solvers.results import NotConverged
from .nonlinear_body import NonlinearBody
from .slip import FaceMotion, at_start

_log = logging.getLogger(__name__)

_MOST = 25
"""Largest number of linear problems in a load step."""

_BACKTRACKS = 8
"""Largest number of halvings of a change of the displacement."""

_WORSE = 10.0
"""A residual may grow by this factor from one linear problem to the next: the first ones of a load step do not know
where contact is."""

_STIFFER = 10.0
"""Stiffness of the springs of `supported` over the mean diagonal of K at their nodes."""

_STICKS = 1.0 - 1e-6
"""Friction over its bound below which a node sticks."""

_DIFFERENCE = 1e-4
"""Step of the differences of normals over the size of a face."""

_ALMOST = 1.001
"""A step that ends this near to the end of one of the history ends there."""

_OPPOSITE = 1e-6
"""One more than the cosine of the angle of two normals, at least: forces are not carried between opposite ones."""


class StepCut(Exception):
    """A load step has no answer: why, in words."""


@dataclass(frozen=True)
class LargeSolution:
    """An equilibrium of large motions.

    Attributes:
        time: In seconds.
        displacement: In metres, this rank's nodes, shape (k, 3).
        contact_force: In newtons along the deformed frames, this rank's contact points, shape (3 m,).
        certificate: Of the nonlinear problem at the deformed place.
        residuals: Largest value of the certificate's checks before each linear problem, and at the end.
        linear: The last linear problem and its answer.
        facets: Whether the facets in contact are fine enough: `between` and `chord`; the other measures are of small
            strains, and 0.
    """

    time: float
    displacement: FloatArray
    contact_force: FloatArray
    certificate: Certificate
    residuals: tuple[float, ...]
    linear: Solution
    facets: SmallStrain

    @property
    def outer_iterations(self) -> int:
        """Number of linear problems."""
        return len(self.residuals) - 1

    @property
    def outside(self) -> tuple[str, ...]:
        """Why facets are too coarse for an answer, as messages; empty if they are not."""
        return self.facets.violations

    @property
    def valid(self) -> bool:
        """Whether the certificate passed, and the facets in contact are fine enough."""
        return self.certificate.passed and not self.outside

    @property
    def at_nodes(self) -> NodalAnswer:
        """Fields, totals and counts at this rank's contact points, at their deformed places: slip is that of the
        step."""
        return self.linear.at_nodes

    @property
    def force_on_body(self) -> FloatArray:
        """Contact forces on the body at this rank's contact points, space vectors in newtons, shape (m, 3)."""
        return self.linear.force_on_body

    @property
    def functions(self) -> dict[str, Any]:
        """The displacement of each body by its name, as DOLFINx Functions; "" is the name of the only body."""
        members = self.linear.problem.elasticity.members
        return {one.name: one.body.function(self.displacement[one.nodes]) for one in members}


@dataclass(frozen=True)
class CarriedForces:
    """Contact forces, space vectors in newtons, and the normals of their places, at this rank's nodes, shapes (k, 3); 0
    at nodes without."""

    vectors: FloatArray
    normals: FloatArray

    @classmethod
    def of(cls, x: FloatArray, surface: ContactSurface, nodes: int) -> CarriedForces:
        """Of forces x (3 m,) at the contact points of a surface, of so many nodes."""
        vectors, normals = np.zeros((2, nodes, 3))
        vectors[surface.nodes], normals[surface.nodes] = surface.vectors(x.reshape(-1, 3)), surface.frames[:, 0]
        return cls(vectors, normals)

    def at(self, surface: ContactSurface) -> FloatArray:
        """Along the frames of a surface, turned as its normals have (parallel transport), shape (3 m,)."""
        f, n, m = self.vectors[surface.nodes], self.normals[surface.nodes], surface.frames[:, 0]
        axis, cosine = np.cross(n, m), np.einsum("ki,ki->k", n, m)[:, None]
        along = np.einsum("ki,ki->k", axis, f)[:, None] / np.maximum(1.0 + cosine, _OPPOSITE)
        x: FloatArray = surface.force_components(cosine * f + np.cross(axis, f) + along * axis).ravel()
        return x


@dataclass(frozen=True)
class LargeState:
    """The end of a load step, from which the next begins: time, displacement (k, 3), contact forces, and slip rates of
    the contact nodes, 0 at others, in m/s, shape (k,)."""

    time: float
    displacement: FloatArray
    force: CarriedForces
    slip_rate: FloatArray


@dataclass(frozen=True)
class LargeStep:
    """A completed load step: its answer, the state after it, and how often its interval was halved."""

    solution: LargeSolution
    state: LargeState
    halvings: int


class _Linearised(ContactProblem):
    """The contact problem of changes du of a displacement u; judged by the scales of u + du."""

    silent = True

    def evidence(self, x: FloatArray, u: FloatArray, before: Before | None = None) -> Evidence:
        return self.evidence_at(x, u, self.mean_compliance)

    def evidence_at(self, x: FloatArray, du: FloatArray, compliance: float) -> Evidence:
        """The evidence for forces x (3 m,) and a change du (k, 3), with the residual F(u) + dF(u) du: for du = 0 that
        of the nonlinear problem.  `compliance` is the mean diagonal of A; collective."""
        e, body = gather_evidence(self.body, self.state, x, du, compliance, None), self.elasticity
        here, over = place_of(body), Reductions(self.comm)
        residual = e.internal - e.load
        load, rigid = balanced_load(body, residual, over), rigid_part(body, here, over)
        return replace(
            e,
            displacement=here + du - rigid,
            internal=residual + load,
            load=load,
            prescribed=body.held_part(here - rigid) + e.prescribed,
            ground=None,
            rounding=rounding_forces(body, here + du),
        )


def curvature(foundation: RigidFoundation, x: FloatArray) -> FloatArray:
    """Second derivatives of the signed distance at points x (k, 3), 1/m, shape (k, 3, 3), by central differences."""
    h = _DIFFERENCE * float(np.max(np.ptp(x, axis=0), initial=0.0)) or _DIFFERENCE
    columns = [(foundation.normal(x + h * e) - foundation.normal(x - h * e)) / (2.0 * h) for e in np.eye(3)]
    bent: FloatArray = np.stack(columns, axis=2)
    return 0.5 * (bent + bent.transpose(0, 2, 1))


def place_of(body: Deformable) -> FloatArray:
    """The displacement from which bodies are linearised, metres, shape (k, 3)."""
    u: FloatArray = np.concatenate([nonlinear(one.body).place.u for one in body.members])
    return u


class _Iterate:
    """A displacement in a load step, with the linear contact problem of the changes from there.

    Args:
        motions: The problem.
        u: Displacement in metres, shape (k, 3).
        time: Of the end of the step.
        state: The start of the step.
        start: The faces then; None where this is the start.
    """

    def __init__(self, motions: LargeMotions, u: FloatArray, time: float, state: LargeState, start: FaceMotion | None):
        self.u, self.time, self.state, self._start = u, time, state, start
        self._motions = motions
        self.pose(linearised(motions.body, u, time))

    def pose(self, body: Deformable) -> None:
        """The linear problem of these bodies; collective."""
        state, start, motions = self.state, self._start, self._motions
        posed = _Linearised(body, motions.contacts, time=self.time, linear_solver=motions.linear_solver)
        there, foundations = posed.state, posed.body.foundations
        then = replace(there, slip_rate=state.slip_rate[there.surface.nodes])
        if start is not None:
            slip = start.slip(body, there.surface, there.rigid_motions, foundations)
            then = replace(then, slip_origin=-there.surface.components(slip))
        self.body, self.problem, self.foundations = body, posed.in_state(then), foundations

    def tangent(self, body: Deformable, x: FloatArray) -> Deformable:
        """The bodies with the change of normal forces x (3 m,) as normals turn on curved foundations: -x_n times the
        second derivative of the signed distance, which is symmetric; that of friction, which is not, is left out."""
        stiffness = self._geometric(x)
        none = np.zeros_like(body.x)
        curved = Reductions(body.comm).all(not np.any(stiffness))
        return body if curved else each(body, lambda one, nodes: one.on_springs(stiffness[nodes], none[nodes]))

    def _geometric(self, x: FloatArray) -> FloatArray:
        surface, state = self.problem.surface, self.problem.state
        stiffness = np.zeros((len(self.u), 3, 3))
        if not surface.points.nodal:
            return stiffness
        for part, (foundation, motion) in enumerate(zip(self.foundations, state.rigid_motions, strict=True)):
            here = (surface.part == part) & (x[0::3] > 0.0)
            if foundation is not None and np.any(here):
                bent = curvature(moved(foundation, motion), surface.x[here])
                stiffness[surface.nodes[here]] = -x[0::3][here, None, None] * bent
        return stiffness

    def supported(self, body: Deformable, x: FloatArray) -> Deformable:
        """The bodies on springs at the nodes that press on foundations with forces x (3 m,), along normals, and along
        tangents where they stick, relaxed where the gap is closed and nothing has slipped.

        What contact holds may be unstable without it.  Where the contact conditions hold as equations springs change
        nothing, and with stiff ones K is positive definite if the body is stable on them (Finsler's lemma).
        """
        surface, state, problem = self.problem.surface, self.problem.state, self.problem
        stiffness, force = self._geometric(x), np.zeros_like(body.x)
        if surface.points.nodal:
            x = x.reshape(-1, 3)
            on_foundation = np.array([one is not None for one in self.foundations])[surface.part]
            pressing = on_foundation & (x[:, 0] > 0.0)
            sticks = pressing & (np.linalg.norm(x[:, 1:], axis=1) < _STICKS * problem.slip_bound(x.ravel()))
            which = np.column_stack([pressing, sticks, sticks]).astype(np.float64)
            lengths = np.linalg.norm(surface.frames, axis=2)
            G = surface.frames / lengths[:, :, None]
            target = np.column_stack([surface.gap, state.slip_origin[:, 1:] / lengths[:, 1:]])
            diagonal = body.K.getDiagonal()
            size = _STIFFER * diagonal.array_r.reshape(-1, 3).mean(axis=1)[surface.nodes]
            diagonal.destroy()
            stiffness[surface.nodes] += np.einsum("k,kr,kri,krj->kij", size, which, G, G)
            force[surface.nodes] = np.einsum("k,kr,kri->ki", size, which * target, G)
        return each(body, lambda one, nodes: one.on_springs(stiffness[nodes], force[nodes]))

    def made_positive(self, body: Deformable, x: FloatArray) -> Deformable:
        """The bodies with the nearest tangent that is positive semidefinite in every cell."""
        return each(body, lambda one, nodes: one.made_positive())

    def start(self) -> FaceMotion:
        state = self.problem.state
        return at_start(self.body, state.surface, state.rigid_motions, self.foundations)


@dataclass
class _Deformed:
    """A body at its deformed place x (k, 3), with its internal forces there (k, 3), as of `small_strain`."""

    comm: MPI.Comm
    x: FloatArray
    internal: FloatArray

    def internal_force(self, u: FloatArray) -> FloatArray:
        return self.internal

    def largest_gradient(self, u: FloatArray) -> float:
        return 0.0


def fineness(answer: Solution, e: Evidence) -> SmallStrain:
    """`LargeSolution.facets` of an answer without further displacement, by its evidence; collective."""
    surface, body = answer.problem.surface, answer.problem.elasticity
    members = [body.face(face, "contact") for face in surface.faces]
    faces = [face_samples(one.body, facets, answer.displacement[one.nodes]) for one, facets in members]
    deformed = _Deformed(e.comm, e.x, e.internal)
    return small_strain(answer.at_nodes, surface.foundations, deformed, e.displacement, faces)


def balanced_load(body: Deformable, residual: FloatArray, over: Reductions) -> FloatArray:
    """Nodal forces with the resultants of the loads in a residual F(u; v), (k, 3), in newtons: internal forces have
    none in any motion of a component as a whole; collective."""
    load = np.zeros_like(residual)
    for here in components(body, over):
        modes = rigid_modes(body.x[here], body.comm).reshape(-1, 6)
        gram = over.total((modes.T @ modes).ravel()).reshape(6, 6)
        sums = over.total(modes.T @ residual[here].ravel())
        load[here] = -(modes @ np.linalg.solve(gram, sums)).reshape(-1, 3)
    return load


def rigid_part(body: Deformable, u: FloatArray, over: Reductions) -> FloatArray:
    """The displacement (k, 3) of the rigid motions, with finite rotations, that are nearest to a displacement u (k, 3)
    of bodies at their deformed place (Kabsch 1976): without it the work of internal forces along a displacement does
    not depend on how far a body has turned; collective."""
    rigid = np.zeros_like(u)
    for here in components(body, over):
        x, y = body.x[here] - u[here], body.x[here]
        count = over.sum(float(len(x)))
        from_, to = over.total(x.sum(axis=0)) / count, over.total(y.sum(axis=0)) / count
        left, _, right = np.linalg.svd(over.total(((x - from_).T @ (y - to)).ravel()).reshape(3, 3))
        turn = right.T @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ left.T
        rigid[here] = to + (x - from_) @ turn.T - x
    return rigid


def components(body: Deformable, over: Reductions) -> Iterator[npt.NDArray[np.bool_]]:
    """The nodes of each component of the bodies, shapes (k,); collective."""
    component = body.free.component
    for number in range(1 + int(over.max(component.astype(np.float64)))):
        yield component == number


def linearised(body: Deformable, u: FloatArray, time: float) -> Deformable:
    """The bodies of small displacements from u (k, 3) at a time; collective."""
    return each(body, lambda one, nodes: one.linearised(u[nodes], time))


def each(body: Deformable, change: Callable[[NonlinearBody, slice], NonlinearBody]) -> Deformable:
    """The same bodies, each changed; the change is given its nodes."""
    changed = {one.name: change(nonlinear(one.body), one.nodes) for one in body.members}
    return JoinedBodies(changed) if isinstance(body, JoinedBodies) else next(iter(changed.values()))


def nonlinear(body: Deformable) -> NonlinearBody:
    """A body as one of large displacements; ValueError if it is none."""
    if not isinstance(body, NonlinearBody):
        raise ValueError(f"large motions need NonlinearBody, or several joined, but there is a {type(body).__name__}")
    return body


def size_of(certificate: Certificate) -> float:
    """The largest value of the checks, but of the angle; inf if one is not finite."""
    values = [check.value for check in certificate.checks if check.unit == ""]
    return float(np.max(values)) if np.all(np.isfinite(values)) else np.inf


class LargeMotions:
    """Bodies of large displacements in frictional contact with each other and with rigid foundations.

    Args:
        body: A `NonlinearBody`, or several as `coulomb.join` makes them.
        contacts: As of `ContactProblem`.
        linear_solver: As of `ContactProblem`.

    Raises:
        ValueError: On every rank, if the input is invalid.
    """

    def __init__(self, body: Deformable, contacts: Contact | Sequence[Contact], *, linear_solver: Any = None):
        for member in body.members:
            nonlinear(member.body)
        self.body, self.linear_solver = body, linear_solver
        given = (contacts,) if isinstance(contacts, Contact) else tuple(contacts)
        for one in given:
            if callable(one.gap) or one.gap or one.adjust or one.smooth or one.surface or one.against_surface:
                raise ValueError(
                    f"contact face {one.face!r}: gap, adjust, smooth and surface describe the undeformed place; large "
                    "motions measure gaps between the facets as they are"
                )
        posed = ContactProblem(body, given, linear_solver=linear_solver)
        self.contacts: tuple[Contact, ...] = tuple(
            one if foundation is None else replace(one, foundation=foundation, facing=False)
            for one, foundation in zip(posed.body.contacts, posed.body.foundations, strict=True)
        )

    def beginning(self, time: float) -> LargeState:
        """The undeformed state."""
        still = np.zeros_like(self.body.x)
        return LargeState(time, still, CarriedForces(still, still), np.zeros(len(still)))

    def steps(self, history: LoadHistory, state: LargeState | None = None) -> Iterator[LargeStep]:
        """Compute the load steps of a history one by one; a step that fails is halved, and later ones double again;
        collective.

        Raises:
            StepCut: If a step fails that is 2^-halvings of that of the history; the displacement is that of the last
                good step.
        """
        state = state or self.beginning(history.start)
        for goal in history.times:
            step = whole = goal - state.time
            halved = 0
            while state.time < goal:
                time = goal if state.time + _ALMOST * step > goal else state.time + step
                try:
                    solution = self.solve(state, time, history.tolerance)
                except (StepCut, NotConverged, Unsolved, ValueError) as failure:
                    step, halved, why = 0.5 * (time - state.time), halved + 1, str(failure)
                    interval = f"the load step from {state.time:g} s to {time:g} s"
                    if step < whole * 0.5**history.halvings:
                        linearised(self.body, state.displacement, state.time)  # the user's functions are of this state
                        raise StepCut(f"{interval} failed, at the smallest part allowed: {why}") from failure
                    if self.body.comm.rank == 0:
                        _log.warning("%s halved: %s", interval, why)
                    continue
                state = self._after(state, solution)
                yield LargeStep(solution, state, halved)
                step, halved = 2.0 * step, 0

    def _after(self, before: LargeState, solution: LargeSolution) -> LargeState:
        surface = solution.linear.problem.surface
        rate = np.zeros_like(before.slip_rate)
        force = CarriedForces.of(solution.contact_force, surface, len(rate))
        rate[surface.nodes] = np.linalg.norm(solution.at_nodes.slip, axis=1) / (solution.time - before.time)
        return LargeState(solution.time, solution.displacement, force, rate)

    def solve(self, state: LargeState, time: float, tolerance: float = 1e-8) -> LargeSolution:
        """The equilibrium at a time, a load step after a state; collective.

        Raises:
            StepCut: If Newton's method does not find it.
        """
        first = _Iterate(self, state.displacement, state.time, state, None)
        start = first.start()
        here = _Iterate(self, state.displacement, time, state, start)
        x, sizes, found = state.force.at(here.problem.surface), [np.inf], None
        for _ in range(_MOST):
            linear = self._solved(here, x, min(tolerance, 1e-8))
            du, before = linear.displacement, x
            compliance, part = here.problem.mean_compliance, 1.0
            for _ in range(_BACKTRACKS):
                there = self._moved(here, part * du, state, start)
                if there is not None:
                    between = (1.0 - part) * before + part * linear.contact_force
                    x = CarriedForces.of(between, here.problem.surface, len(du)).at(there.problem.surface)
                    evidence = there.problem.evidence_at(x, np.zeros_like(du), compliance)
                    certificate = judge(evidence)
                    size = size_of(certificate)
                    if np.isfinite(size) and size <= _WORSE * sizes[-1]:
                        break
                part *= 0.5
            else:
                raise StepCut("no part of the change of the displacement makes the residual smaller")
            _log.info("outer iteration %d: residual %.2e, part %g", len(sizes), size, part)
            here = there
            sizes.append(size)
            if certificate.passed and (size <= tolerance or (found is not None and size > 0.5 * sizes[-2])):
                break
            found = certificate if certificate.passed else None
        else:
            raise StepCut(f"no equilibrium after {_MOST} linear problems, residual {sizes[-1]:.1e}")
        bound = here.problem.slip_bound(x)
        at = Solution(here.problem, x, np.zeros_like(here.u), bound, linear.result, certificate)
        facets = fineness(at, evidence)
        for text in facets.warnings if self.body.comm.rank == 0 else ():
            _log.warning("at %g s: %s", time, text)
        return LargeSolution(time, here.u, x, certificate, tuple(sizes), at, facets)

    def _solved(self, here: _Iterate, x: FloatArray, tolerance: float) -> Solution:
        """The linear problem; with a positive definite matrix in place of a tangent that is none; collective."""
        given = here.body
        for remedy in (here.tangent, here.supported, here.made_positive):
            body = remedy(given, x)
            if body is not here.body:
                here.pose(body)
            try:
                return here.problem.solve(tolerance, start=x)
            except NotPositiveDefinite as failure:
                _log.info("%s", failure)
        raise StepCut("the tangent is not positive definite even if that of every cell is")

    def _moved(self, here: _Iterate, du: FloatArray, state: LargeState, start: FaceMotion) -> _Iterate | None:
        """The iterate after a change of the displacement; None if it turns an element inside out."""
        u = here.u + du
        ratios = [nonlinear(one.body).least_volume_ratio(u[one.nodes]) for one in self.body.members]
        if not np.min(ratios) > 0.0:
            return None
        return _Iterate(self, u, here.time, state, start)
