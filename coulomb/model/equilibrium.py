"""Bodies that contact alone holds: whether contact can balance the loads at all, and which motions nothing resists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import direction_in_words, motions_in_words
from ..linalg.reductions import Reductions
from ..solvers.equilibrium import LimitLoad
from ..solvers.results import NotConverged, SolverResult, Status
from ..solvers.rigid_motions import MotionBasis, RigidMotions
from ..units import amount
from .discrete_problem import DiscreteProblem
from .foundation_load import with_foundations

_PART: Final = 1e-6
"""Part of the loads, or of a motion, below which it is a rounding error."""

_ROUGH: Final = 1e3
"""Friction that holds whatever pressure makes possible."""

_AWAY: Final = 30.0
"""A rigid motion beyond this many times deformation, gaps and prescribed motions together runs away."""

_UNBALANCED: Final = 1e-2
"""Loads of which more than this part is left over at the end are not balanced."""

_TURNING: Final = 0.1
"""Part of the motion of an iterate that is worth a word."""

_MOVING: Final = 1e-3
"""Part of the largest motion above which a component takes part in the motion that nothing holds."""


class NoEquilibrium(NotConverged):
    """No contact forces balance the loads on a body that contact alone holds: smaller load steps do not help."""


def refuse_without_equilibrium(problem: DiscreteProblem) -> None:
    """Raise NoEquilibrium, with body, direction and amount, if no contact forces balance the loads; collective."""
    said = without_equilibrium(problem)
    if said:
        m, rigid = problem.A.nodes, problem.rigid
        nothing: FloatArray = np.zeros(3 * m)
        result = SolverResult(
            x=nothing,
            gradient=nothing,
            slip_bound=problem.slip_bound(nothing),
            multipliers=np.zeros((m, 2)),
            status=Status.NO_EQUILIBRIUM,
            residual=np.inf,
            method="limit load",
            message=said,
            rigid=np.zeros(0 if rigid is None else rigid.count),
        )
        raise NoEquilibrium(said, result)


def without_equilibrium(problem: DiscreteProblem) -> str:
    """Why no contact forces balance the loads, with body, direction and amount; empty if some do; collective."""
    rigid, over = problem.rigid, Reductions(problem.comm)
    if rigid is None:
        return ""
    for law in problem.law.majorants():
        limit = LimitLoad(rigid, law, over)
        motion = limit.unbalanced()
        if motion is not None:
            break
    else:
        return ""
    rough = problem.law.rough(_ROUGH)
    opening = LimitLoad(rigid, rough, over).unbalanced()
    if opening is not None and over.any(bool(np.any(problem.law.sloped))):  # no friction, however large, would help
        return _falling(problem, _plain(problem, LimitLoad(rigid, rough, over), opening), rigid)
    pushed = along_foundations(rigid, over)
    if float(np.abs(pushed).max()) > _PART * float(np.abs(rigid.e).max()):
        part = limit.held_part(pushed)
        if part is not None and part < 1.0:
            return _sliding(problem, motion, rigid.e, pushed, part)
    return _falling(problem, _plain(problem, limit, motion), rigid)


def _plain(problem: DiscreteProblem, limit: LimitLoad, motion: FloatArray) -> FloatArray:
    """The translation in a motion (q,), or along one axis, if nothing resists that either: it needs no centre in words;
    collective."""
    turning = np.array([bool(np.any(one.rotation)) for one in problem.state.free.motions])
    translation = np.where(turning, 0.0, motion)
    along = np.diag(translation)[np.argsort(-np.abs(translation))]
    plain = (one for one in (translation, *along) if np.any(one) and limit.drives(one))
    return next(plain, motion)


def along_foundations(rigid: RigidMotions, over: Reductions) -> FloatArray:
    """The part of the loads that does work on motions that neither open nor close any contact, shape (q,)."""
    normal = np.zeros((rigid.G.shape[1] // 3, 3))
    normal[:, 0] = 1.0
    sliding = MotionBasis(rigid.G * normal.ravel(), over).free
    return sliding @ (sliding.T @ rigid.e)


def _sliding(problem: DiscreteProblem, motion: FloatArray, e: FloatArray, pushed: FloatArray, part: float) -> str:
    """Loads along the foundations of which friction holds a part."""
    free = problem.state.free
    acting, moving = free.resultants(pushed), free.of(motion)
    most = max(one.size for one in moving)
    named = [
        (load, one)
        for load, one in zip(acting, moving, strict=True)
        if one.size > _MOVING * most and load.size > _PART * float(np.abs(e).max())
    ] or [(load, one) for load, one in zip(acting, moving, strict=True) if load.size > 0.0]
    said = [f"{free.bodies[load.component]} {load}" for load, _ in named]
    held = [f"{load.scaled(part)}" for load, _ in named]
    holds = "friction holds at most" if part > _PART else "no friction holds"
    amounts = f" {' and '.join(held)}" if part > _PART else " them"
    return f"there is no equilibrium: loads push {' and '.join(said)}; {holds}{amounts}"


def _falling(problem: DiscreteProblem, motion: FloatArray, rigid: RigidMotions) -> str:
    """Loads that do work on a motion that contact does not resist."""
    free = problem.state.free
    acting, moving = free.resultants(rigid.e), free.of(motion)
    most = max(one.size for one in moving)
    bolts = len(free.bodies) - free.opening
    said, works = [], []
    for load, one in zip(acting, moving, strict=True):
        if one.size > _MOVING * most:
            work = float(load.force @ one.translation + load.moment @ one.rotation)
            turn, way = float(np.linalg.norm(one.rotation)), float(np.linalg.norm(one.translation))
            if turn * one.part.radius > _MOVING * way:
                moment = f"{'under' if work >= 0.0 else 'against'} {amount(abs(work) / turn, 'N m')}"
                said.append(f"{free.bodies[one.component]}: it {one.tidy(_MOVING)}, {moment}")
            else:
                sign = 1.0
                if one.component >= bolts:
                    works.append(work)
                    sign = np.copysign(1.0, work)
                along, force = direction_in_words(sign * one.translation, _MOVING), amount(sign * work / way, "N")
                said.append(f"{free.bodies[one.component]} against loads of {force} along {along}")
    series = "; in series they carry the same force" if min(works, default=0.0) < 0.0 < max(works) else ""
    return f"there is no equilibrium: nothing holds {'; nor '.join(said)}{series}"


def running_away(problem: DiscreteProblem, result: SolverResult) -> str:
    """What the loads push away in the last iterate of a solver that has failed, in words; empty if nothing; collective.

    Contact forces that balance the loads may exist, while none of them obey the law of friction: a pin in a bore would
    have to be wedged.  Then its motion grows from step to step without limit, or the loads are left unbalanced.
    """
    rigid, free = problem.rigid, problem.state.free
    if rigid is None:
        return ""
    over = Reductions(problem.comm)
    held = over.total(rigid.G @ result.x)
    left = rigid.e - held
    known = (problem.displacement(result.x), problem.surface.gap, problem.state.slip_origin, problem.motions)
    usual = sum(over.max(np.append(np.abs(values), 0.0)) for values in known)
    seen = result.equilibrium
    if len(result.rigid) == rigid.count and max(one.size for one in free.of(result.rigid)) > _AWAY * usual:
        motion, least = result.rigid, _AWAY * usual
    elif seen is not None and len(seen.direction) == rigid.count:  # the solver has seen in which direction it slides
        motion, least = seen.direction, 0.1 * max(one.size for one in free.of(seen.direction))
    elif float(np.abs(left).max()) > _UNBALANCED * float(np.abs(rigid.e).max()):
        motion, least = left, 0.1 * max(one.size for one in free.of(left))
    else:
        return ""
    said = []
    for load, carried, one in zip(free.resultants(rigid.e), free.resultants(held), free.of(motion), strict=True):
        if one.size > least:
            one = one.tidy(_TURNING)
            pushed, resisted = (float(by.force @ one.translation + by.moment @ one.rotation) for by in (load, carried))
            resisted = 0.0 if abs(resisted) <= _PART * abs(pushed) else resisted
            way, turn = float(np.linalg.norm(one.translation)), float(np.linalg.norm(one.rotation))
            unit, where = "N", f"along {direction_in_words(one.translation, _MOVING)}"
            if turn > 0.0:
                way, unit, where = turn, "N m", f"so that it {one},"
            said.append(
                f"{free.bodies[load.component]} {where} with {amount(pushed / way, unit)}, of which contact holds "
                f"{amount(resisted / way, unit)} in the last iterate"
            )
    return f"no answer found: loads push {' and '.join(said)}"


def undetermined(problem: DiscreteProblem, x: FloatArray) -> Sequence[str]:
    """The rigid motions that neither supports nor the contact forces x (3 m,) resist, nor in large motions stress and
    loads as they turn, in words; collective."""
    body, state, over = problem.elasticity, problem.state, Reductions(problem.comm)
    own = body.free if problem.body.undeformed is None else body.unheld
    free = with_foundations(own, state.loaded) if state.loaded else own
    if not len(free):
        return ()
    R = body.reduction.reduced(body.held.free_part(own.modes(body.x)))
    pressing, rubbing = x[0::3] > 0.0, problem.slip_bound(x) > 0.0
    resisting = np.column_stack([pressing, rubbing, rubbing]).ravel()
    motions = MotionBasis(state.motions_at_contact(R) * resisting, over).free
    if motions.shape[1] and len(own):
        motions = motions @ problem.without_stiffness(x, R @ motions[-len(own) :])
    return motions_in_words(free, motions)
