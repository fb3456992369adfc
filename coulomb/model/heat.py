"""Steady heat conduction through bodies and contacts, and its balance.

At a contact point of area a, pressure p and conductance h(p) (`ThermalContact`), the heat a h (T - T') flows from the
face to what is opposite, where T and T' are the averages by which slip and gap are measured (`ContactPoints`): with
these, uniform heat flux is exact whatever the meshes.  Friction heats both faces with |friction force| times slip rate,
the slip of a load step over its duration; without load steps there is no rate.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from petsc4py import PETSc

from ..arrays import FloatArray
from ..contact_fields import side_names
from ..fem.bodies import Conduction, Deformable, HeatLoad, diagonal_of, distributed_rows, matrix_product, range_of
from ..fem.contact import ContactSurface
from ..linalg.petsc_arrays import configured_ksp
from ..linalg.reductions import Reductions
from .certificate import Check
from .contact import Contact

BALANCED: Final = 1e-8
"""Largest sum of all heat flows, relative to those into the bodies."""

UNBALANCED: Final = Check("heat", 1.0, BALANCED, "", "contact and heat agree, and as much heat flows out as in")
"""Of an answer without heat flows, for the certificate: all heat is missing."""

_NO_FLOW: Final = 1e-13
"""Heat flows below this part of K times the temperatures are rounding errors."""

_NOTHING: Final = 1e-15
"""Changes of temperature below this part of the largest are rounding errors."""

_CG = {"pc_type": "gamg", "ksp_rtol": 1e-10, "ksp_max_it": 1000, "ksp_norm_type": "unpreconditioned"}

_SOLVES: Final = 3
"""The residual of a solve is assembled anew and solved for again: temperatures are large beside their differences."""

_SINGULAR: Final = 1e-14
"""Smallest eigenvalue of conduction between components, over its diagonal, at which a temperature is not fixed."""


@dataclass(frozen=True)
class HeatFlow:
    """Heat that flows into the bodies.

    Attributes:
        kind: "temperature", "heat flux", "film", "heat source", "friction", or "foundation": what it takes of friction
            and by conduction.
        face: The face, with that opposite where it is in several contacts (`side_names`); None in the volume.
        power: In watts, negative where it flows out.
        number: 2 of the second one of its kind there.
    """

    kind: str
    face: str | None
    power: float
    number: int = 1

    @property
    def name(self) -> str:
        """In history.csv."""
        words = [self.kind, *([] if self.face is None else [self.face]), *([str(self.number)] * (self.number > 1))]
        return "heat_" + "_".join(" ".join(words).split())


@dataclass(frozen=True, eq=False)
class Heat:
    """Temperatures and heat flows; this rank's k nodes and m contact points.

    Attributes:
        change: Temperature less the reference in kelvin, shape (k,).
        reference: Temperature of the unstrained bodies.
        flows: Heat flows into the bodies, over all ranks.
        through: Of every contact the heat that is conducted out of its face, watts.
        limit: Largest `imbalance` that counts as balanced, watts.
        range: Smallest and largest change, over all ranks.
        rounds: How often contact and conduction were solved in turn.
        agreement: Change of temperature in the last round over the largest.
    """

    change: FloatArray
    reference: float
    flows: tuple[HeatFlow, ...]
    through: tuple[float, ...]
    limit: float
    range: dict[str, float]
    rounds: int = 0
    agreement: float = 0.0

    @property
    def temperature(self) -> FloatArray:
        """In the unit of the reference, shape (k,)."""
        return self.reference + self.change

    @property
    def power_in(self) -> float:
        """Sum of the flows into the bodies, watts."""
        return sum(max(flow.power, 0.0) for flow in self.flows)

    @property
    def imbalance(self) -> float:
        """Sum of all flows, watts: 0 in a steady state."""
        return sum(flow.power for flow in self.flows)

    @property
    def balanced(self) -> bool:
        """Whether as much heat flows out as in."""
        return abs(self.imbalance) <= self.limit

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        return {
            "temperature": {name: self.reference + value for name, value in self.range.items()},
            "flows": [
                {"name": flow.name, "kind": flow.kind, "face": flow.face, "power": flow.power} for flow in self.flows
            ],
            "through_contacts": list(self.through),
            "power_in": self.power_in,
            "imbalance": self.imbalance,
            "limit": self.limit,
            "balanced": self.balanced,
            "rounds": self.rounds,
            "agreement": self.agreement,
        }


@dataclass(frozen=True, eq=False)
class _Through:
    """What contact adds: averages of temperature over the faces `on` (m, nodes), and their `difference` to those
    opposite, distributed; conductances (m,) in W/K, and changes of temperature (m,) of what is opposite but no body.
    """

    on: PETSc.Mat
    difference: PETSc.Mat
    conductance: FloatArray
    beyond: FloatArray


class HeatProblem:
    """Steady conduction in bodies that are in contact.

    Args:
        loads: What heats and cools them.
        contacts: The contacts, with the slave of pairs as face.
        reference: Temperature of the unstrained bodies.

    Raises:
        ValueError: As `Conduction`.
    """

    def __init__(self, bodies: Deformable, loads: Sequence[HeatLoad], contacts: Sequence[Contact], reference: float):
        self.bodies, self.contacts, self.reference = bodies, tuple(contacts), reference
        self.conduction, self._over = Conduction(bodies, loads, reference), Reductions(bodies.comm)
        self._averages: tuple[ContactSurface, PETSc.Mat, PETSc.Mat] | None = None

    def solve(
        self, surface: ContactSurface, time: float, pressure: FloatArray, friction: FloatArray, start: FloatArray
    ) -> FloatArray:
        """Changes of temperature (k,) in kelvin at a time; collective.

        Args:
            pressure: At the contact points, pascals, shape (m,).
            friction: Power of friction there, watts, shape (m,).
            start: Changes from which to start, shape (k,).

        Raises:
            ValueError: On every rank, if nothing fixes the temperature of a body, an amplitude has no value, or the
                linear solver fails.
        """
        conduction, through = self.conduction, self._through(surface, pressure)
        factors = conduction.factors(time)
        scaled = through.difference.copy()
        conductance = scaled.createVecLeft()
        conductance.array[:] = through.conductance
        scaled.diagonalScale(L=conductance)
        conductance.destroy()
        A = through.difference.transposeMatMult(scaled)
        A.axpy(1.0, conduction.K)
        mean = self._over.sum(diagonal_of(A)) / max(self.bodies.numbering.total, 1)
        reduced = conduction.reduced(A, mean)
        self._refuse_singular(reduced)
        heat = conduction.heat(factors).sum(axis=0) + self._friction(surface, through, friction)
        heat += matrix_product(through.difference, through.conductance * through.beyond, transposed=True)
        fixed = conduction.fixed
        change = conduction.lifted(np.where(fixed, conduction.prescribed(factors), start))
        rows = conduction.bodies.numbering.first + np.flatnonzero(fixed)
        reduced.zeroRowsColumns(rows.astype(PETSc.IntType), mean)
        reduced.setOption(PETSc.Mat.Option.SPD, True)
        try:
            ksp = configured_ksp(reduced, "cg", _CG)
            for _ in range(_SOLVES):
                residual = np.where(fixed, 0.0, conduction.transferred(heat - matrix_product(A, change)))
                if self._over.max(np.abs(residual)) == 0.0:
                    break
                rhs, x = reduced.createVecs()
                rhs.array[:] = residual
                ksp.solve(rhs, x)
                change = change + conduction.lifted(x.array_r)
                rhs.destroy()
                x.destroy()
            ksp.destroy()
        except PETSc.Error as error:
            raise ValueError(f"heat: the temperatures are not found by multigrid: {error}") from None
        for matrix in (scaled, A, reduced):
            matrix.destroy()
        return np.where(np.abs(change) > _NOTHING * self._over.max(np.abs(change)), change, 0.0)

    def flows(
        self, surface: ContactSurface, time: float, pressure: FloatArray, friction: FloatArray, change: FloatArray
    ) -> Heat:
        """The heat flows at changes of temperature (k,); other arguments as of `solve`; collective."""
        conduction, through = self.conduction, self._through(surface, pressure)
        over = Reductions(self.bodies.comm, self.bodies.copies)
        factors = conduction.factors(time)
        given, films = conduction.heat(factors), conduction.through_films(change)
        passing = through.conductance * (matrix_product(through.difference, change) - through.beyond)
        brought = given.sum(axis=0) + self._friction(surface, through, friction)
        brought -= matrix_product(through.difference, passing, transposed=True)
        inner = matrix_product(conduction.K, change)
        missing = conduction.transferred(inner - brought)
        flows: list[HeatFlow] = []
        seen: Counter[tuple[str, str | None]] = Counter()

        def flow(kind: str, face: str | None, power: float) -> None:
            seen[kind, face] += 1
            flows.append(HeatFlow(kind, face, power, seen[kind, face]))

        for number, load in enumerate(conduction.loads):
            if load.temperature is not None:
                power = over.sum(missing[conduction.fixed_by == number])
            else:
                power = over.sum(given[number]) - over.sum(films[number])
            flow(load.kind, load.face, power)
        conducted, sides = [], side_names((contact.face, contact.against) for contact in self.contacts)
        for part, (contact, (side, _)) in enumerate(zip(self.contacts, sides, strict=True)):
            here = surface.part == part
            rubbed, passed = over.sum(friction[here]), over.sum(passing[here])
            conducted.append(passed)
            flow("friction", side, rubbed)
            if contact.against is None:
                taken = (1.0 - contact.thermal.share) * rubbed
                flow("foundation", side, -passed - taken)
        size = over.sum(diagonal_of(conduction.K) * np.abs(change))
        power_in = sum(max(flow.power, 0.0) for flow in flows)
        limit = BALANCED * power_in + _NO_FLOW * size
        ends = range_of(change, self.bodies.comm)
        return Heat(change, self.reference, tuple(flows), tuple(conducted), limit, ends)

    def _friction(self, surface: ContactSurface, through: _Through, friction: FloatArray) -> FloatArray:
        """Heat of friction (m,) in watts at this rank's nodes, shape (k,); collective."""
        share = np.array([contact.thermal.share for contact in self.contacts])[surface.part]
        paired = np.array([contact.against is not None for contact in self.contacts])[surface.part]
        other = np.where(paired, 1.0 - share, 0.0) * friction  # opposite averages are those on less the difference
        on_both = matrix_product(through.on, share * friction + other, transposed=True)
        return on_both - matrix_product(through.difference, other, transposed=True)

    def _through(self, surface: ContactSurface, pressure: FloatArray) -> _Through:
        if self._averages is None or self._averages[0] is not surface:
            size = (self.bodies.numbering.local, self.bodies.numbering.total)
            on, difference = (
                distributed_rows(rows, size, self.bodies, None)
                for rows in (surface.points.weights, surface.points.difference)
            )
            self._averages = surface, on, difference
        conductance, beyond = np.zeros((2, len(pressure)))
        for part, contact in enumerate(self.contacts):
            here = surface.part == part
            conductance[here] = surface.area[here] * contact.thermal.at(
                pressure[here], surface.x[here], f"contact face {contact.face!r}", self.bodies.comm
            )
            if contact.thermal.temperature is not None:
                beyond[here] = contact.thermal.temperature - self.reference
        return _Through(self._averages[1], self._averages[2], conductance, beyond)

    def _refuse_singular(self, A: PETSc.Mat) -> None:
        """Check that a prescribed temperature, a film or a foundation is reached from each component of the meshes."""
        component = self.bodies.component
        count = int(self._over.max(component.astype(np.float64))) + 1
        free = ~self.conduction.follows[:, None]
        indicator = ((component[:, None] == np.arange(count)) & free).astype(np.float64)
        between = self._over.total(indicator.T @ np.column_stack([matrix_product(A, one) for one in indicator.T]))
        whole = self._over.total(indicator.T @ diagonal_of(A))
        held = self._over.total(indicator.T @ self.conduction.fixed.astype(np.float64)) > 0.0
        held, whole = held | (whole == 0.0), np.where(whole == 0.0, 1.0, whole)  # all of its nodes follow others
        scaled = between / np.sqrt(np.outer(whole, whole)) + np.diag(held.astype(np.float64))
        sizes, vectors = np.linalg.eigh(scaled)
        if sizes[0] > _SINGULAR:
            return
        worst = int(np.argmax(np.abs(vectors[:, 0])))
        here = [member.name or "the body" for member in self.bodies.members if np.any(component[member.nodes] == worst)]
        named = next(names[0] for names in self.bodies.comm.allgather(here) if names)
        raise ValueError(
            f"heat: nothing fixes the temperature of {named}: give one of its faces a temperature or a film, or let it "
            "touch what has one, with a conductance (thermal)"
        )
