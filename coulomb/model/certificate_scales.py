"""Scales of the certificate's measures: every body by its own, and every contact point by those of its bodies.

Where steel is beside foam, one displacement and one force for all would hide every error of the steel: the displacement
scale is that of the foam.  The bodies are the components of the meshes.  A contact point of a pair is judged by the
larger displacement of the two bodies, which decides by how much its force changes when they come nearer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from ..arrays import FloatArray, IntArray
from ..fem.bodies import Deformable, varying_signs
from ..linalg.reductions import Reductions, concatenated
from ..solvers.laws import FrictionLaw
from ..solvers.scales import SHARE

Evidence: TypeAlias = Any
"""`certificate.Evidence`, which is built on this file."""

EPSILON: Final = 2.0**-52
"""Rounding unit of double precision."""

ROUNDING: Final = 1e8
"""No scale is less than this multiple of the rounding error, so that a hundred rounding errors are within LIMIT."""

OF_ALL: Final = 1e-3
"""The forces on a body are judged by no less than this part of those on all."""

FAR_GONE: Final = 100.0
"""What lacks for the equilibrium of a loaded body that contact alone holds is judged by at most this multiple of all
forces on it: one that nothing holds goes so far that rounding errors of its stiffness are larger than its load."""


_LEAST_FORCE: Final = 1e-6
"""Contact forces on a body below this part of the largest are those of a body that only rests."""


_FARTHEST: Final = 2.0 * 3.0**0.5
"""Largest scale of displacements over their largest component: forces in balance do no more work than their sum times
the largest displacement.  A displacement that is not in balance may have internal forces of any size."""


_OF_GAPS: Final = 2.0**-48, 2.0**-49
"""Rounding errors of a gap relative to itself and to displacements, and to coordinates, of which it is a difference."""


def rounding_of_gaps(gap: FloatArray, way: FloatArray, place: FloatArray, large: bool = False) -> FloatArray:
    """What of a gap less a displacement across it may be a rounding error, metres; where the gap is exactly 0,
    coordinates leave none, but in large motions, in which displacements are differences of places.

    Args:
        gap: Before deformation, shape (m,).
        way: Displacement across it, metres, shape (m,).
        place: Largest coordinate of the body, metres, shape (m,).
    """
    return _OF_GAPS[0] * (np.abs(gap) + np.abs(way)) + np.where((gap == 0.0) & (not large), 0.0, _OF_GAPS[1] * place)


def at_all_points(known: FloatArray, given: FloatArray, over: Reductions) -> FloatArray:
    """Compliances (m, 3) of contact points, where they are not known (0) the mean of those given (s, 3); collective."""
    count = over.sum(float(np.count_nonzero(given)))
    mean = over.sum(given) / count if count > 0.0 else 1.0
    return np.where(known > 0.0, known, mean)


def lengths(vectors: FloatArray) -> FloatArray:
    """Norms of vectors (k, 3) without overflow or underflow of squares."""
    largest = float(np.max(np.abs(vectors), initial=0.0))
    if 1e-100 < largest < 1e100:  # no square overflows, and those that vanish do not count: a fifth of the time
        return np.sqrt(np.einsum("ki,ki->k", vectors, vectors))
    return np.hypot(np.hypot(vectors[:, 0], vectors[:, 1]), vectors[:, 2])


def largest_motions(component: IntArray, u: FloatArray, over: Reductions) -> FloatArray:
    """Largest component of the displacements u (k, 3) in the component of the meshes of each node, metres, shape (k,);
    collective."""
    count = 1 + int(over.max(component.astype(np.float64)))
    return _Bodies(component, count, over).largest(np.max(np.abs(u), axis=1))[component]


def rounding_forces(body: Deformable, u: FloatArray) -> FloatArray:
    """Nodal forces in newtons of a rounding error of the displacement u, shapes (k, 3); collective.

    The error is 2^-52 of the largest component of u in the same component of the meshes, with signs that vary from node
    to node.
    """
    motion = largest_motions(body.component, u, Reductions(body.comm))
    return body.internal_force(2.0**-52 * motion[:, None] * varying_signs(body.x, body.comm))


def worst(*values: float) -> float:
    """The largest, nan if one is nan."""
    return float(np.max(values))


def ratio(value: float, scale: float) -> float:
    """A measure over its scale, which is 0 only if the measure is."""
    return value / (scale or 1.0)


@dataclass(frozen=True, eq=False)
class Scales:
    """Scales of all bodies together, and of every body and contact point; n bodies, m contact points.

    Attributes:
        force: Largest component of the contact force of a node, newtons; 0 without contact forces.
        length: Mean displacement of the forces that deform the bodies, metres.
        nodal: Norm of the largest of internal forces, loads, springs and contact forces, newtons.
        turnover: Sum of the outer forces of all nodes, newtons.
        body: Number of the body of every node, shape (k,).
        owner: Number of the body of every contact point, shape (m,).
        forces, lengths, nodals: The same of every body, shape (n,).
        at_points: Length of every contact point, in pairs the larger one of the two sides, metres, shape (m,).
        at_held: The same of every node of `Evidence.held_gap`, shape (q,).
    """

    force: float
    length: float
    nodal: float
    turnover: float
    body: IntArray
    owner: IntArray
    forces: FloatArray
    lengths: FloatArray
    nodals: FloatArray
    at_points: FloatArray
    at_held: FloatArray

    def of_points(self, values: FloatArray, over: Reductions) -> FloatArray:
        """Largest value (m,) of the contact points of every body, at least 0, shape (n,); collective."""
        return _Bodies(self.owner, len(self.forces), over).largest(values)

    def of_nodes(self, values: FloatArray, over: Reductions) -> FloatArray:
        """The same of values (k,) of the nodes."""
        return _Bodies(self.body, len(self.forces), over).largest(values)

    def norms(self, sizes: FloatArray, over: Reductions) -> FloatArray:
        """Norm of the sizes (k,) at the nodes of every body, shape (n,); collective."""
        unit = over.max(sizes) if len(self.forces) > 1 else 0.0
        if not 0.0 < unit < np.inf:
            return np.full(len(self.forces), over.norm(sizes))
        return unit * np.sqrt(_Bodies(self.body, len(self.forces), over).sums((sizes / unit) ** 2))


class _Bodies:
    """Sums and largest values over the nodes or contact points of every body; collective."""

    def __init__(self, number: IntArray, count: int, over: Reductions):
        self._number, self._count, self._over = number, count, over

    def sums(self, values: FloatArray) -> FloatArray:
        return self._over.total(np.asarray(np.bincount(self._number, values, self._count), dtype=np.float64))

    def norms(self, vectors: FloatArray, unit: float) -> FloatArray:
        """Of vectors (k, 3); the unit is of their order, so that no square overflows or vanishes."""
        return unit * np.sqrt(self.sums((lengths(vectors) / unit) ** 2))

    def largest(self, values: FloatArray, none: float = 0.0) -> FloatArray:
        sizes = np.full(self._count, none)
        with np.errstate(invalid="ignore"):  # nan is the largest
            np.maximum.at(sizes, self._number, values)
        return self._over.largest(sizes)


def scales_of(e: Evidence, outer: tuple[FloatArray, ...], over: Reductions) -> Scales:
    """The scales, at least the effect of rounding: a body without contact and loads has no other forces."""
    blocked = np.asarray(e.blocked)
    noise = ROUNDING * over.norm(e.rounding)
    nodal = worst(*(over.norm(part) for part in (e.internal, e.load, e.spring, e.on_body)), noise)
    turnover = worst(sum(over.sum(lengths(part)) for part in outer), ROUNDING * over.sum(lengths(e.rounding)))
    motion = over.max(np.abs(e.displacement))
    energy = over.dot(e.displacement / (motion or 1.0), e.internal / (nodal or 1.0))
    way = min(2.0 * energy * motion * ratio(nodal, turnover), _FARTHEST * motion)
    at_least = motion if motion != 0.0 else float(np.max(over.extent(e.x)))
    peak = over.max(np.abs(e.force))
    force = worst(peak, ROUNDING * over.max(np.abs(e.rounding))) if peak != 0.0 else 0.0
    length = worst(way, *blocked, ROUNDING * EPSILON * at_least)
    body, owner = e.component, e.owner
    count = 1 + int(over.max(body.astype(np.float64)))
    forces: FloatArray
    if count == 1 or not 0.0 < nodal < np.inf or not motion < np.inf:
        forces, lengths_, nodals = (np.full(count, value) for value in (force, length, nodal))
        at = np.full(len(owner), length), np.full(e.held_gap.shape, length)
        return Scales(force, length, nodal, turnover, body, owner, forces, lengths_, nodals, *at)
    nodes, points = _Bodies(body, count, over), _Bodies(owner, count, over)
    forces = points.largest(np.max(np.abs(e.force), axis=1))
    noises = ROUNDING * nodes.largest(np.max(np.abs(e.rounding), axis=1))
    forces = np.where(forces > 0.0, np.maximum(forces, noises), 0.0)
    each = (nodes.norms(part, nodal) for part in (e.internal, e.load, e.spring, e.on_body, ROUNDING * e.rounding))
    nodals = np.maximum(np.max(list(each), axis=0), OF_ALL * nodal)
    turnovers = np.sum([nodes.sums(lengths(part)) for part in outer], axis=0)
    turnovers = np.maximum(turnovers, ROUNDING * nodes.sums(lengths(e.rounding)))
    work = np.sum(e.displacement / (motion or 1.0) * (e.internal / nodal), axis=1)
    motions = nodes.largest(np.max(np.abs(e.displacement), axis=1))
    ways = 2.0 * nodes.sums(work) * motion * (nodal / np.where(turnovers > 0.0, turnovers, nodal))
    extent = np.max([nodes.largest(x, -np.inf) + nodes.largest(-x, -np.inf) for x in e.x.T], axis=0)
    least = ROUNDING * EPSILON * np.where(motions > 0.0, motions, extent)
    lengths_ = np.maximum(np.minimum(ways, _FARTHEST * motions), least)
    lengths_ = np.maximum(lengths_, nodes.largest(_of_loads_alone(e)))
    at_points, at_held = lengths_[owner], lengths_[e.held_owner]
    for number, others in enumerate(e.opposite):
        for at, part in ((at_points, e.part), (at_held, e.held_part)):
            here = part == number
            at[here] = np.maximum(at[here], max((lengths_[one] for one in others), default=0.0))
    return Scales(force, length, nodal, turnover, body, owner, forces, lengths_, nodals, at_points, at_held)


def deformations(e: Evidence, over: Reductions) -> tuple[FloatArray, FloatArray]:
    """Work of the forces that deform each component of the meshes, joules, and their mean displacement, metres, shapes
    (n,); collective."""
    nodes, forces = _Bodies(e.component, 1 + int(over.max(e.component.astype(np.float64))), over), e.deforming
    work = np.maximum(nodes.sums(np.einsum("ki,ki->k", e.displacement, forces)), 0.0)
    sizes = nodes.sums(lengths(forces))
    return work, 2.0 * work / np.where(sizes > 0.0, sizes, 1.0)


@dataclass(frozen=True, eq=False)
class FaceScales:
    """Lengths of the bodies that each contact face belongs to and is pressed against, by which errors of its gaps are
    judged: what stands beside them in the model does not count.

    Attributes:
        deformation: Mean displacement of the forces that deform these bodies, of both sides the larger one, metres,
            shape (faces,).
        approach: Work of the forces that deform them over the sum of the normal forces on them, metres, shape (faces,).
        force: Largest normal force of a contact point on them, newtons, at least `_LEAST_FORCE` of that of the model,
            shape (faces,).
    """

    deformation: FloatArray
    approach: FloatArray
    force: FloatArray


def face_scales(e: Evidence, over: Reductions) -> FaceScales:
    """The scales of every contact face; collective."""
    work, ways = deformations(e, over)
    blocked = _Bodies(e.component, len(work), over).largest(_of_loads_alone(e))
    judged, count = e.part >= 0, len(e.faces)
    part, normal = e.part[judged], np.maximum(e.force[judged, 0], 0.0)
    faces = _Bodies(part, count, over)
    pressed, largest = faces.sums(normal), faces.largest(normal)
    own = np.zeros((count, len(work)))
    own[part, e.owner[judged]] = 1.0
    joined = over.largest(own.ravel()).reshape(own.shape)  # 1 of the components that a face joins
    for number, others in enumerate(e.opposite):
        joined[number, list(others)] = 1.0
    on_these = np.minimum(joined @ joined.T, 1.0)
    pressed_on_these = on_these @ pressed
    approach = joined @ work / np.where(pressed_on_these > 0.0, pressed_on_these, 1.0)
    approach = np.maximum(approach, np.max(joined * blocked, axis=1, initial=0.0))
    return FaceScales(
        np.max(joined * np.maximum(ways, blocked), axis=1, initial=0.0),
        np.where(pressed_on_these > 0.0, approach, 0.0),
        np.maximum(np.max(on_these * largest, axis=1, initial=0.0), _LEAST_FORCE * np.max(largest, initial=0.0)),
    )


def of_half(values: FloatArray, force: FloatArray, over: Reductions) -> float:
    """The largest of values (m,) that is reached where half of the forces (m,) act; collective."""
    values, force = concatenated(over.comm, np.column_stack([values, force])).T
    order = np.argsort(-values)
    reached = np.cumsum(force[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])]) if len(values) else 0.0


def _of_loads_alone(e: Evidence) -> FloatArray:
    """`Evidence.blocked` at the nodes of every body, metres, shape (k,)."""
    scale = np.zeros(len(e.x))
    bodies = e.bodies or (slice(None),)
    for nodes, one in zip(bodies, np.broadcast_to(e.blocked, len(bodies)), strict=True):
        scale[nodes] = one
    return scale


def place_of_largest(
    values: FloatArray, place: FloatArray, part: IntArray, faces: Sequence[str], over: Reductions
) -> str:
    """Where the largest of the values (m,) is, or one that is nan, in words; collective.

    Args:
        values: At contact points,
        place: of these coordinates, shape (m, 3),
        part: on these faces, shape (m,).
    """
    mine = np.array([[-np.inf, 0.0, 0.0, 0.0, -1.0]])
    if len(values):
        here = np.where(np.isnan(values), np.inf, values)
        k = int(np.argmax(here))
        mine = np.array([[here[k], *place[k], part[k]]])
    _, x, y, z, face = max(tuple(map(float, row)) for row in concatenated(over.comm, mine))
    name = f" of {faces[int(face)]!r}" if 0 <= face < len(faces) and faces[int(face)] else ""
    return f"at ({x:.4g}, {y:.4g}, {z:.4g}) m{name}"


def natural_residuals(e: Evidence, remaining: FloatArray, scales: Scales) -> FloatArray:
    """|x - P(x - w/a)| of every contact point with its own compliances, over its own force or a part of the largest on
    its body, shape (m,); on a body without contact forces, where gaps have rounding errors, as displacements."""
    left = FrictionLaw.tresca(e.bound).left_over(e.force.ravel(), (remaining / e.compliance).ravel(), 0.0)
    of_body = scales.forces[scales.owner]
    alone = scales.at_points / np.max(e.compliance, axis=1, initial=0.0)
    own = np.maximum(lengths(e.force), SHARE * np.where(of_body > 0.0, of_body, alone / SHARE))
    size = lengths(left.reshape(-1, 3))
    return np.where(size == 0.0, 0.0, size / own)
