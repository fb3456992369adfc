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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Deformable
from ..fem.contact import ContactSurface
from ..linalg.factors import NotPositiveDefinite
from ..linalg.unsolved import Unsolved
from ..model.certificate import Certificate, judge
from ..model.contact import Contact
from ..model.load_history import LoadHistory
from ..model.nodal_answer import NodalAnswer
from ..model.problem import ContactProblem
from ..model.small_strain import SmallStrain
from ..model.solution import Solution
from ..solvers.results import NotConverged
from .iterate import Iterate, fineness, linearised, nonlinear
from .slip import FaceMotion

_log = logging.getLogger(__name__)

_MOST = 25
"""Largest number of linear problems in a load step."""

_BACKTRACKS = 8
"""Largest number of halvings of a change of the displacement."""

_WORSE = 10.0
"""A residual may grow by this factor from one linear problem to the next: the first ones of a load step do not know
where contact is."""

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
            replace(one, slave=True) if foundation is None else replace(one, foundation=foundation, facing=False)
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
        start = self._iterate(state.displacement, state.time, state, None).start()
        here = self._iterate(state.displacement, time, state, start)
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

    def _solved(self, here: Iterate, x: FloatArray, tolerance: float) -> Solution:
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

    def _moved(self, here: Iterate, du: FloatArray, state: LargeState, start: FaceMotion) -> Iterate | None:
        """The iterate after a change of the displacement; None if it turns an element inside out."""
        u = here.u + du
        ratios = [nonlinear(one.body).least_volume_ratio(u[one.nodes]) for one in self.body.members]
        if not np.min(ratios) > 0.0:
            return None
        return self._iterate(u, here.time, state, start)

    def _iterate(self, u: FloatArray, time: float, state: LargeState, start: FaceMotion | None) -> Iterate:
        return Iterate(self.body, self.contacts, self.linear_solver, u, time, state.slip_rate, start)
