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
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import nonlinear
from ..fem.contact import ContactSurface, FaceMotion
from ..linalg.factors import NotPositiveDefinite
from ..linalg.reductions import Reductions
from ..solvers.friction_problem import Solver
from ..solvers.results import NotConverged, ProgressCallback, SolverResult, Status
from .attempts import FAILURES, StepCut, refuse_interrupted, without_answer
from .certificate import LIMIT, Certificate, Evidence, judge, settled_to
from .certificate_scales import place_of_largest
from .discrete_problem import DiscreteProblem
from .equilibrium import refuse_without_equilibrium
from .iterate import CarriedForces, Iterate, Linearised, linearised, turns
from .load_step import ended
from .load_steps import LoadSteps
from .newton_step import Step, newton_step
from .notebook import residuals_shown
from .solution import Solution
from .solving import LinearAnswer, Solving, size_of, together
from .state import Forces, State

_log = logging.getLogger(__name__)

_MOST: Final = 25
"""Largest number of linear problems in a load step."""

_BACKTRACKS: Final = 8
"""Largest number of halvings of a change of the displacement."""

_DAMPINGS: Final = (1e-6, 3.0, 10.0)
"""Least damping over the mean diagonal of K at the nodes, the ratio of each to the next, and the largest."""

_LITTLE: Final = 1.0
"""The largest damping with which steps converge as they are: bodies that contact alone holds turn against their stress,
and where other bodies hold them no springs stand for contact."""

_PERTURBED: Final = (1.0, 3.0, 0.3)
"""Amplitudes of the mode of an unstable answer over its largest displacement, one after the other."""

_FAR: Final = 1e6
"""Largest displacement over the size of the bodies."""

_WORSE: Final = 10.0
"""A residual may grow by this factor from one linear problem to the next: the first do not know where contact is."""

_CLOSER: Final = 0.1
"""Part of the tolerance to which linear problems are solved from a certified iterate, judged contact by contact."""

_NEAR: Final = 0.01
"""Residual below which Newton steps are exact wherever tangents have damping, or the positive parts of cells, which
left iterates of pressed 27-node hexahedra with factors of 0.3 to 0.6."""

_NEARLY: Final = 0.3
"""Part of the tolerance to which what exact Newton steps leave out may be, that others have a part, too."""

_Solve = Callable[[Linearised, FloatArray, bool], LinearAnswer]
"""Solves a linear problem, starting from forces (3 m,); closer where an iterate is certified."""


def _largest(left: tuple[Evidence, ContactSurface] | None) -> str:
    """The largest check of an iterate in words, and where forces are most out of balance; collective."""
    if left is None:
        return ": each turns an element inside out, or bodies are flung away"
    e, surface = left
    check = max((one for one in judge(e).checks if one.limit == LIMIT), key=lambda one: np.nan_to_num(one.value))
    words = f": {check.name} {check.value:.1e} ({check.meaning})"
    if check.name.startswith("pair "):  # with its own place
        return words
    part = np.full(len(e.x), -1)
    part[surface.nodes] = surface.part
    forces = np.linalg.norm(e.held.free_part(e.internal - e.load - e.spring - e.on_body), axis=1)
    place = place_of_largest(forces, e.x, part, surface.faces, Reductions(e.comm))
    return f"{words}, forces are most out of balance {place}"


class LoadStepLoop:
    """A load step of large motions, by Newton's method around linear contact problems.

    Args:
        posed: The problem at the end of the step, with the state `before`.
        shared: What it shares with the other load steps.
        start: The displacement at its beginning (k, 3), by default that of the state.
    """

    def __init__(self, posed: DiscreteProblem, shared: LoadSteps, start: FloatArray | None = None):
        self.posed, self.shared = posed, shared
        if start is None:
            start = np.zeros_like(shared.elasticity.x) if posed.before is None else posed.before.displacement
        self.elasticity, self._undeformed = shared.sided(start)
        self.comm, self.time = posed.comm, posed.time
        self._definite = False  # the last tangent was positive definite without contact
        self._consistent = True  # the last tangent was that of the bodies, or with springs that stand for contact
        self._damped = shared.damped
        self._failed = ""  # why a linear problem had no answer
        self._start: tuple[State, FaceMotion] | None = None  # of the last state at another place

    def solve(self, tolerance: float, solver: Solver | None, progress: ProgressCallback | None) -> Solution:
        """The equilibrium at the end of the load step, or in one step from the undeformed place; arguments as of
        `ContactProblem.solve`, for every linear problem; collective.

        Raises:
            StepCut: If Newton's method does not find it.
            NotConverged: If it was interrupted.
        """
        state, count = self._state, len(self.shared.points.nodes)

        def solve(problem: Linearised, x: FloatArray, closer: bool) -> LinearAnswer:
            within = min(tolerance, 1e-8) * (_CLOSER if closer else 1.0)
            refuse_without_equilibrium(problem)
            with residuals_shown(progress, within, self.comm.rank) as shown:
                return Solving(within, solver, shown).on_the_way(problem, x)

        try:
            answer = self._whole_step(state, state.displacement, tolerance, solve)
            if self.shared.stable:
                answer = self._on_stable_branch(answer, state, tolerance, solve)
        except FAILURES as failure:
            linearised(self.elasticity, state.displacement, state.time)  # the user's functions are of that state
            result = failure.result if isinstance(failure, NotConverged) else without_answer(count)
            if result.status is Status.INTERRUPTED:
                raise
            raise StepCut(f"{self._reasons(state)}{failure}", result) from failure
        warnings = answer.small_strain.warnings
        for text in warnings if self.comm.rank == 0 else ():
            _log.warning("at %g s: %s", self.time, text)
        return answer

    @property
    def _state(self) -> State:
        """The state from which the step begins."""
        if self.posed.before is not None:
            return self.posed.before
        self.elasticity.refuse_beginning(self.time)
        return State.beginning(self.time, len(self.elasticity.x), len(self.shared.points.nodes))

    def _on_stable_branch(self, answer: Solution, state: State, tolerance: float, solve: _Solve) -> Solution:
        """From an unstable answer along its mode, to either side, to one that is unstable in fewer directions, until it
        is stable: a column that may buckle to any side is led to one that its mesh prefers."""
        stable = answer.stability
        if stable is None or not stable.unstable:
            return answer
        size, self._damped = Reductions(self.comm).max(np.linalg.norm(answer.displacement, axis=1)), True
        for part, side in product(_PERTURBED, (1.0, -1.0)):
            start = answer.displacement + side * part * size * stable.mode
            try:
                other = self._whole_step(state, start, tolerance, solve)
            except FAILURES as failure:
                refuse_interrupted(failure)
                _log.debug("along the mode by %g: %s", side * part * size, failure)
                continue
            if other.stability is not None and other.stability.unstable < stable.unstable:
                return self._on_stable_branch(other, state, tolerance, solve)
        raise self._cut(
            f"its equilibrium is unstable in {stable.unstable} directions, and none that is stable was found along the "
            "mode: the body snaps far away"
        )

    def _whole_step(self, state: State, u: FloatArray, tolerance: float, solve: _Solve) -> Solution:
        """Of bodies that slide on each other, with bolts, or under loads that follow their surface, by exact Newton
        steps, and if these fail, by those of the linear problems alone: else these converge fast enough with the
        tangents of the bodies."""
        pairs = any(contact.against for contact in self.shared.contacts)
        followed = any(nonlinear(member.body).follows for member in self.elasticity.members)
        if pairs or followed or self.elasticity.constraints.bolts:
            try:
                begin = self._ahead(state, u) if pairs else self._turned(state, u)
                return self._solved_from(state, begin, tolerance, solve, exact=True)
            except FAILURES as failure:
                refuse_interrupted(failure)
                _log.debug("with exact Newton steps: %s", failure)
        return self._solved_from(state, self._turned(state, u), tolerance, solve, exact=False)

    def _turned(self, state: State, u: FloatArray) -> FloatArray:
        """Where a step begins in which bodies are turned as a whole: with these turned, metres, (k, 3); collective."""
        bodies, over = self.elasticity, Reductions(self.comm)

        def off(u: FloatArray) -> float:
            ways = [one.prescribed(bodies.reference + u, self.time, self.comm) for one in bodies.constraints.motions]
            prescribed = bodies.at_time(self.time).at(self.time).prescribed
            return over.max(np.abs([bodies.held_at(self.time).held_part(u) - prescribed, *ways]).ravel())

        for member in bodies.members:
            for turn in turns(bodies, member, state.time, self.time):
                there, X = u.copy(), bodies.reference[member.nodes]
                there[member.nodes] = turn.point + (X + u[member.nodes] - turn.point) @ turn.matrix.T - X
                u = there if off(there) < 0.5 * off(u) else u
        return u

    def _ahead(self, state: State, u: FloatArray) -> FloatArray:
        """Where a step begins that goes on as the one before, metres, (k, 3): nodes of faces that slide are then before
        the right facets; u if there is none, or u is elsewhere."""
        earlier = state.before
        if earlier is None or u is not state.displacement or not state.time > earlier.time:
            return u
        ahead = u + (self.time - state.time) / (state.time - earlier.time) * (u - earlier.displacement)
        ratios = [nonlinear(member.body).least_volume_ratio(ahead[member.nodes]) for member in self.elasticity.members]
        return ahead if np.min(ratios) > 0.0 else u

    def _solved_from(self, state: State, u: FloatArray, tolerance: float, solve: _Solve, exact: bool) -> Solution:
        """The answer of a step from a state, by iterates that begin at a displacement u (k, 3); by exact Newton steps
        (`newton_step`), or those of the linear problems."""
        begin = self._begun(state)
        start = begin.start()
        self._start = state, start
        here = self._iterate(state, u, self.time, start, state.poses)
        points = self.shared.points
        x, sizes, found = self._carried(state, begin).at(here.problem.surface, points), [np.inf], False
        refused = False  # the iterate before, by lines from face to face alone
        worst: tuple[Evidence, ContactSurface] | None = None
        self._failed = ""

        def ends(certificate: Certificate) -> bool:
            """Whether an iterate of this certificate, the last of the sizes, is the answer."""
            return certificate.passed and (sizes[-1] <= tolerance or (found and sizes[-1] > 0.5 * max(sizes[-3:-1])))

        results = list[SolverResult]()
        for _ in range(_MOST):
            posed = here.problem
            linear = self._linear(here, x, solve, found)
            results.append(linear.result)
            surface = here.problem.surface
            whole_way = Step(linear.displacement, linear.contact_force, linear.result.rigid)
            before = CarriedForces.of(x, surface, points)
            known = np.zeros((len(points.nodes), 3))
            known[points.places(surface)] = here.problem.compliances
            ways = [(whole_way, 0.5**k) for k in range(_BACKTRACKS)]
            if exact or (sizes[-1] < _NEAR and not self._consistent):
                here.problem.iterate = self._elsewhere
                if step := newton_step(here.problem, posed, here.u, whole_way, sizes[-1], _NEARLY * tolerance):
                    ways.insert(0, (step, 1.0))
            for way, part in ways:
                poses = here.problem.state.poses_after(part * way.rigid)
                there = self._moved(here, part * way.displacement, state, start, poses)
                if there is not None:
                    after = CarriedForces.of(way.contact_force, surface, points)
                    between = (1.0 - part) * before.vectors + part * after.vectors
                    x = replace(after, vectors=between).at(there.problem.surface, points)
                    if way is not whole_way:  # back into the cone
                        x = there.problem.law.project(x, x[0::3])
                    at_points = known[points.places(there.problem.surface)]
                    evidence = there.problem.evidence_here(x, at_points, by_lines=False)
                    certificate = judge(evidence)
                    size, worst = size_of(certificate), (evidence, there.problem.surface)
                    if np.isfinite(size) and size <= _WORSE * sizes[-1]:
                        break
            else:
                raise self._cut(
                    f"no part of the change of the displacement makes the residual smaller{_largest(worst)}"
                )
            _log.debug("outer iteration %d: residual %.2e, part %g", len(sizes), size, part)
            self._count(here)
            here = there
            sizes.append(size)
            if ends(certificate):  # lines from face to face take as long as a linear problem
                evidence = here.problem.evidence_here(x, at_points)
                certificate = judge(evidence)
                sizes[-1], worst = size_of(certificate), (evidence, here.problem.surface)
                if ends(certificate):
                    break
                if refused:
                    raise self._cut(f"forces and contact agree, but faces do not{_largest(worst)}")
                refused = not certificate.passed
            else:
                refused = False
            found = certificate.passed
        else:
            raise self._cut(f"no equilibrium after {_MOST} linear problems{_largest(worst)}")
        reached = results[-1].status if sizes[-1] <= tolerance else Status.STAGNATED
        whole = replace(together(results), x=x, status=reached, residual=certificate["natural residual"].value)
        evidence, certificate = settled_to(evidence, certificate, whole.unsettled)
        methods = {**linear.methods, "kinematics": "large", "linear_problems": len(sizes) - 1}
        methods |= {"definite": True} if self._definite else {}
        self.shared.answered = self.elasticity, here
        answer = self._answer(here, x, whole, evidence, certificate, at_points, methods, tuple(sizes))
        if (passage := self.shared.passage(begin, here, state.force_on_body, x)) and answer.valid:
            raise self._cut(passage)
        return answer

    def solution(self, result: SolverResult) -> Solution:
        """The state before a step that has failed, judged with the loads of its end; collective."""
        state = self._state
        begin, here = self._unmoved(state)
        surface, diagonal = here.problem.surface, here.body.K.getDiagonal()
        x = self._carried(state, begin).at(surface, self.shared.points)
        compliance = diagonal.getSize() / abs(diagonal.sum())  # of the order of that of A, which may not exist
        diagonal.destroy()
        return self.judged(here, x, replace(result, x=x), np.full((len(surface.nodes), 3), compliance))

    def _unmoved(self, state: State) -> tuple[Iterate, Iterate]:
        """The iterate at the start of a step, and one at the same displacement with what is given at its end."""
        begin = self._begun(state)
        return begin, self._iterate(state, state.displacement, self.time, begin.start(), state.poses)

    def _reasons(self, state: State) -> str:
        """`LoadSteps.reasons`; "" where even those are not known, as where normals cancel; collective."""
        try:
            begin, end = self._unmoved(state)
            x = self._carried(state, begin).at(end.problem.surface, self.shared.points)
            return self.shared.reasons(state, begin, end, x)
        except FAILURES:
            return ""

    def recomputed(
        self,
        displacement: FloatArray,
        force_on_body: FloatArray,
        compliance: FloatArray,
        unsettled: float | None,
        poses: FloatArray | None,
    ) -> Solution:
        """What a displacement (k, 3) and contact forces at the points of states are as an answer of the load step,
        judged with this diagonal of A, at these points as well, all of shape (m, 3), `SolverResult.unsettled`, and the
        `ContactState.poses` of foundations under load; collective."""
        state = self._state
        here = self._elsewhere(displacement, poses, state)
        surface = here.problem.surface
        places = self.shared.points.places(surface)
        x = -surface.force_components(force_on_body[places]).ravel()
        return self.judged(here, x, replace(without_answer(len(places)), unsettled=unsettled), compliance[places])

    def judged(self, here: Iterate, x: FloatArray, result: SolverResult, compliance: FloatArray) -> Solution:
        """The answer of forces x (3 m,) at an iterate, judged by diag(A) there (m, 3); collective."""
        evidence = here.problem.evidence_here(x, compliance)
        evidence, certificate = settled_to(evidence, judge(evidence), result.unsettled)
        return self._answer(here, x, result, evidence, certificate, compliance, {}, ())

    def _answer(
        self,
        here: Iterate,
        x: FloatArray,
        result: SolverResult,
        evidence: Evidence,
        certificate: Certificate,
        compliance: FloatArray,
        methods: dict[str, Any],
        sizes: tuple[float, ...],
    ) -> Solution:
        problem, bound, posed = here.problem, here.problem.slip_bound(x), self.posed
        self._count(here)
        problem.seconds, problem.started, problem.small_strain = posed.seconds, posed.started, posed.small_strain
        problem.iterate = self._elsewhere
        over, own = Reductions(self.comm), evidence.compliance
        mean = over.sum(own) / max(over.sum(float(own.size)), 1.0)
        judged = evidence, compliance, mean, methods, sizes
        return Solution(problem, x, here.u, bound, result, certificate, *judged)

    def _count(self, here: Iterate) -> None:
        for name, seconds in here.problem.seconds.items():
            self.posed.seconds[name] = self.posed.seconds.get(name, 0.0) + seconds

    def _linear(self, here: Iterate, x: FloatArray, solve: _Solve, closer: bool) -> LinearAnswer:
        """The linear problem; with springs where the tangent is not positive definite, or is so nearly singular that
        the answer is inaccurate, as that of a thin strip that only contact holds; then with the positive part of every
        cell's tangent, or with damping; collective."""
        shared, given, why = self.shared, here.problem.bent(x), ""
        tangent = here.problem.turning  # of this problem: `pose` makes another
        remedies = [tangent, here.supported][shared.remedy :]
        if self._damped or shared.held_by_contact:
            least, ratio, most = _DAMPINGS
            dampings = max(shared.damping / ratio, least) * ratio ** np.arange(_MOST)
            dampings = dampings[dampings <= (most if self._damped else _LITTLE)]
            remedies += [partial(here.supported, damping=float(damping)) for damping in dampings]
        if not self._damped:  # takes long steps of the boundary, but leaves an unstable equilibrium slowly
            remedies.append(here.made_positive)
        for remedy in remedies:
            body = remedy(given, x)
            if body is not here.body:
                here.pose(body)
            try:
                answer = solve(here.problem, x, closer)
            except (NotPositiveDefinite, NotConverged) as failure:
                refuse_interrupted(failure)
                why = str(failure)
                self._failed = self._failed if isinstance(failure, NotPositiveDefinite) else why
                _log.debug("%s", why)
                continue
            self._definite = remedy is tangent
            self._consistent = remedy in (tangent, here.supported)
            if not self._definite:
                shared.remedy = 1  # springs do no harm where they are not needed; the other remedies do
            if isinstance(remedy, partial):
                shared.damping = remedy.keywords["damping"]
            return answer
        self._failed = ""
        raise self._cut(f"a linear problem has no answer: {why}")

    def _cut(self, why: str) -> StepCut:
        """With what was tried, and may help."""
        tried = ["Newton's method"]
        if self.shared.remedy:
            tried.append("springs where contact presses")
            tried.append("damping" if self._damped else "a tangent that is positive in every cell")
        failed = self._failed.split("; last residuals")[0]
        on_the_way = f"; a linear problem on the way had no answer: {failed}" if failed else ""
        helps = "smaller load steps, a finer mesh at that place, loads by prescribed displacements"
        text = f"{why}{on_the_way}; tried: {', '.join(tried)}; what may help: {helps}"
        return StepCut(text, without_answer(len(self.shared.points.nodes)))

    def _moved(
        self, here: Iterate, du: FloatArray, state: State, start: FaceMotion, poses: FloatArray | None
    ) -> Iterate | None:
        """The iterate after a change of the displacement, with foundations under load in these poses; None if it turns
        an element inside out, or takes bodies so far away that rounding errors of places would hide gaps."""
        u = here.u + du
        ratios = [nonlinear(member.body).least_volume_ratio(u[member.nodes]) for member in self.elasticity.members]
        over = Reductions(self.comm)
        extent = float(np.max(over.extent(self.elasticity.reference)))
        if not np.min(ratios) > 0.0 or over.max(np.abs(u).ravel()) > _FAR * extent:
            return None
        return self._iterate(state, u, here.time, start, poses, previous=here.u)

    def _iterate(
        self,
        state: State,
        u: FloatArray,
        time: float,
        start: FaceMotion | None,
        poses: FloatArray | None,
        motions: FloatArray | None = None,
        previous: FloatArray | None = None,
    ) -> Iterate:
        pose = partial(self.shared.posed, undeformed=self._undeformed, poses=poses, motions=motions)
        return Iterate(self.elasticity, pose, u, time, state, self.shared.points, start, previous)

    def _begun(self, state: State) -> Iterate:
        """The iterate at the start of a step from a state: that of the last answer, if it is this; collective."""
        known = self.shared.answered
        if known is not None and known[0] is self.elasticity and known[1].time == state.time and state.poses is None:
            if Reductions(self.comm).all(np.array_equal(known[1].u, state.displacement)):
                return known[1]
        return self._iterate(state, state.displacement, state.time, None, state.poses)

    def _elsewhere(
        self, u: FloatArray, poses: FloatArray | None, state: State, motions: FloatArray | None = None
    ) -> Iterate:
        """The iterate at a displacement u (k, 3) of a step from a state; poses and motions as of `LoadSteps.posed`;
        collective."""
        if self._start is None or self._start[0] is not state or motions is not None:
            begin = self._iterate(state, state.displacement, state.time, None, state.poses, motions)
            self._start = state, begin.start()
        return self._iterate(state, u, self.time, self._start[1], poses, motions)

    def _carried(self, state: State, begin: Iterate) -> CarriedForces:
        """The contact forces of a state, with the normals of its place."""
        surface, normals = begin.problem.surface, np.zeros_like(state.force_on_body)
        normals[self.shared.points.places(surface)] = surface.frames[:, 0]
        return CarriedForces(-state.force_on_body, normals)

    def after(self, before: State, solution: Solution) -> State:
        """The state after the step: elastic energy is that of the bodies, or if one has a residual alone, the work of
        the internal forces by the trapezoidal rule; collective."""
        problem, on_body = solution.problem, solution.force_on_body
        then, now = before.forces, self._forces(problem, solution.displacement, solution.evidence, on_body)
        if then is None:
            then_from = None if before.before is None else before.before.displacement
            begin = LoadStepLoop(self.posed, self.shared, then_from)._iterate(
                before, before.displacement, before.time, None, before.poses
            )
            surface = begin.problem.surface
            x, on_body = self._carried(before, begin).at(surface, self.shared.points), before.force_on_body
            evidence = begin.problem.evidence_here(x, np.ones_like(surface.x))
            then = self._forces(begin.problem, begin.u, evidence, on_body[self.shared.points.places(surface)])
            linearised(self.elasticity, solution.displacement, solution.time)  # the user's functions are of the answer
        own = [nonlinear(one.body).strain_energy(now.displacement[one.nodes]) for one in self.elasticity.members]
        known = [one for one in own if one is not None]
        copies = self.elasticity.copies
        change = Reductions(self.comm, copies).dot(then.kept + now.kept, now.displacement - then.displacement)
        known.append(problem.elasticity.constraints.spring_energy(now.displacement, problem.time))
        elastic = copies * sum(known) if len(known) > len(own) else before.energy.elastic + 0.5 * change
        places = self.shared.points.places(problem.surface)
        return ended(before, solution, then, now, places, elastic=elastic)

    @staticmethod
    def _forces(problem: DiscreteProblem, u: FloatArray, e: Evidence, on_body: FloatArray) -> Forces:
        kept, surface = e.internal - e.spring, problem.surface
        return Forces.at(problem.elasticity, surface, u, kept, e.load, on_body, problem.time)
