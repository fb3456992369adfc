"""Exact derivatives of an answer, or of a history of load steps, along its inputs, by the sets of its contact points.

At an answer u = K^-1 (f - B^T x), and contact points are open, stick or slip.  While none of them changes its state,
forces follow from the derivative of the equations of contact (`solvers.derivatives`): one linear
system per input, with the K^-1 and A of the answer.  What an input does to the displacement without new contact forces
is that of loads: of friction none, of a load itself, of Young's modulus E minus the internal forces K_E u.  In a
history slip counts from the displacement after the step before, whose derivative is carried along.  In large motions,
and with foundations under load, that is the last linear problem of Newton's method, to which `geometric_terms` are
added.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.bodies import End, Loading
from ..linalg.reductions import Reductions
from ..solvers.derivatives import AnswerDerivatives, Change, Condition, Derivative, at_answer
from ..solvers.successive_tresca import Anderson
from .changed_problem import near
from .contact import SlipRateFriction, VariableFriction
from .discrete_problem import DiscreteProblem
from .geometric_terms import GeometricTerms, Terms, Way
from .heat_derivatives import Flows, HeatDerivatives
from .nodal_answer import NodalAnswer
from .sensitivity_inputs import Input, inputs_of, unloaded
from .sensitivity_totals import Changed, Derived, Section, contact_totals, other_totals, sections_of

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """What an answer owes to one input.

    Attributes:
        name: "friction of 'bottom'", "cohesion of 'bottom'", "pressure on 'top'", "young of 'upper'", "gap of 'bore'",
            "prescribed displacements", "pretension of 'upper:cut'", "motion of the foundation of 'bottom'".
        contact_force: Derivative of x along the logarithm of the input, newtons, shape (3 m,): a hundredth of it is
            what 1 % more of the input does.
        displacement: Likewise of u, metres, this rank's nodes, shape (k, 3).
        totals: Of each contact by its name derivatives of "force" and "moment" on the body, "normal_force",
            "friction_force", "contact_area", "centre_of_pressure", "mean_pressure" (normal force over contact area),
            "greatest_pressure", "greatest_slip" and "dissipated_energy", newtons, newton metres, m^2, metres, pascals
            and joules.
        others: Likewise of "reactions" of supports, "ties", "rigid_faces", "bolts" and "loaded_foundations", and of
            "probes", by their names, as the answer has them, of "bodies" the "strain_energy", of "heat_flows" the
            "power", and of "functionals" the "value"; what is empty is left out.
        step: Relative change of the input up to which no contact point opens, closes, sticks or slips anew, to first
            order: so far the answer is linear in it.  In a history, the least of its load steps.
        condition: Of the linear systems.  A warning says where it is 1e10 or more, and where their determinant shows
            that the problem has other answers: the derivatives are those of this one.
        border: Number of contact points on the border of two states.  If there are any, or were in a load step before,
            or nodes are tied for a greatest value (apart by less than 1e-6 of it), or a vector whose size is a total is
            0, the derivatives are those as the input grows,
        falling: and these are those as it falls; else None.
        poses: Of the `ContactState.poses` of foundations under load, shape (faces, 6); None without any.
    """

    name: str
    contact_force: FloatArray
    displacement: FloatArray
    totals: dict[str, dict[str, Any]]
    others: dict[str, dict[str, Any]]
    step: float
    condition: Condition
    border: int = 0
    falling: Sensitivity | None = None
    poses: FloatArray | None = None


def refuse(problem: DiscreteProblem) -> None:
    """ValueError for a problem of which derivatives are not known; the same on every rank."""
    if problem.body.heat is not None and (problem.body.undeformed is not None or problem.state.loaded):
        raise ValueError("sensitivities with heat are not known in large motions and of foundations under load")
    rated = any(isinstance(contact.friction, SlipRateFriction | VariableFriction) for contact in problem.contacts)
    if problem.before is not None and rated:
        raise ValueError("the sensitivities of a history are not known where friction depends on the slip rate")


Posed = Callable[[float], DiscreteProblem]
"""The problem with an input times a factor; collective."""


def sensitivities(
    problem: DiscreteProblem,
    x: FloatArray,
    u: FloatArray,
    answer: NodalAnswer,
    earlier: Sequence[Sensitivity] = (),
    others: Mapping[str, Posed] | None = None,
    only: Callable[[str], bool] | None = None,
    functionals: Mapping[str, tuple[FloatArray, FloatArray]] | None = None,
) -> list[Sensitivity]:
    """Of an answer to friction, cohesion, given gaps, loads, prescribed displacements and Young's moduli; collective.

    Args:
        problem: The problem,
        x: with the contact forces of its answer, newtons, shape (3 m,),
        u: and the displacement, metres, shape (k, 3).
        answer: The same at the contact points.
        earlier: Those of the load step before: slip counts from its displacement.
        others: Other inputs by their names, as lengths.
        only: Which of the inputs are wanted beside these, by their names; all by default.
        functionals: More outputs by their names, each by its derivatives along contact forces (3 m,) and displacements
            (k, 3) where places stay.

    Raises:
        ValueError: As `refuse`; in a later load step without those of the step before; if the answer is (nearly) not
            unique; with others where they are not known (`why_no_others`).
    """
    refuse(problem)
    before = problem.before
    if before is not None:
        if not earlier and Reductions(problem.comm).any(bool(np.any(before.displacement))):
            raise ValueError("the sensitivities of a load step follow from those of the step before: give these")
    inputs = inputs_of(problem, x, u, answer.given_gap)
    here = _Answer(problem, x, u, answer, functionals or {})
    inputs |= {name: Input(heat=one) for name, one in (here.heat.inputs() if here.heat else {}).items()}
    inputs = {name: one for name, one in inputs.items() if only is None or only(name)}
    inputs |= {name: Input(changed=here.changed(pose)) for name, pose in (others or {}).items()}
    inputs |= {one.name: Input() for one in earlier if one.name not in inputs}
    rising = here.along(inputs, {one.name: one for one in earlier}, 1.0)
    if rising:
        warn_of_several(here.at.condition, problem.comm)
    parted = any(one.falling is not None and one.falling.displacement is not one.displacement for one in earlier)
    if not rising or not (rising[0].border or parted):
        return rising
    falling = here.along(inputs, {one.name: one.falling or one for one in earlier}, -1.0)
    return [replace(up, falling=replace(down, falling=None)) for up, down in zip(rising, falling, strict=True)]


def why_no_others(problem: DiscreteProblem) -> str:
    """Why derivatives along other inputs, by problems with these, are not known; empty if they are."""
    body, state = problem.elasticity, problem.state
    constraints = body.constraints
    sprung = constraints.sprung or any(True for _ in body.spring_forces(np.zeros_like(body.x)))
    reasons = {
        "large motions": problem.body.undeformed is not None,
        "foundations under load": bool(state.loaded),
        "ties, rigid faces, bolts and springs": bool(constraints.ties) or sprung,
        "slices": body.slice is not None,
        "heat": problem.body.heat is not None,
    }
    return next((f"they are not known with {reason}" for reason, there in reasons.items() if there), "")


_SINGULAR: Final = 1e10
"""Condition number from which on systems are singular, nearly; of soft springs it is 1e2 to 1e3 over their softness."""


def warn_of_several(condition: Condition, comm: MPI.Comm) -> None:
    """A warning, on one rank, where answers or forces are not the only ones."""
    if condition.several and comm.rank == 0:
        _log.warning(
            "the problem has at least two other answers, as friction is so large that the equations of the derivatives "
            "have a negative determinant; they are those of this answer"
        )
    if condition.number >= _SINGULAR and comm.rank == 0:
        _log.warning(
            "the equations of the derivatives are singular, nearly (condition %.0e): forces of single contact points "
            "are not determined, but their sums, as on a rigid face, a cyclic cut or soft springs; or answers meet",
            condition.number,
        )


_CHANGE: Final = 1e-4
"""Relative change of other inputs, along which problems have central differences: errors of 1e-8."""

_SETTLED: Final = 1e-7
NEARLY: Final = 1e-6
MOST: Final = 30
"""Change of a derivative over itself at which geometric terms are found, or after the most iterations are taken."""

_SLIGHT: Final = 1e-6
"""Derivative of the displacement over this below which its accuracy is absolute: some are rounding errors."""


class _Answer:
    """An answer, with the linear problem there: of large motions, and foundations under load, that of the last Newton
    step, to which `GeometricTerms` are added."""

    def __init__(
        self,
        problem: DiscreteProblem,
        x: FloatArray,
        u: FloatArray,
        answer: NodalAnswer,
        functionals: Mapping[str, tuple[FloatArray, FloatArray]],
    ):
        self._functionals = functionals
        self._posed_at, self._x, self._u, self._answer = problem, x, u, answer
        self._problem = problem = problem.with_factors(x)
        self._large, self._over = problem.body.undeformed is not None, Reductions(problem.comm)
        self._terms, self._moves = GeometricTerms(problem, x, u), self._large or bool(problem.state.loaded)
        self._still = unloaded(problem.loading)
        self._without = with_loading(problem, self._still)
        self.heat = None if problem.body.heat is None else HeatDerivatives(problem, answer)

    def along(self, inputs: Mapping[str, Input], earlier: Mapping[str, Sensitivity], sign: float) -> list[Sensitivity]:
        """Of each of the inputs as it grows (sign 1) or falls (-1); collective."""
        posed = [self._posed(one, earlier.get(name)) for name, one in inputs.items()]
        solved = self._solved(posed, sign)
        if self._moves:
            ways = [self._way(one, earlier.get(name)) for name, one in inputs.items()]
            posed, solved = self._with_terms(posed, solved, ways, sign)
        flows = [Flows()] * len(posed)
        if self.heat is not None:
            posed, solved, flows = self._with_heat(self.heat, posed, solved, list(inputs.values()), sign)
        derivatives = []
        for (name, one), of, solution, heat in zip(inputs.items(), posed, solved, flows, strict=True):
            step = min(solution.owed.step, earlier[name].step if name in earlier else np.inf)
            derived = self._derived(one, of, solution, sign)
            totals = contact_totals(self._answer, derived, sign)
            left = self._left if self._large or one.changed is not None else None
            others = other_totals(self._answer, derived, totals[0], left, self._u, self._sections, sign)
            flowing = {"heat_flows": {flow: {"power": power} for flow, power in heat.items()}} if heat else {}
            along_frames = derived.x if of.terms is None else derived.x + of.terms.components.ravel()
            if self._functionals and one.changed is None:
                flowing["functionals"] = {
                    called: {"value": self._over.dot(of_x, along_frames) + self._over.dot(of_u, derived.u)}
                    for called, (of_x, of_u) in self._functionals.items()
                }
            here, there = (
                Sensitivity(
                    name,
                    along_frames,
                    derived.u,
                    of_contacts,
                    of_others | flowing,
                    step,
                    self.at.condition,
                    solution.owed.border,
                    poses=derived.poses,
                )
                for of_contacts, of_others in zip(totals, others, strict=True)
            )
            kinked = (here.totals, here.others) != (there.totals, there.others)
            derivatives.append(replace(here, falling=there) if kinked else here)
        return derivatives

    def _derived(self, one: Input, of: _Right, at: _Solved, sign: float) -> Derived:
        given = (None, None) if one.loading is None else (one.loading.tension, one.loading.apart)
        moved = self._over.any(given[1] is not None and bool(np.any(given[1])))
        spring = None if one.spring is None or one.loading is None else (one.spring, one.loading.load)
        poses, then = (self._problem.state.poses_after(alpha) for alpha in (sign * at.owed.alpha, 0.0 * at.owed.alpha))
        way = None if poses is None or then is None else poses - then
        c = of.c + self._terms.relative(sign * at.owed.alpha)
        x, changed = sign * at.owed.x, one.changed
        return Derived(at.problem, x, at.u, way, c, of.terms, given[0], moved, spring, one.energy, changed)

    def changed(self, pose: Posed) -> Changed:
        """What a change of another input does at the forces and displacements of the answer; collective."""
        if why := why_no_others(self._posed_at):
            raise ValueError(f"sensitivities to other inputs: {why}")
        more, less = (near(self._posed_at, pose(1.0 + h)) for h in (0.5 * _CHANGE, -0.5 * _CHANGE))
        terms = self._terms.between(more, less, _CHANGE)
        energies = [
            np.array([member.body.strain_energy(self._u[member.nodes]) or 0.0 for member in of.elasticity.members])
            for of in (more, less)
        ]
        change, way = (energies[0] - energies[1]) / _CHANGE, (more.elasticity.x - less.elasticity.x) / _CHANGE
        return Changed(terms, tuple(change), way)

    @cached_property
    def _left(self) -> FloatArray:
        """What supports and constraints hold, newtons, shape (k, 3); where places move, these are then those of the
        problem."""
        problem, body = self._posed_at, self._posed_at.elasticity
        imbalance = problem.surface.at_nodes(self._x) - problem.loading.load
        if not self._large:
            imbalance += body.internal_force(self._u) - body.spring_force(self._u)
        return imbalance

    @cached_property
    def at(self) -> AnswerDerivatives:
        """The linear systems; collective."""
        problem, linear = self._problem, self._problem.linear
        u = problem.elasticity.reduction.reduced(self._u - problem.loading.prescribed).ravel()
        return at_answer(problem.friction_problem, linear.formed_A, 1.0 / linear.node_stiffness, self._x, u)

    @cached_property
    def _sections(self) -> list[Section]:
        """Of the bolts, with what they carry; collective if there are any."""
        there = self._posed_at.elasticity.constraints.of_bolts
        return sections_of(self._posed_at, self._left, self._u) if there else []

    def _posed(self, one: Input, earlier: Sensitivity | None) -> _Right:
        """What an input does by itself, and in small strains by the displacement after the step before."""
        problem, surface = self._problem, self._problem.surface
        loading, origin = one.loading, np.zeros((len(surface.nodes), 3)) + one.c
        if earlier is not None and not self._large:
            loading = _continued(problem, loading or self._still, earlier.displacement)
            origin[:, 1:] += surface.rows(earlier.displacement)[:, 1:]
        right = _Right(loading or self._still, origin, np.zeros(len(origin)) + one.bound, one.e)
        right = right if one.changed is None else self._and(right, one.changed.terms)
        alone = one.motions is not None and not self._moves
        return self._and(right, self._terms.along(self._way(one, earlier))) if alone else right

    def _and(self, right: _Right, terms: Terms) -> _Right:
        """With geometric terms; collective."""
        led = self._problem.elasticity.reduction.led(terms.prescribed, terms.apart)
        loading = replace(
            right.loading,
            load=right.loading.load + terms.load,
            prescribed=right.loading.prescribed + led,
            apart=right.loading.apart + terms.apart,
        )
        return _Right(loading, right.c + terms.c, right.bound + terms.bound, right.e + terms.e, terms)

    def _way(self, one: Input, earlier: Sensitivity | None) -> Way:
        """What an input moves by itself, and by displacements and foundations after the step before."""
        rigid = self._problem.rigid
        still = Way(np.zeros_like(self._u), np.zeros(0 if rigid is None else rigid.count), motions=one.motions)
        return still if earlier is None else replace(still, before=earlier.displacement, poses_before=earlier.poses)

    def _solved(self, rights: Sequence[_Right], sign: float) -> list[_Solved]:
        """By the linear problem, as the input grows (sign 1) or falls (-1); collective."""
        problem, changes = self._problem, list[Change]()
        posed = [with_loading(problem, one.loading) for one in rights]
        moved = [self._carried(one.loading) for one in rights]
        for one, changed, carried in zip(rights, posed, moved, strict=True):
            e = [np.zeros(0) if each.state.rigid is None else each.state.rigid.e for each in (changed, self._without)]
            closing, f = -one.c, None
            if carried:
                closing = (changed.b - self._without.b).reshape(-1, 3) - one.c
            else:
                f = sign * self._problem.elasticity.reduction.along(one.loading.load, one.loading.tension).ravel()
            changes.append(Change(sign * closing.ravel(), sign * one.bound, sign * (e[0] - e[1] + one.e), f))
        owed, solved = self.at.derivatives(changes), list[_Solved]()
        for changed, derivative, carried in zip(posed, owed, moved, strict=True):
            u = sign * self._problem.elasticity.reduction.displacement(derivative.u.reshape(-1, 3))
            u = u + changed.linear.free_displacement if carried else u
            solved.append(_Solved(changed, derivative, changed.moved(u, sign * derivative.alpha)))
        return solved

    def _carried(self, loading: Loading) -> bool:
        """Whether displacements are prescribed, of which the body without contact has its share exactly; collective."""
        return self._over.any(bool(np.any(loading.prescribed) or np.any(loading.apart)))

    def _with_terms(
        self, rights: Sequence[_Right], solved: Sequence[_Solved], ways: Sequence[Way], sign: float
    ) -> tuple[list[_Right], list[_Solved]]:
        """With geometric terms, by a fixed-point iteration with Anderson acceleration, from answers without; `ways` are
        those of the inputs by themselves; collective."""
        over, answers, posed = self._over, list(solved), list(rights)
        mixing, left = [Anderson(MOST, over) for _ in rights], np.full(len(rights), np.inf)
        points, least = [self._joined(answer, sign) for answer in answers], _SLIGHT * over.norm(self._u)
        for _ in range(MOST):
            moving = [k for k, size in enumerate(left) if size > _SETTLED]
            if not moving:
                break
            for k in moving:
                u, alpha = self._parted(points[k])
                posed[k] = self._and(rights[k], self._terms.along(replace(ways[k], u=u, alpha=alpha)))
            for k, one in zip(moving, self._solved([posed[k] for k in moving], sign), strict=True):
                answers[k], point = one, self._joined(one, sign)
                size = max(over.norm(point), least)
                left[k] = over.norm(point - points[k]) / size if size > 0.0 else 0.0
                points[k] = mixing[k].next(points[k], point - points[k], 1.0)
        if not np.all(left <= NEARLY):
            raise ValueError(
                f"the geometric terms of sensitivities do not settle, by a part of {np.max(left):.0e}: the answer is "
                "nearly one of several, or was found with too large a tolerance"
            )
        return posed, answers

    def _with_heat(
        self,
        heat: HeatDerivatives,
        rights: Sequence[_Right],
        solved: Sequence[_Solved],
        given: Sequence[Input],
        sign: float,
    ) -> tuple[list[_Right], list[_Solved], list[Flows]]:
        """With the temperatures that contact and heat cause in turn, as of `_with_terms`; collective."""
        over, answers, posed = self._over, list(solved), list(rights)
        mixing, left = [Anderson(MOST, over) for _ in rights], np.full(len(rights), np.inf)
        points: list[FloatArray] = [np.zeros(len(self._u)) for _ in rights]
        flows, rows = [Flows() for _ in rights], self._problem.surface.rows
        for _ in range(MOST):
            moving = [k for k, size in enumerate(left) if size > _SETTLED]
            if not moving:
                break
            for k in moving:
                dx = sign * answers[k].owed.x.reshape(-1, 3)
                there, flows[k] = heat.along(dx, rows(answers[k].u) - posed[k].c, given[k].heat)
                size = over.norm(there)
                left[k] = over.norm(there - points[k]) / size if size > 0.0 else 0.0
                points[k] = mixing[k].next(points[k], there - points[k], 1.0)
                posed[k] = replace(rights[k], loading=heat.load(rights[k].loading, points[k]))
            for k, one in zip(moving, self._solved([posed[k] for k in moving], sign), strict=True):
                answers[k] = one
        if not np.all(left <= NEARLY):
            raise ValueError(f"the temperatures of sensitivities do not settle, by a part of {np.max(left):.0e}")
        return posed, answers, flows

    def _joined(self, one: _Solved, sign: float) -> FloatArray:
        """Derivatives of displacement and of free motions, these on one rank, shape (3 k + q,)."""
        here = self._over.comm.rank == 0
        return np.concatenate([one.u.ravel(), sign * one.owed.alpha if here else 0.0 * one.owed.alpha])

    def _parted(self, way: FloatArray) -> tuple[FloatArray, FloatArray]:
        count = 3 * len(self._u)
        return way[:count].reshape(-1, 3), self._over.total(way[count:])


@dataclass(frozen=True, eq=False)
class _Right:
    """The right-hand side of the derivative's equations: loads, gaps and slip origins in metres (m, 3), bounds in
    newtons (m,), loads along free motions (q,); and the geometric terms in it."""

    loading: Loading
    c: FloatArray
    bound: FloatArray
    e: FloatArray | float = 0.0
    terms: Terms | None = None


@dataclass(frozen=True, eq=False)
class _Solved:
    """The linear problem along an input, the derivative of its answer, and of the displacement, metres, (k, 3)."""

    problem: DiscreteProblem
    owed: Derivative
    u: FloatArray


def with_loading(problem: DiscreteProblem, loading: Loading) -> DiscreteProblem:
    return problem.in_state(replace(problem.state, loading=loading), None, problem.before)


def _continued(problem: DiscreteProblem, loading: Loading, u: FloatArray) -> Loading:
    """Loads and prescribed displacements with what supports hold of the displacement (k, 3) after the step before."""
    before, body = problem.before, problem.elasticity
    assert before is not None
    held, none = (body.after(problem.time, End(before.time, end)) for end in (u, np.zeros_like(u)))
    return replace(
        loading,
        prescribed=loading.prescribed + held.prescribed - none.prescribed,
        apart=loading.apart + held.apart - none.apart,
    )
