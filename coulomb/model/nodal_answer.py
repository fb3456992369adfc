"""Fields, totals and counts derived from displacement and contact forces at the contact nodes.

The input comes from a problem and its answer when they are written, or from the files when these are checked.

Fields are carried over to the master face of a pair.  Forces there are exact: a force at a contact point acts on the
nodes opposite by the weights of its row.  Pressures are not these forces over nodal areas, which vary from node to node
with the ratio of the two meshes.  They are those of the contact points, averaged with the weights transposed,

    p_j = sum_i W_ij p_i / sum_i W_ij,      W_ij = a_i |weight of node j in the average opposite to point i|
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.sparse
from mpi4py import MPI

from ..arrays import BoolArray, FloatArray, IntArray
from ..contact_fields import CONTACT_FIELDS, names
from ..fem.bodies import distributed_rows, matrix_product
from ..fem.contact import ContactPoints
from ..fem.geometry import Spin, inverse_frames, tangent_lengths
from ..linalg.reductions import Reductions
from ..solvers.laws import FrictionLaw

OPEN, STICK, SLIP, HELD = 0, 1, 2, 3
"""Status of a node in contact.xdmf; HELD: on the contact face, but with prescribed displacement, or with no part of the
face against it opposite, so no contact node (all fields 0)."""

_NO_FRICTION: Final = 1e-12
"""Part of all nodal forces up to which the resultant of friction is 0."""

OPEN_BELOW: Final = 1e-9
"""A node is open if its normal force is at most this fraction of the largest; `zero_open_forces` then makes it 0."""

SLIP_ABOVE: Final = 0.999
"""A node slips if its friction is at least this fraction of its bound."""


def _or_none(largest: float) -> float:
    """The largest of values over all ranks, 0 if there are none."""
    return 0.0 if largest == -math.inf else largest


@dataclass(frozen=True, eq=False)
class Accumulated:
    """What m contact nodes have gone through since the start of the history; zero at first.

    Friction work is that of `NodalAnswer.friction_work`, as in `Energy.dissipated`, so that the work over the face is
    that energy.  A node that is open at the end of a step does not accumulate slip in it: distance covered without
    contact is no wear.  Where friction does not depend on pressure (cohesion, Tresca), it also works at open nodes.

    Attributes:
        slip: Sum of the lengths of the slip increments in contact, metres, shape (m,).
        friction_work: Work of friction per area, J/m^2, shape (m,): the sum of traction times slip increment, positive
            where the node slips, and zero up to the tolerance of the solver where it sticks.
        pressure: Largest pressure at the end of any step, pascals, shape (m,).
    """

    slip: FloatArray
    friction_work: FloatArray
    pressure: FloatArray

    @classmethod
    def none(cls, count: int) -> Accumulated:
        """At the start of a history, at this many nodes."""
        return cls(*np.zeros((3, count)))

    def after(
        self, slip: FloatArray, friction_work: FloatArray, pressure: FloatArray, closed: BoolArray
    ) -> Accumulated:
        """After another step, with the slip in it (space vectors in metres, shape (m, 3)), its friction work per area
        in J/m^2, the pressures in pascals and which nodes are in contact at its end."""
        length = np.where(closed, np.linalg.norm(slip, axis=1), 0.0)
        work: FloatArray = self.friction_work + friction_work
        return Accumulated(self.slip + length, work, np.maximum(self.pressure, pressure))

    def at(self, nodes: BoolArray | IntArray) -> Accumulated:
        """At some of the nodes."""
        return Accumulated(self.slip[nodes], self.friction_work[nodes], self.pressure[nodes])


ACCUMULATED = names(shown="history")
"""Their names in contact.xdmf."""


@dataclass(frozen=True, eq=False)
class NodalAnswer:
    """An answer at this rank's m contact nodes; newtons and metres.

    Attributes:
        law: Of friction at these nodes.
        part: Which of them a node is on, shape (m,).
        x: Coordinates, shape (m, 3).
        frames: Rows n, t1, t2, shape (m, 3, 3), as `ContactSurface.frames`: t1 and t2 are shorter where friction is
            orthotropic.  Components along them are such that forces on the body are -B^T x and displacements B u.
        gap: Before deformation, shape (m,).
        given_gap: The part of it that is given beside the distance to the foundation, shape (m,).
        chord: As `ContactSurface.chord`, shape (m, 3).
        area: In m^2, shape (m,).
        slip_origin: Displacement from which slip is measured, along n, t1, t2, shape (m, 3).
        displacement: Along n, t1, t2, shape (m, 3).
        force: Along n, t1, t2, shape (m, 3); x_n >= 0 presses.
        slip_bound: Slip bound used by the solver, shape (m,).
        compliance: Diagonal of A, of both tangents the mean, metres per newton, shape (m, 3).
        spins: Rotations of the foundations of the faces; None where there is none.
        earlier: What has accumulated in the load steps before.
        force_before: The forces on the body after the load step before, space vectors, shape (m, 3).
        against: Of each contact face the face opposite, if it is one of a pair; else None.  Empty without pairs.
        opposite_x: Where the forces act on the faces opposite, shape (m, 3); 0 on faces against a foundation.  None
            without pairs.
        copies: How many layers as the mesh make the body, of which forces, areas and energies in all are
            (`Deformable.copies`).
    """

    comm: MPI.Comm
    law: FrictionLaw
    faces: tuple[str, ...]
    part: IntArray
    x: FloatArray
    frames: FloatArray
    gap: FloatArray
    given_gap: FloatArray
    chord: FloatArray
    area: FloatArray
    slip_origin: FloatArray
    displacement: FloatArray
    force: FloatArray
    slip_bound: FloatArray
    compliance: FloatArray
    spins: tuple[Spin | None, ...]
    earlier: Accumulated
    force_before: FloatArray
    against: tuple[str | None, ...] = ()
    opposite_x: FloatArray | None = None
    several: bool = False
    copies: float = 1.0

    @property
    def _over(self) -> Reductions:
        """For totals of the body."""
        return Reductions(self.comm, self.copies)

    @cached_property
    def scale(self) -> FloatArray:
        """Lengths of t1 and t2: 1, or with orthotropic friction F1/F and F2/F; shape (m, 2)."""
        return tangent_lengths(self.frames)

    @cached_property
    def relative_displacement(self) -> FloatArray:
        """Displacement along n, and slip along t1 and t2, shape (m, 3)."""
        return relative_displacement(self.displacement, self.slip_origin)

    @cached_property
    def bound(self) -> FloatArray:
        """Slip bound of the law at these forces in newtons, shape (m,)."""
        return self.law.radius(self.force[:, 0])

    @cached_property
    def cohesion(self) -> FloatArray:
        """Cohesion in pascals, shape (m,)."""
        return self.law.cohesion / self.area

    @property
    def friction(self) -> FloatArray:
        """Coefficient of friction at these forces, shape (m,)."""
        return self.law.coefficient(self.force[:, 0])

    @cached_property
    def on_body(self) -> FloatArray:
        """The forces on the body as space vectors, shape (m, 3)."""
        return -self._vectors(self.force)

    @cached_property
    def displacement_vectors(self) -> FloatArray:
        """Displacement as space vectors, shape (m, 3)."""
        return self._displacements(self.displacement)

    @cached_property
    def slip(self) -> FloatArray:
        """Slip from `slip_origin`, space vectors in the tangent plane, shape (m, 3)."""
        slip = self.relative_displacement.copy()
        slip[:, 0] = 0.0
        return self._displacements(slip)

    @cached_property
    def _friction(self) -> FloatArray:
        return np.hypot(self.force[:, 1], self.force[:, 2])

    @property
    def pressure(self) -> FloatArray:
        """Normal force over area, pascals, shape (m,)."""
        return self.force[:, 0] / self.area

    @property
    def friction_traction(self) -> FloatArray:
        """Of friction on the body, space vectors in pascals, shape (m, 3)."""
        tangential = self.force.copy()
        tangential[:, 0] = 0.0
        return -self._vectors(tangential) / self.area[:, None]

    @property
    def friction_use(self) -> FloatArray:
        """Friction over its bound; 0 where the node is open; shape (m,); collective."""
        use = self._friction / np.where(self.bound > 0.0, self.bound, np.inf)
        return np.where(self.status == OPEN, 0.0, use)

    @property
    def slip_origin_in_space(self) -> FloatArray:
        """`slip_origin` as space vectors, shape (m, 3)."""
        return self._displacements(self.slip_origin)

    @cached_property
    def _open(self) -> BoolArray:
        normal = self.force[:, 0]
        return normal <= OPEN_BELOW * Reductions(self.comm).max(normal)

    @cached_property
    def _at_bound(self) -> BoolArray:
        return self._friction >= SLIP_ABOVE * self.bound

    @cached_property
    def status(self) -> IntArray:
        """OPEN, STICK or SLIP, shape (m,); collective."""
        return np.where(self._open, OPEN, np.where(self._at_bound, SLIP, STICK))

    @cached_property
    def work_at_end(self) -> FloatArray:
        """Friction at the end of the load step times its slip, joules, shape (m,): over its time, the power of friction
        at the end."""
        return np.sum(self.force[:, 1:] * self.relative_displacement[:, 1:], axis=1)

    @cached_property
    def friction_work(self) -> FloatArray:
        """Work of friction in the load step, joules, shape (m,); collective.

        By the law with the forces at its end, friction would not work where a node slides and leaves, and too little
        where it slides as its pressure falls.  So where a node touches at the start, the bound of friction counts with
        the mean of its values at start and end.  One that is open at the end slips in contact, as long as a spring of
        its own compliance presses, on the part x_n a / (x_n a + gap) of its way, at half of its friction on average.
        """
        before = -np.einsum("kij,kj->ki", inverse_frames(self.frames), self.force_before)
        normal, tangential, slip = np.maximum(before[:, 0], 0.0), before[:, 1:], self.relative_displacement[:, 1:]
        bound, size = self.law.radius(normal), np.hypot(*tangential.T)
        friction = tangential * np.divide(bound, size, out=np.ones_like(size), where=size > bound)[:, None]
        closing, apart = normal * self.compliance[:, 0], np.maximum(self.gap - self.displacement[:, 0], 0.0)
        part = np.divide(closing, closing + apart, out=np.zeros_like(closing), where=closing > 0.0)
        leaving = 0.5 * part * np.maximum(np.sum(friction * slip, axis=1), 0.0)
        staying = 0.5 * (self.work_at_end + bound * np.hypot(*slip.T))
        left = self._open & (self.law.radius(np.zeros_like(normal)) == 0.0)  # a cohesion acts on open nodes too
        touched = normal > OPEN_BELOW * Reductions(self.comm).max(normal)
        return np.where(touched, np.where(left, leaving, staying), self.work_at_end)

    @cached_property
    def accumulated(self) -> Accumulated:
        """Slip, friction work and largest pressure since the start of the history, with this answer; collective."""
        return self.earlier.after(self.slip, self.friction_work / self.area, self.pressure, ~self._open)

    @property
    def dissipated_energy(self) -> float:
        """Work of friction against slip from `slip_origin`, joules; collective."""
        return self._over.sum(self.work_at_end)

    @property
    def coefficient(self) -> FloatArray:
        """Friction F; slip stress in pascals where all ranks have Tresca's law; shape (m,); collective."""
        return self.cohesion if self.law.name(Reductions(self.comm)) == "tresca" else self.friction

    def fields(self) -> dict[str, FloatArray]:
        """The `CONTACT_FIELDS` of contact.xdmf, scalars (m,) and space vectors (m, 3); collective."""
        return {field.name: field.values(self) for field in CONTACT_FIELDS}

    def totals(self, part: int | None = None) -> dict[str, Any]:
        """Totals of the contact, or of one of its faces; newtons and metres; collective, the same on all ranks.

        Force and moment (about the origin) are those on the body.  The centre of pressure is the mean position
        of the normal forces, null without any.  Slip and dissipated energy are measured from `slip_origin`.

        The normal force is the sum of those of the nodes; the friction force is the size of the resultant of theirs.

        Of several faces together there are no normal force, friction force and centre of pressure, which are about one
        face, and force and moment only where one body touches foundations alone: forces on different bodies have no
        sum.
        """
        alone = part is not None or len(self.faces) == 1
        here = self.part == part if part is not None else np.ones(len(self.part), dtype=bool)
        over, force, x = self._over, self.force[here], self.x[here]
        on_body, slip = self.on_body[here], (self.relative_displacement[:, 1:] / self.scale)[here]
        closed = ~self._open[here]
        pressing = over.sum(force[:, 0])
        moving = np.hypot(slip[:, 0], slip[:, 1])
        centre = over.total(force[:, 0] @ x) / pressing if pressing > 0.0 else None
        force_on_body = over.total(on_body.sum(axis=0)).tolist()
        moment = over.total(np.cross(x, on_body).sum(axis=0)).tolist()
        friction = float(np.linalg.norm(over.total((self.friction_traction * self.area[:, None])[here].sum(axis=0))))
        rounding = _NO_FRICTION * over.sum(np.linalg.norm(on_body, axis=1))
        return {
            "faces": list(self.faces) if part is None else [self.faces[part]],
            **({"force": force_on_body, "moment": moment} if alone or self._on_one_body else {}),
            **({"normal_force": pressing, "friction_force": friction if friction > rounding else 0.0} if alone else {}),
            "contact_area": over.sum(self.area[here][closed]),
            **({"centre_of_pressure": None if centre is None else centre.tolist()} if alone else {}),
            "greatest_slip": max(over.max(moving[closed]), 0.0),
            "greatest_pressure": _or_none(over.max(force[:, 0] / self.area[here])),
            "dissipated_energy": over.sum(self.work_at_end[here]),
        }

    def numbers(self) -> dict[str, Any]:
        """The entries of summary.json that follow from the contact nodes alone; collective, the same on all ranks."""
        over, x = Reductions(self.comm), self.force
        rubbing = ~self._open | (self.bound > 0.0)  # a cohesion acts on open nodes too
        slip, stick = self._at_bound & rubbing, ~self._at_bound & rubbing
        counts = {"contact": np.ones(len(x)), "open": self._open, "stick": stick, "slip": slip}
        return {
            **self.law.numbers(self.area, self.scale, over),
            **self._force_on_body(),
            "totals": self.totals(),
            "faces": [
                {**self.totals(part), **self._opposite(part), **self._rotation(part), **self._law_numbers(part)}
                for part in range(len(self.faces))
            ],
            "accumulated": self._accumulated_numbers(),
            "nodes": {name: int(over.sum(which.astype(float))) for name, which in counts.items()},
        }

    @property
    def _on_one_body(self) -> bool:
        """Whether all contact is that of one body with foundations."""
        return not self.several and not any(self.against)

    def _force_on_body(self) -> dict[str, Any]:
        """The entry of the force on the body, as far as it has a meaning (`totals`); collective."""
        over, x, totals = self._over, self.force, dict[str, Any]()
        if len(self.faces) == 1:
            totals["normal"] = over.sum(x[:, 0])
            totals["tangential"] = [-over.sum(x[:, 1 + k] * self.scale[:, k]) for k in range(2)]
        if len(self.faces) == 1 or self._on_one_body:
            totals["vector"] = [over.sum(self.on_body[:, k]) for k in range(3)]
        return {"force_on_body": totals} if totals else {}

    def _opposite(self, part: int) -> dict[str, Any]:
        """Of a pair: the face opposite, and force and moment about the origin on it; collective."""
        if self.opposite_x is None or self.against[part] is None:
            return {}
        here, over = self.part == part, self._over
        force, x = -self.on_body[here], self.opposite_x[here]
        return {
            "against": self.against[part],
            "opposite_force": over.total(force.sum(axis=0)).tolist(),
            "opposite_moment": over.total(np.cross(x, force).sum(axis=0)).tolist(),
        }

    def _rotation(self, part: int) -> dict[str, Any]:
        """Of a rotating foundation: axis, angle, torque of the contact forces on it, and their power.

        The torque about the axis is positive in the direction of positive angles, newton metres.  The power in watts is
        torque times mean angular velocity of the load step, null without one; it is negative where friction brakes.
        """
        spin = self.spins[part]
        if spin is None:
            return {}
        here = self.part == part
        torque = 0.0 - self._over.sum(spin.torques(self.x[here], self.on_body[here]))
        return {
            "axis": {"point": spin.centre.tolist(), "direction": spin.axis.tolist()},
            "angle": spin.angle,
            "angular_velocity": spin.angular_velocity,
            "torque": torque,
            "power": None if spin.angular_velocity is None else torque * spin.angular_velocity,
        }

    def _accumulated_numbers(self) -> dict[str, float]:
        over, now = self._over, self.accumulated
        return {
            "largest_slip": max(over.max(now.slip), 0.0),
            "largest_friction_work": _or_none(over.max(now.friction_work)),
            "largest_pressure": max(over.max(now.pressure), 0.0),
            "dissipated_energy": over.dot(now.friction_work, self.area),
        }

    def _law_numbers(self, part: int) -> dict[str, Any]:
        here = self.part == part
        return self.law.at(here).numbers(self.area[here], self.scale[here], Reductions(self.comm))

    def _vectors(self, components: FloatArray) -> FloatArray:
        return np.einsum("kij,ki->kj", self.frames, components)

    def _displacements(self, rows: FloatArray) -> FloatArray:
        return np.einsum("kij,ki->kj", inverse_frames(self.frames), rows)


def relative_displacement(displacement: FloatArray, slip_origin: FloatArray) -> FloatArray:
    """u_n, and slip along t1 and t2, metres; all along n, t1, t2, shapes (m, 3)."""
    closed = displacement.copy()
    closed[:, 1:] -= slip_origin[:, 1:]
    return closed


_TURNED = names(opposite="reversed")
"""Fields that are opposite on the master: what acts on it, and its motion against the slave."""

CARRIED = (*names(opposite="mean"), *_TURNED)
"""Fields of the contact points that are carried over; besides the status."""

Spread = Callable[[FloatArray], FloatArray]
"""Multiplies rows of contact points (m, d) by a transposed matrix: rows of nodes (k, d); collective."""


def carried(fields: Mapping[str, FloatArray], spread: Spread) -> dict[str, FloatArray]:
    """The fields at the nodes of the master; collective.

    A node is open where all contact points opposite are; else the larger share of those that touch decides between
    stick and slip.  Nodes without a contact point opposite have the status HELD, and 0 everywhere.

    Args:
        fields: At the contact points, shapes (m,) or (m, 3).
        spread: By the matrix W.
    """
    status = fields["status"]
    shares = spread(np.column_stack([status == code for code in (OPEN, STICK, SLIP)]).astype(float))
    total = shares.sum(axis=1)
    there = total > 0.0
    _, sticking, slipping = np.round(shares / np.where(there, total, 1.0)[:, None], 9).T  # equal ones always stick
    carried_fields: dict[str, FloatArray] = {}
    for name in CARRIED:
        values = fields[name].reshape(len(status), 3 if fields[name].ndim == 2 else 1)  # no -1: a rank may have none
        mean = spread(values) / np.where(there, total, 1.0)[:, None]
        mean = -mean if name in _TURNED else mean
        carried_fields[name] = mean.reshape(-1, *fields[name].shape[1:])
    touching = np.where(slipping > sticking, SLIP, STICK)
    carried_fields["status"] = np.where(there, np.where(shares[:, 1:].any(axis=1), touching, OPEN), HELD).astype(float)
    return carried_fields


def carrying(opposite: scipy.sparse.csr_matrix, area: FloatArray) -> scipy.sparse.csr_matrix:
    """W, from the weights opposite to contact points (m, nodes) with areas (m,) in m^2."""
    return (scipy.sparse.diags(area) @ abs(opposite)).tocsr()


def spreading(points: ContactPoints, matrix: scipy.sparse.csr_matrix) -> Spread:
    """Multiplication by the transpose of a matrix (m, nodes), of which every rank has the rows of its contact points;
    collective."""
    size = points.space.numbering

    def spread(values: FloatArray) -> FloatArray:
        distributed = distributed_rows(matrix, (size.local, size.total), points.space, None)
        columns = [matrix_product(distributed, column, transposed=True) for column in values.T]
        distributed.destroy()
        return np.column_stack(columns)

    return spread
