"""A contact problem in one state is solved by the methods for K^-1 in turn; its answer, and its error if K u = f is not
solved by multigrid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Final, NamedTuple

import numpy as np
from mpi4py import MPI
from threadpoolctl import threadpool_limits

from ..arrays import FloatArray
from ..fem.geometry import on_every_rank
from ..linalg.compliance import IterativeSolver
from ..linalg.reductions import Reductions
from ..linalg.solve_errors import CGNotConverged, TooSlow
from ..native import threads
from ..solvers.automatic import Automatic, settled
from ..solvers.friction_problem import FrictionProblem, Solver
from ..solvers.interior_point import InteriorPoint
from ..solvers.results import NotConverged, Progress, ProgressCallback, SolverResult, Status
from ..solvers.rigid_motions import NO_MOTION
from .certificate import LIMIT, Certificate, settled_to
from .discrete_problem import DiscreteProblem
from .heat import UNBALANCED
from .provenance import timed
from .solution import Solution
from .stopping_criterion import CERTIFIED_FROM, StoppingCriterion


class LinearAnswer(NamedTuple):
    """Of a linear problem of large motions: contact forces (3 m,) in newtons, with exact zeros where they are open,
    their displacement (k, 3) in metres, the solver's result, and the methods as in summary.json."""

    contact_force: FloatArray
    displacement: FloatArray
    result: SolverResult
    methods: dict[str, Any]


_MOST: Final = 25
"""Largest number of places of foundations under load that are tried."""


@dataclass(frozen=True)
class Solving:
    """How contact problems in one state are solved: arguments and errors as of `ContactProblem.solve`."""

    tolerance: float
    solver: Solver | None
    progress: ProgressCallback | None

    def answer(self, posed: DiscreteProblem, start: FloatArray | None) -> Solution:
        """By the first method for K^-1 that has one."""
        return answer_of(posed, *self._by_methods(posed, start))

    def on_the_way(self, posed: DiscreteProblem, start: FloatArray | None) -> LinearAnswer:
        """`answer` without a certificate, as is enough on the way to an answer that will have one."""
        result, criterion = self._by_methods(posed, start, on_the_way=True)
        methods = {"solver": result.method, **posed.linear.methods}
        return LinearAnswer(*criterion.with_zeros(result.x, result.rigid), result, methods)

    def in_place(self, posed: DiscreteProblem, start: FloatArray | None) -> Solution:
        """`answer`, with the foundations under load where it has moved them, as often as that leaves the certificate
        above the tolerance; NotConverged if that is more than _MOST times."""
        answer, size, certified = self.answer(posed, start), math.inf, False
        results = [answer.result]
        for _ in range(_MOST if posed.state.loaded else 0):
            poses = posed.state.poses_after(answer.result.rigid)
            there = posed.in_state(posed.body.posed(posed.state, poses, posed.before), posed.seconds, posed.before)
            forces = there.surface.force_components(posed.surface.vectors(answer.contact_force.reshape(-1, 3)))
            rest = answer.result.rigid.copy()
            rest[: sum(len(one.motions) for one in posed.state.loaded)] = 0.0
            result = replace(together(results), x=forces.ravel(), rigid=rest)
            placed = answer_of(there, result)
            before, size = size, size_of(placed.certificate)
            if placed.certificate.passed and (size <= self.tolerance or (certified and size > 0.5 * before)):
                return placed
            certified = placed.certificate.passed
            posed, answer = there, self.answer(there, result.x)
            results.append(answer.result)
        if not posed.state.loaded:
            return answer
        names = " and ".join(repr(one.name) for one in posed.state.loaded)
        raise NotConverged(
            f"the foundation of {names} under load does not come to rest in {_MOST} places: let it begin where it "
            "touches, apply the load in smaller steps ([history], force_amplitude), or guide it (leave components of "
            "force and moment out)",
            answer.result,
        )

    def _by_methods(
        self, posed: DiscreteProblem, start: FloatArray | None, on_the_way: bool = False
    ) -> tuple[SolverResult, StoppingCriterion]:
        """By the first method for K^-1 that has an answer, accepted by a certificate, or contact by contact."""
        stiffness = posed.body.stiffness
        while True:
            try:
                return self._by_present_method(posed, start, on_the_way)
            except TooSlow as slow:
                stiffness.change_method(str(slow), condense=self.solver is None)
            except NotConverged as failure:
                ended = failure.result.status in (Status.INTERRUPTED, Status.NO_EQUILIBRIUM)
                condense = self.solver is None and not stiffness.explicit
                if ended or not stiffness.change_method(failure.result.message, condense):
                    failure.args = (f"{failure}{'' if ended else stiffness.advice}",)
                    raise

    def _by_present_method(
        self, posed: DiscreteProblem, start: FloatArray | None, on_the_way: bool
    ) -> tuple[SolverResult, StoppingCriterion]:
        newton = posed.body.stiffness.present.newton
        default = Automatic(self.tolerance) if newton is None else InteriorPoint(self.tolerance, newton=newton())
        chosen = self.solver or default
        if start is not None and newton is not None and self.solver is None:
            start = np.atleast_2d(start)[0]  # of several
        criterion, counted = StoppingCriterion(posed), CountedProgress(self.progress, posed.comm)
        accept = criterion.by_contacts if on_the_way else criterion
        with posed.body.stiffness.limited(posed.linear.stiffness.solver):
            problem = posed.friction_problem  # K^-1, A and b are timed separately
            posed.linear.prepare_products()
            if chosen.tolerance <= CERTIFIED_FROM:
                problem = replace(problem, accept=accept, balanced=criterion.gradient)
            limit = nullcontext() if self.solver else posed.body.stiffness.few_products(posed.A)
            with timed(posed.seconds, "solve"), _one_blas_thread(posed), limit:
                try:
                    result = chosen.solve(problem, start, progress=counted)
                    if chosen.tolerance <= CERTIFIED_FROM:
                        stiffness = posed.linear.node_stiffness
                        result = settled(problem, result, stiffness, chosen.tolerance, counted)
                except NotConverged as failure:
                    raise criterion.explained(failure, chosen.tolerance) from None
                except CGNotConverged as failure:
                    raise linear_solve_failed(posed, problem, failure, counted, type(chosen).__name__) from None
        return result, criterion


def answer_of(posed: DiscreteProblem, result: SolverResult, criterion: StoppingCriterion | None = None) -> Solution:
    """Displacement and certificate of a solver's result, converged or not; from `criterion` if it has them.  The
    certificate fails where heat is a part of the problem, and was not solved with contact."""
    judged = (criterion or StoppingCriterion(posed)).answer(result.x, result.rigid)
    x = judged.contact_force
    law = posed.slip_bound(x)
    g = np.where(law > 0.0, result.slip_bound, 0.0)  # exactly zero at open nodes, as the forces
    g = np.where(x[0::3] != result.x[0::3], law, g)  # where `zero_open_forces` has changed the normal force
    evidence, certificate = settled_to(judged.evidence, judged.certificate, result.unsettled)
    if posed.body.heat is not None and result.status is not Status.CONVERGED:
        certificate = replace(certificate, checks=(*certificate.checks, UNBALANCED))
    methods = {"solver": result.method, **posed.linear.methods}
    return Solution(
        posed,
        x,
        judged.displacement,
        g,
        result,
        certificate,
        evidence,
        posed.compliances,
        posed.mean_compliance,
        methods,
    )


def size_of(certificate: Certificate) -> float:
    """The largest value of the checks, but of the angle and of the resolution; inf if one is not finite."""
    values = [check.value for check in certificate.checks if check.limit == LIMIT]
    return float(np.max(values)) if np.all(np.isfinite(values)) else np.inf


def together(results: Sequence[SolverResult]) -> SolverResult:
    """The last of several results, with the sums of steps and products, and the history of all."""
    return replace(
        results[-1],
        outer_steps=sum(result.outer_steps for result in results),
        newton_steps=sum(result.newton_steps for result in results),
        products=sum(result.products for result in results),
        history=tuple(chain.from_iterable(result.history for result in results)),  # type: ignore[arg-type]
    )


def _one_blas_thread(posed: DiscreteProblem) -> AbstractContextManager[object]:
    """One thread of BLAS where multigrid's kernels have several: OpenBLAS waits for its next call in busy loops."""
    threaded = posed.body.stiffness.linear_solver is IterativeSolver and threads() > 1
    return threadpool_limits(limits=1, user_api="blas") if threaded else nullcontext()


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
