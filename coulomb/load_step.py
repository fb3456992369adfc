"""A load step: what it starts from, what it leaves, and its line of history.csv."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .arrays import FloatArray
from .solution import Solution
from .solvers.reductions import Reductions
from .summary import summary, totals


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
        problem, u = solution.problem, solution.displacement
        over, elasticity = Reductions(problem.comm), problem.elasticity
        then = elasticity.at(self.time)
        on_body = -problem.nodal_contact_force(solution.contact_force)
        change = u - self.displacement
        kept, kept_then = (elasticity.internal_force(v) - elasticity.spring_force(v) for v in (u, self.displacement))
        reactions = np.where(elasticity.fixed, kept - elasticity.load - on_body, 0.0)
        reactions += np.where(elasticity.fixed, kept_then - then.load - self.on_body, 0.0)
        moved = (problem.motions - problem.motions_at(self.time))[problem.surface.part]
        dissipated = totals(solution)["dissipated_energy"]
        touching = 0.5 * (on_body + self.on_body)[problem.surface.nodes]
        energy = Energy(
            loads=self.energy.loads + 0.5 * over.dot(elasticity.load + then.load, change),
            prescribed=self.energy.prescribed + 0.5 * over.dot(reactions, change),
            foundation=self.energy.foundation + over.dot(touching, moved),
            elastic=0.5 * over.dot(u, kept),
            dissipated=self.energy.dissipated + dissipated,
        )
        return State(self.number + 1, problem.time, u, on_body, energy, self.pending[:-1])


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
        told, energy = summary(self.solution), self.state.energy
        face = told["totals"]
        centre = face["centre_of_pressure"] or [math.nan] * 3
        axes = ("x", "y", "z")
        several = told["faces"] if len(told["faces"]) > 1 else []
        return {
            "step": self.state.number,
            "time": self.state.time,
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
        }
