"""A load step: what it starts from, what it leaves, and its line of history.csv."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..io.summary import summary, totals
from ..linalg.reductions import Reductions
from .solution import Solution

_IMBALANCE = 0.25  # of the energy of friction
_OF_ALL = 1e-3  # of all energy


@dataclass(frozen=True)
class Energy:
    """In joules, from the start of the history.

    Attributes:
        loads: Work of tractions and body force.
        prescribed: Work of the reactions at prescribed displacements.
        foundation: Work that the moving foundation does on the body.
        elastic: Energy kept in the body and in its elastic supports.
        dissipated: By friction.
    """

    loads: float = 0.0
    prescribed: float = 0.0
    foundation: float = 0.0
    elastic: float = 0.0
    dissipated: float = 0.0

    @property
    def imbalance(self) -> float:
        """Work done, less what is kept and what is dissipated: the error of finite steps."""
        return self.loads + self.prescribed + self.foundation - self.elastic - self.dissipated

    def warning(self, rounding: float = 0.0) -> str:
        """What to say where the imbalance is large, and more than rounding in joules; empty where it is not.

        Large is more than a quarter of what friction dissipates, which is what finite steps get wrong; and more than a
        thousandth of all energy that was turned over, so that a history that hardly slips is not blamed for nothing.
        """
        work = self.loads + self.prescribed + self.foundation
        turned_over = max(abs(work), self.elastic, self.dissipated)
        small = max(_IMBALANCE * abs(self.dissipated), _OF_ALL * turned_over, rounding)
        if abs(self.imbalance) <= small:  # False for nan
            return ""
        return (
            f"the energies do not add up, by {self.imbalance:.2g} J beside {self.dissipated:.2g} J of friction: take "
            "more load steps, and let loads, clamps and motions that jump grow from 0 (amplitude)"
        )

    def after(
        self,
        then: Forces,
        now: Forces,
        fixed: npt.NDArray[np.bool_],
        moved: FloatArray,
        dissipated: float,
        over: Reductions,
    ) -> Energy:
        """The energy at the end of a step; collective.

        Args:
            then: At its beginning.
            now: At its end.
            fixed: Which components of this rank's nodes are prescribed, shape (k, 3).
            moved: Way of the foundation in the step at the contact nodes in metres, 0 elsewhere, shape (k, 3).
            dissipated: By friction in the step, joules.
            over: The ranks.
        """
        change = now.displacement - then.displacement
        reactions = sum(np.where(fixed, at.kept - at.load - at.on_body, 0.0) for at in (then, now))
        return Energy(
            loads=self.loads + 0.5 * over.dot(now.load + then.load, change),
            prescribed=self.prescribed + 0.5 * over.dot(np.asarray(reactions), change),
            foundation=self.foundation + 0.5 * over.dot(now.on_body + then.on_body, moved),
            elastic=0.5 * over.dot(now.displacement, now.kept),
            dissipated=self.dissipated + dissipated,
        )


@dataclass(frozen=True)
class Forces:
    """Displacement and forces at this rank's k nodes at one time, shapes (k, 3); metres and newtons.

    Attributes:
        displacement: Of the nodes.
        load: Of tractions and body force.
        kept: Of the stress, and what the springs resist with.
        on_body: Contact forces on the body.
    """

    displacement: FloatArray
    load: FloatArray
    kept: FloatArray
    on_body: FloatArray


@dataclass(frozen=True)
class State:
    """What a step leaves to the next; this rank's part.

    Attributes:
        number: Of the step, from 1; 0 before the first.
        time: When.
        displacement: Metres, shape (k, 3).
        on_body: Nodal contact forces on the body in newtons, shape (k, 3).
        energy: Since the start.
        pending: Times still to be reached, the next one last.
    """

    number: int
    time: float
    displacement: FloatArray
    on_body: FloatArray
    energy: Energy
    pending: tuple[float, ...]

    def after(self, solution: Solution) -> State:
        """The state at the end of the next step, energies brought up to date; collective."""
        problem, elasticity = solution.problem, solution.problem.elasticity

        def forces(u: FloatArray, load: FloatArray, on_body: FloatArray) -> Forces:
            return Forces(u, load, elasticity.internal_force(u) - elasticity.spring_force(u), on_body)

        then = forces(self.displacement, elasticity.at(self.time).load, self.on_body)
        now = forces(solution.displacement, elasticity.load, -problem.nodal_contact_force(solution.contact_force))
        moved = np.zeros_like(now.displacement)
        moved[problem.surface.nodes] = (problem.motions - problem.motions_at(self.time))[problem.surface.part]
        dissipated = totals(solution)["dissipated_energy"]
        energy = self.energy.after(then, now, elasticity.fixed, moved, dissipated, Reductions(problem.comm))
        return State(self.number + 1, problem.time, now.displacement, now.on_body, energy, self.pending[:-1])


@dataclass(frozen=True)
class LoadStep:
    """One step that has been taken.

    Attributes:
        solution: The answer at its end; `solution.problem` has the loads of that time.
        state: What it leaves to the next.
        halvings: How often its interval had to be halved.
    """

    solution: Solution
    state: State
    halvings: int

    @property
    def row(self) -> dict[str, Any]:
        """Its line of history.csv; collective."""
        return row(summary(self.solution), self.state.number, self.state.time, self.state.energy)


def row(told: dict[str, Any], number: int, time: float, energy: Energy) -> dict[str, Any]:
    """The line of history.csv of a step: from its summary, its number and time, and the energy since the start."""
    face = told["totals"]
    centre = face["centre_of_pressure"] or [math.nan] * 3
    axes = ("x", "y", "z")
    several = told["faces"] if len(told["faces"]) > 1 else []
    return {
        "step": number,
        "time": time,
        **{f"force_{a}": value for a, value in zip(axes, face["force"], strict=True)},
        **{f"moment_{a}": value for a, value in zip(axes, face["moment"], strict=True)},
        "normal_force": told["force_on_body"]["normal"],
        "contact_area": face["contact_area"],
        **{f"centre_of_pressure_{a}": value for a, value in zip(axes, centre, strict=True)},
        "greatest_slip": face["greatest_slip"],
        "greatest_pressure": told["maximum"]["contact_pressure"],
        **{name: told["nodes"][name] for name in ("open", "stick", "slip")},
        **{
            f"{part['faces'][0]}_force_{a}": value
            for part in several
            for a, value in zip(axes, part["force"], strict=True)
        },
        **{f"energy_{name}": value for name, value in asdict(energy).items()},
        "energy_imbalance": energy.imbalance,
        "path_following": told["iterations"]["path_following"],
        "residual": told["residual"],
        "certified": told["certificate"]["passed"],
        "valid": told["valid"],
    }
