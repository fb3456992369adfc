"""Error bars of an answer: by how much its totals differ from those of the continuum, estimated from answers of the
same problem on other meshes.

With the error C h^q of a total on cells of size h, the totals J_1, J_2, J_3 on cells of sizes h_1 < h_2 < h_3 give
q and the error |J_1 - J_2|/((h_2/h_1)^q - 1) (Richardson's extrapolation; Roache, J. Fluids Eng. 116, 1994, whose
safety factor and "grid convergence index" these are; Eca and Hoekstra, J. Comput. Phys. 262, 2014).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import locking_by_volume
from ..fem.meshes import same_cells
from ..model.discrete_problem import DiscreteProblem
from ..model.load_history import LoadHistory
from ..model.load_step import LoadStep
from ..model.problem import ContactProblem
from ..model.solution import Solution
from ..model.solving import Solving
from ..solvers.friction_problem import Solver
from ..solvers.results import NotConverged, ProgressCallback
from .accuracy import TOLERANCE
from .answer import FREE, LARGEST, Answer, answer_of, least_bar
from .energy_error import relative_stress_error
from .locking import ROUGH, WIDE, single_layer, too_stiff
from .other_meshes import NoErrorBars, answer_on, other_problems, refuse_too_large, without_remarks
from .same_problem import refuse_another_problem

SAFETY, OF_TWO = 1.3, 1.5
"""Safety factors of an error estimated from three meshes (Roache has 1.25), and from two, whose order is not seen."""

SLOWEST, FASTEST = 0.7, 1.2
"""Bounds of the order q: totals have twice the order of the energy norm, which is at most 3/4 at the edge of a contact
(there u ~ r^(3/2), and half a cell of it is where the state changes), and about 1/3 at edges of clamped faces; on
coarse meshes smooth parts of the error, which vanish first, make it seem larger.  The bounds are from measurement
(error-bars-rules.csv): with 1.5 and a safety factor of 1.5 bars are as wide, and up to 3 % more numbers are outside, of
stacks with a face in two pairs and of rubbing histories.  Of even contact (`even_contact`) the errors of the stress
tell them (`_bounds`)."""

OF_THE_FINER, OF_THE_COARSER, OF_EQUALS = 1.0, 2.0, 2.0
"""Error of the answer of second order, and of that of first order on the same cells, over the difference of the two;
and that of second order over the difference from first order on the same nodes.

Where the places of the nodes decide, as at edges of held faces that are in contact and at the border of the contact,
errors go with their distance, which is half as large with second order: it is the difference, and that of first order
is twice the difference.  But 10-node tetrahedra have contact points at vertices alone, as 4-node ones: where contact
points decide, only first order on the same nodes, with contact points at half the distance, has half the error.  Of
even contact nothing but the stress decides, and its estimated errors tell how much better second order is."""

OF_EXTREMES: Final = 1.0
"""Order at most of largest pressures and slips: they are at edges of the face as a rule, where nodes represent the mean
over half a cell, or are held.  Both orders have this error there: bars of two answers are twice as large."""

SHAPE: Final = 3.0
"""Relative error of a total over that of the volume by plane facets in place of a curved surface, where the compared
meshes have the same facets: 1 of weights, 2 of the torsion and bending of bars."""

COMPONENT: Final = 0.05
"""Least bar of a component, over the largest one of its vector: the errors of the components have the same causes, and
the differences of one may be small by accident."""

UNCOMPARED = (
    "bars may be far too short: first-order cells may lock, and second order, which would show it, has no answer"
)
"""Warning with the reason why there is none."""

SINGULAR, UNRESOLVED = "singular, does not converge", "not resolved, perhaps singular"
"""Remarks on totals without a bar, by three meshes, and by two or three among which it goes up and down."""

DIVERGING: Final = 0.25
"""Order up to which a largest pressure is taken for singular: it does not converge."""

SMOOTH: Final = 2.0
"""Order, of smooth answers, below which a largest pressure that goes up and down on three meshes tells nothing: it is
as the cells at an edge happen to be (of 15 such ones 4 were inside their bars, docs/measurements.md)."""


@dataclass(frozen=True, eq=False)
class ErrorBar:
    """A total with its error bar.

    Attributes:
        quantity: Where it is in summary.json: "totals.normal_force", "reactions.clamp_left.force".
        unit: Of the value and its bar.
        value: A number, or the three components of a vector, shape (1,) or (3,).
        discretisation: Its part by the mesh, of each component; nan where the total does not converge.
        contact: Its part by half the cells along the border of the contact, of areas of contact, and by contact that
            all meshes may miss; else 0.
        algebraic: Its part that the tolerance of the solver leaves.
        order: Order of convergence q, as observed; nan if two meshes do not tell.
        values: On all meshes that are compared, the value itself first.
        geometry: Its part by plane facets in place of a curved surface that these meshes do not show.
    """

    quantity: str
    unit: str
    value: FloatArray
    discretisation: FloatArray
    contact: FloatArray
    algebraic: FloatArray
    order: float
    values: tuple[FloatArray, ...]
    geometry: FloatArray = field(default_factory=lambda: np.zeros(1))

    @property
    def bar(self) -> FloatArray:
        """Estimated bound of |value - exact value|, of each component: the sum of the parts; nan where the total does
        not converge."""
        return self.discretisation + self.contact + self.algebraic + self.geometry

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        known = bool(np.all(np.isfinite(self.bar)))
        parts = {name: _plain(getattr(self, name)) for name in ("discretisation", "contact", "algebraic", "geometry")}
        return {
            "quantity": self.quantity,
            "unit": self.unit,
            "value": _plain(self.value),
            "error": _plain(self.bar) if known else None,
            "order": self.order if math.isfinite(self.order) else None,
            "on_meshes": [_plain(value) for value in self.values],
            **({"parts": parts} if known else {"remark": SINGULAR if math.isfinite(self.order) else UNRESOLVED}),
        }


@dataclass(frozen=True)
class ErrorBars:
    """The error bars of an answer, in the order of summary.json.

    Attributes:
        bars: Of every total.
        answers: What was compared: the answer itself, then the others.
        relative_stress_error: Error of the stress over the stress, both of all bodies, in the energy norm; None where
            it is not known.
        warnings: On cells that lock, on bars that may be too short since these could not be compared, and on polygons
            that are not in the bars.
    """

    bars: tuple[ErrorBar, ...]
    answers: tuple[Answer, ...]
    relative_stress_error: float | None = None
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        unknowns = ", ".join(f"{answer.unknowns}" for answer in self.answers)
        return f"<error bars of {len(self.bars)} totals, from answers with {unknowns} unknowns; [name].value and .bar>"

    def __getitem__(self, quantity: str) -> ErrorBar:
        """That of a total, by its place in summary.json; KeyError with all places if there is none."""
        for bar in self.bars:
            if bar.quantity == quantity:
                return bar
        raise KeyError(f"no error bar of {quantity!r}; there are {', '.join(bar.quantity for bar in self.bars)}")

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        return {
            "meshes": [
                {"unknowns": one.unknowns, "order": one.order, "cell_size": one.size, "seconds": one.seconds}
                for one in self.answers
            ],
            "bars": [bar.entry() for bar in self.bars],
            "relative_stress_error": self.relative_stress_error,
            **({"warnings": list(self.warnings)} if self.warnings else {}),
        }


def error_of(
    solution: Solution,
    *others: Solution,
    tolerance: float = TOLERANCE,
    solver: Solver | None = None,
    progress: ProgressCallback | None = None,
) -> ErrorBars:
    """The error bars of an answer; collective, the same on every rank.

    Args:
        others: Answers of the same problem on other meshes.  By default the problem is solved again: on two coarser
            meshes where they can be made (of boxes, and of large first-order meshes), else on the same cells with
            elements of the other order.
        tolerance: Of the solver; of an answer with a larger residual, that counts.
        solver: For the other answers, as of `ContactProblem.solve`.
        progress: Called after every step of a solver.

    Raises:
        NoErrorBars: If the problem cannot be posed or solved on other meshes, or these do not differ.
        ValueError: If one of the others is no answer, or that of another problem.
    """
    if solution.problem.before is not None:
        raise NoErrorBars("a load step has error bars with all steps before: output.error = true of a case")
    refuse_another_problem(solution, others)
    answers, solving = [answer_of(solution, tolerance)], Solving(tolerance, solver, progress)
    if others:
        bars = bars_of([*answers, *(answer_of(other, tolerance) for other in others)])
        return (
            replace(bars, warnings=(*bars.warnings, f"{UNCOMPARED}: give one"))
            if _may_lock(solution.problem, bars)
            else bars
        )
    refusals = []
    for way in other_problems(solution.problem):
        for problem in way:
            try:
                answers.append(answer_on(problem, solving))
            except ValueError as error:
                refusals.append(str(error))
                break
        if len(answers) > 1:  # one other mesh will do
            return with_second_order(solution, answers, solving)
    raise NoErrorBars(refusals[0])


def with_second_order(solution: Solution, found: Sequence[Answer], solving: Solving, unknown: float = 0.0) -> ErrorBars:
    """`bars_of` the answers found, where first-order cells may lock also with that of second order on the same cells;
    collective."""
    bars = bars_of(found, unknown)
    if not _may_lock(solution.problem, bars):
        return bars
    try:
        problem = next(other_problems(solution.problem, (same_cells,)))[0]
        return bars_of([*found, answer_on(problem, solving)], unknown)
    except ValueError as error:
        return replace(bars, warnings=(*bars.warnings, f"{UNCOMPARED}: {error}"))


def _may_lock(problem: DiscreteProblem, bars: ErrorBars) -> bool:
    """Whether cells of first order may lock, and no answer of second order on the same ones is there; collective."""
    first, *others = bars.answers
    if any(_beside(first, one) for one in others):
        return False
    energy, body = bars["strain_energy"], problem.elasticity
    rough = first.stress is not None and first.stress.of_first > ROUGH
    wide = first.order < 2.0 and bool(energy.discretisation[0] > WIDE * energy.value[0])
    return rough or wide or single_layer(body) or bool(locking_by_volume(body))


def _beside(first: Answer, other: Answer) -> bool:
    """Whether an answer is of a higher order on the same cells."""
    return other.order > first.order and other.size < 1.1 * first.size


class ComparisonHistories:
    """The load history of a problem on the meshes for comparison, taken beside it, step by step.

    Args:
        progress: Called after every step of a solver.

    Raises:
        NoErrorBars: As of `error_of`.
    """

    def __init__(
        self, problem: ContactProblem, history: LoadHistory, tolerance: float, progress: ProgressCallback | None = None
    ):
        self._problem, self._history, self._tolerance, self._progress = problem, history, tolerance, progress
        self._steps: list[Iterator[LoadStep]] = []
        self._latest: list[LoadStep | None] = []
        self._refusal = self._uncompared = ""
        for one in next(other_problems(problem)):
            self._add(one)

    def _add(self, problem: ContactProblem) -> None:
        refuse_too_large(problem)
        self._steps.append(self._history.steps(problem, progress=self._progress))
        self._latest.append(None)

    def error_of(self, step: LoadStep) -> ErrorBars:
        """The error bars of a load step; the others advance to its time, or beyond where it was halved; collective.

        Raises:
            NoErrorBars: If another history fails, then for all later steps too, or has no step that ends at this time.
        """
        if self._refusal:
            raise NoErrorBars(self._refusal)
        answers, now = [answer_of(step.solution, self._tolerance)], step.state.time
        for number, steps in enumerate(self._steps):
            latest = self._latest[number]
            try:
                with without_remarks():
                    while latest is None or latest.state.time < now - 1e-12 * abs(now):
                        latest = self._latest[number] = next(steps)
            except (NotConverged, ValueError, StopIteration) as error:
                self._refusal = f"the load history failed on another mesh: {error}"
                raise NoErrorBars(self._refusal) from None
            if latest.state.time > now + 1e-12 * abs(now):
                raise NoErrorBars(f"no load step on another mesh ends at {now:g} s")
            answers.append(answer_of(latest.solution, self._tolerance))
        bars = bars_of(answers)
        if not _may_lock(self._problem, bars):
            return bars
        if not self._uncompared:  # second order takes all steps so far
            try:
                self._add(next(other_problems(self._problem, (same_cells,)))[0])
                return self.error_of(step)
            except ValueError as error:
                self._uncompared, self._refusal = f"{UNCOMPARED}: {error}", ""
                del self._steps[len(answers) - 1 :], self._latest[len(answers) - 1 :]
        return replace(bars, warnings=(*bars.warnings, self._uncompared))


def bars_of(answers: Sequence[Answer], unknown: float = 0.0) -> ErrorBars:
    """The error bars of the first of several answers of the same problem.

    Args:
        unknown: Volume by which the surface on which the finest meshes have their nodes may be wrong, over that of the
            body.

    Raises:
        NoErrorBars: If no other answer has other cells or another order.
    """
    first, *others = answers
    chain = [one for one in others if one.order == first.order and one.size > 1.1 * first.size]
    chain = sorted(chain, key=lambda one: one.size)[:2]
    beside = [one for one in others if one.order != first.order or one.size < 0.9 * first.size]  # else the same cells
    compared = [*chain, *beside]
    if not compared:
        raise NoErrorBars(
            "the answers are on the same cells with elements of the same order; give one on other cells, best coarser: "
            "solution.problem.on(other_mesh).solve()"
        )
    shape = SHAPE * (_unseen(first, compared) + unknown)
    bars = []
    for name, (value, unit) in first.totals.items():
        if not all(name in one.totals for one in compared):
            continue
        values = [one.totals[name][0] for one in compared]
        extreme = name.endswith(("greatest_pressure", "greatest_slip"))
        order, off = math.nan, np.zeros_like(value)
        if chain:
            bounds = (SLOWEST, OF_EXTREMES) if extreme else _bounds(first, chain[0])
            coarser = [(one.size, of) for one, of in zip(chain, values, strict=False)]
            order, off = extrapolated([(first.size, value), *coarser], *bounds)
        if beside:
            parts = [_part(first, one) * (2.0 if extreme else _better(first, one)) for one in beside]
            apart = np.array(
                [part * np.abs(other - value) for part, other in zip(parts, values[len(chain) :], strict=True)]
            )
            finer = np.array([one.size < 0.9 * first.size for one in beside])
            off = np.max([off, apart[~finer].sum(axis=0), *apart[finer]], axis=0)
        off = np.maximum(off, COMPONENT * np.max(off))
        border = np.full_like(value, first.border if name.endswith("contact_area") else 0.0)
        algebraic = np.full_like(value, max(one.algebraic[name] for one in (first, *compared)))
        if name.endswith("greatest_pressure"):
            order, off = _unless_singular((value, *values[: len(chain)]), off, order, float(algebraic[0]))
        geometry = shape * np.maximum(np.abs(value), COMPONENT * np.linalg.norm(value))
        bars.append(ErrorBar(name, unit, value, off, border, algebraic, order, (value, *values), geometry))
    stress = relative_stress_error(first.stress, [one.stress for one in compared])
    bar_of = {bar.quantity: bar for bar in bars}
    free, energy = ((one.value, one.discretisation) for one in (bar_of.pop(FREE), bar_of["strain_energy"]))
    largest = bar_of[LARGEST]
    least = least_bar(largest.value, energy, free, first.single, SAFETY)
    bar_of[LARGEST] = replace(largest, discretisation=np.maximum(largest.discretisation, least))
    second = [one for one in compared if _beside(first, one)]
    warnings = too_stiff(first.energies, second[0].energies, first.chord) if second else ()
    bar_of, missed = _with_missed_contact((first, *compared), bar_of)
    return ErrorBars(tuple(bar_of.values()), (first, *compared), stress, (*warnings, *missed, *first.few_chords))


def _with_missed_contact(
    answers: Sequence[Answer], bar_of: dict[str, ErrorBar]
) -> tuple[dict[str, ErrorBar], tuple[str, ...]]:
    """The bars, by place, with what contact would change that all answers miss: where no point of a contact face
    touches, but a displacement within its bar would close a gap, what gaps smaller by as much change of the answer with
    the most unknowns, which is not the stiffest; and a warning for each such face."""
    best, largest = max(answers, key=lambda one: one.unknowns), bar_of[LARGEST]
    part = (largest.value + largest.bar)[0] / best.totals[LARGEST][0][0] - 1.0 if best.missed else 0.0
    near = [name for name, least in best.missed.items() if least <= part and all(name in one.missed for one in answers)]
    if not near:
        return bar_of, ()
    into = "is not in the bars of forces"
    if best.nearer is not None:
        with suppress(NotConverged):
            changed = best.nearer(part)
            for name in changed.keys() & bar_of.keys():
                off = np.abs(changed[name][0] - best.totals[name][0])
                bar_of[name] = replace(bar_of[name], contact=bar_of[name].contact + off)
            into = "is in the bars as what smaller gaps change"
    said = (
        "nothing touches on {!r}, but a displacement within its error bar would close a gap: contact may be missed, {}"
    )
    return bar_of, tuple(said.format(name, f"and {into}") for name in near)


def _unseen(first: Answer, compared: Sequence[Answer]) -> float:
    """What of the volume between facets and the surface for which they stand the other answers do not show: all where
    these have the same facets, smaller or larger ones in the same planes included."""
    if all(one.order == first.order and abs(one.volume - first.volume) <= 1e-9 * first.volume for one in compared):
        return max(one.polygon for one in (first, *compared))
    return max(first.polygon - max(abs(one.polygon - first.polygon) for one in compared), 0.0)


def _bounds(first: Answer, coarser: Answer) -> tuple[float, float]:
    """Of the order of totals: that of the energy norm, by the errors of the stress on two meshes, and twice that (Aubin
    and Nitsche), but at most that of the displacement; not below SLOWEST and FASTEST, which they are if the errors are
    not known."""
    if not (first.stress_error > 0.0 and coarser.stress_error > 0.0):
        return SLOWEST, FASTEST
    order = math.log(coarser.stress_error / first.stress_error) / math.log(coarser.size / first.size)
    fastest = max(min(2.0 * order, first.order + 1.0), FASTEST)
    return min(max(order, SLOWEST), fastest), fastest


def _better(first: Answer, other: Answer) -> float:
    """By how much the error of second order is less than the difference from first order, where the errors of the
    stress tell: totals have errors between those of the energy norm and their squares, and the safe one counts."""
    if first.order <= other.order or not other.stress_error > 0.0 or math.isnan(first.stress_error):
        return 1.0
    return min(1.0, SAFETY * first.stress_error / other.stress_error)


def _part(first: Answer, other: Answer) -> float:
    """Error of an answer over its difference from one of another order, or on smaller cells; of bodies of both orders
    those of first over that from second order, and those of second over that from first, whose sum counts."""
    if first.order == other.order:
        return 1.0 / (1.0 - math.pow(other.size / first.size, SLOWEST))
    if first.order < other.order:
        return OF_THE_COARSER
    return OF_EQUALS if other.size < 0.9 * first.size else OF_THE_FINER


def extrapolated(
    chain: Sequence[tuple[float, FloatArray]], slowest: float = SLOWEST, fastest: float = FASTEST
) -> tuple[float, FloatArray]:
    """Observed order and error of the first of two or three values (k,) on cells of given sizes, from fine to coarse.

    The order is that of the vector as a whole.  For the errors each component has its own, bounded by `slowest` and
    `fastest`, and the larger error that the two differences imply.  Where these have opposite signs no power of the
    size explains them, and the smaller one may be small by accident: `slowest` counts.  Of two values the order is nan,
    and `slowest` for the error.
    """
    (h1, fine), (h2, middle), *rest = chain
    near = fine - middle
    if not rest:
        return math.nan, OF_TWO * np.abs(near) / ((h2 / h1) ** slowest - 1.0)
    h3, coarse = rest[0]
    far = middle - coarse
    orders = np.linspace(-2.0, 4.0, 601)
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = np.log(np.abs(h3**orders - h2**orders)) - np.log(np.abs(h2**orders - h1**orders))
        sizes = np.abs([[*far, np.linalg.norm(far)], [*near, np.linalg.norm(near)]])
        seen = np.subtract(*np.log(sizes))
    growth[np.abs(orders) < 1e-9] = np.log(np.log(h3 / h2) / np.log(h2 / h1))
    *own, order = np.interp(seen, growth, orders)
    q = np.where(near * far < 0.0, slowest, np.clip(np.nan_to_num(own, nan=fastest), slowest, fastest))
    implied = np.maximum(np.abs(near) / (h2**q - h1**q), np.abs(far) / (h3**q - h2**q))
    return float(order), SAFETY * h1**q * implied


def _unless_singular(
    values: Sequence[FloatArray], bar: FloatArray, order: float, least: float
) -> tuple[float, FloatArray]:
    """Order and bar of a largest pressure by its values (1,) on the meshes, from fine to coarse; nan as bar if it does
    not converge: its order is about 0, or it is not known, and the bar is a fifth of it or more.  Both are nan if it
    goes up and down by more than the solver leaves, and settles more slowly than smooth answers."""
    value = values[0]
    if not np.any(value):
        return order, bar
    if math.isfinite(order):
        near, far = -np.diff(np.concatenate(values))
        if near * far < 0.0 and order < SMOOTH and abs(near) > least:
            return math.nan, np.full_like(bar, math.nan)
    singular = order < DIVERGING if math.isfinite(order) else bool(np.any(bar > 0.2 * np.abs(value)))
    return order, np.full_like(bar, math.nan) if singular else bar


def _plain(values: FloatArray) -> float | list[float]:
    return float(values[0]) if len(values) == 1 else [float(value) for value in values]
