"""The free rigid motions of a body: those of its components against which no support and no spring has energy.

Contact alone holds a body along them.  The stiffness K is then singular, with the free motions R as its kernel.  As
many springs as there are motions, at single degrees of freedom (`Anchor`) on which no motion but zero vanishes, make it
positive definite.  With E the rows of R at these, of full rank, and S the springs, K + S gives exact answers to loads
that are in equilibrium along R: from (K + S) u = f follows R^T S u = E^T s (u at the anchors) = R^T f = 0, so that u is
zero there, the springs carry nothing, and K u = f.  The stiffness of the springs does not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Final

import numpy as np
import numpy.typing as npt
import scipy.linalg
from mpi4py import MPI

from ...arrays import FloatArray
from .rigid_modes import SMALL, RigidLoad, RigidPart, component_modes, direction_in_words, null_space, tidy

_WORSE: Final = 0.3
"""How much worse the first places may determine the motions than the best."""


@dataclass(frozen=True)
class Anchor:
    """A degree of freedom at which a spring makes K positive definite: a node of a rank, at x (3,), and an axis."""

    rank: int
    node: int
    axis: int
    x: FloatArray


def anchors_of(
    x: FloatArray, places: Sequence[npt.NDArray[np.bool_]], rows: Callable[[FloatArray], FloatArray], comm: MPI.Comm
) -> list[Anchor]:
    """As many degrees of freedom of a component as it has free motions, which these determine well; collective.

    They are at the extreme nodes in 26 directions, of the first places that determine the motions nearly as well as the
    best.

    Args:
        x: This rank's nodes, metres, shape (k, 3).
        places: Which nodes suit, the best first, shapes (k,).
        rows: The motions q at points (p, 3), shape (p, 3, q).
        comm: The ranks.

    Raises:
        ValueError: On every rank, if no node suits.
    """
    found: list[list[Anchor]] = []
    quality: list[float] = []
    for suited in places:
        extremes = _extremes(x, np.flatnonzero(suited), comm)
        if len(extremes) == 0:
            continue
        at = np.array([place for place, _, _ in extremes])
        moved = rows(at)
        count = moved.shape[2]
        _, R, order = scipy.linalg.qr(moved.reshape(-1, count).T, mode="economic", pivoting=True)
        dofs = [divmod(int(dof), 3) for dof in order[:count]]
        found.append([Anchor(*extremes[place][1:], axis, extremes[place][0]) for place, axis in dofs])
        quality.append(float(np.abs(R[count - 1, count - 1])) if len(R) >= count else 0.0)
    if not found:
        raise ValueError(
            "contact alone holds a part all of whose nodes follow others, as on rigid faces: hold it by a support, "
            "as a plane of symmetry on one of the faces, or mesh it with more cells across or of second order"
        )
    return next(one for one, good in zip(found, quality, strict=True) if good > _WORSE * max(quality))


def _extremes(x: FloatArray, nodes: npt.NDArray[np.int64], comm: MPI.Comm) -> list[tuple[FloatArray, int, int]]:
    """Place, rank and number of the extreme nodes in 26 directions, the same on every rank; collective."""
    ways = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) != (0, 0, 0)])
    ways = ways / np.linalg.norm(ways, axis=1)[:, None] + np.array([3.1e-3, 1.7e-3, 5.3e-3])  # of equals the same one
    heights = x[nodes] @ ways.T
    mine = []
    if len(nodes):
        mine = [(float(heights[k, way]), x[nodes[k]], int(nodes[k])) for way, k in enumerate(heights.argmax(axis=0))]
    gathered = comm.allgather(mine)
    found: dict[tuple[int, int], FloatArray] = {}
    for way in range(len(ways)):
        given = [(*own[way], rank) for rank, own in enumerate(gathered) if own]
        if given:
            _, place, node, rank = max(given, key=lambda one: one[0])
            found[rank, node] = place
    return sorted(((place, *owner) for owner, place in found.items()), key=lambda one: one[0].tolist())


_PURE: Final = 1e-6
"""A motion whose rotation moves the component by less than this part of its motion is a translation."""

_TIDY: Final = 1e-9
"""Components of directions below this are rounding errors."""


@dataclass(frozen=True)
class FreeMotion:
    """A rigid motion of a component: translation (3,) of its centre in metres, and rotation (3,) in radians."""

    component: int
    part: RigidPart
    translation: FloatArray
    rotation: FloatArray

    def tidy(self, part: float) -> FreeMotion:
        """Without components below a part of the largest."""
        radius = self.part.radius
        most = part * float(np.max(np.abs([self.translation, radius * self.rotation])))
        turned = np.where(radius * np.abs(self.rotation) < most, 0.0, self.rotation)
        return replace(
            self, translation=np.where(np.abs(self.translation) < most, 0.0, self.translation), rotation=turned
        )

    @property
    def size(self) -> float:
        """Largest displacement, at the centre or the radius of its component, metres."""
        return float(np.linalg.norm(self.translation) + self.part.radius * np.linalg.norm(self.rotation))

    def at(self, x: FloatArray) -> FloatArray:
        """The displacements of points x (k, 3) of the component, metres, shape (k, 3)."""
        return self.translation + np.cross(self.rotation, x - self.part.centre)

    def __str__(self) -> str:
        """ "moves along x", or "spins about (0, 0, 1) through (1, 0.5, 0)", with the way along the axis if there is."""
        turn = float(np.linalg.norm(self.rotation))
        if turn * self.part.radius <= _PURE * float(np.linalg.norm(self.translation)):
            return f"moves along {direction_in_words(self.translation)}"
        through = self.part.centre + np.cross(self.rotation, self.translation) / turn**2
        along = float(self.rotation @ self.translation) / turn
        screw = "" if abs(along) <= _PURE * turn * self.part.radius else f", {along / turn:.3g} m per radian along it"
        place = ", ".join(f"{value:.4g}" for value in tidy(through, self.part.radius))
        return f"spins about {direction_in_words(self.rotation)} through ({place}){screw}"


@dataclass(frozen=True)
class OpenedPart:
    """What moves as one where openings part a component: its name in messages, the number of the component, and in each
    of the p openings its translation in metres and its rotation in radians times its radius, shape (6, p)."""

    name: str
    component: int
    part: RigidPart
    amounts: FloatArray

    def motion(self, alpha: FloatArray, whole: FreeMotion | None) -> FreeMotion:
        """For amounts alpha (p,) of the openings, and the motion of the component, if it can move."""
        own = self.amounts @ alpha
        found = FreeMotion(self.component, self.part, own[:3], own[3:] / self.part.radius)
        if whole is None:
            return found
        there = whole.at(self.part.centre[None])[0]
        return replace(found, translation=found.translation + there, rotation=found.rotation + whole.rotation)


@dataclass(frozen=True)
class FreeMotions:
    """The free rigid motions of a body, q of them, linearly independent; those of a component follow each other.

    Attributes:
        component: The component of each of this rank's k nodes, shape (k,).
        motions: Each of one metre: at the centre of its component, or at the radius.
        anchors: As many degrees of freedom, in the order of the motions' components.
        bodies: What each component is called in messages.
        openings: Displacements of the last p of the motions, which move several components against each other, metres,
            shape (k, 3, p); they count as components of their own, of no nodes.
        of_openings: E with these, shape (q, q).
        opened_parts: The parts that the last p motions move, if there are any.
    """

    comm: MPI.Comm
    component: npt.NDArray[np.int64]
    motions: tuple[FreeMotion, ...]
    anchors: tuple[Anchor, ...]
    bodies: tuple[str, ...]
    openings: FloatArray | None = None
    of_openings: FloatArray | None = None
    opened_parts: tuple[OpenedPart, ...] = ()

    def __len__(self) -> int:
        return len(self.motions)

    def modes(self, x: FloatArray) -> FloatArray:
        """R: the displacements of this rank's nodes x (k, 3) in each motion, metres, shape (k, 3, q)."""
        R = np.zeros((*x.shape, len(self.motions)))
        for number, motion in enumerate(self.motions):
            here = self.component == motion.component
            R[here, :, number] = motion.at(x[here])
        if self.openings is not None:
            R[:, :, -self.openings.shape[2] :] = self.openings
        return R

    @cached_property
    def at_anchors(self) -> FloatArray:
        """E: the rows of R at the anchors, shape (q, q)."""
        if self.of_openings is not None:
            return self.of_openings
        each = zip(self.anchors, self.motions, strict=True)
        rows = [
            [one.at(at.x[None])[0, at.axis] if one.component == own.component else 0.0 for one in self.motions]
            for at, own in each
        ]
        return np.array(rows).reshape(len(self), len(self))

    def amounts(self, u: FloatArray) -> FloatArray:
        """The amounts (q,) of the motions in displacements u (k, 3) that would be 0 at the anchors without them;
        collective."""
        there = np.array([u[a.node, a.axis] if a.rank == self.comm.rank else 0.0 for a in self.anchors])
        return np.linalg.solve(self.at_anchors, self.comm.allreduce(there, op=MPI.SUM))

    def anchored(self, shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
        """Which components of this rank's nodes are anchors, shape (k, 3)."""
        anchored = np.zeros(shape, dtype=bool)
        for anchor in self.anchors:
            if anchor.rank == self.comm.rank:
                anchored[anchor.node, anchor.axis] = True
        return anchored

    def of(self, alpha: FloatArray) -> tuple[FreeMotion, ...]:
        """The motion of every component that can move, for amounts alpha (q,) of the motions."""
        found: dict[int, FreeMotion] = {}
        for amount, motion in zip(alpha, self.motions, strict=True):
            last = found.get(motion.component, replace(motion, translation=np.zeros(3), rotation=np.zeros(3)))
            way, turn = last.translation + amount * motion.translation, last.rotation + amount * motion.rotation
            found[motion.component] = replace(motion, translation=way, rotation=turn)
        return tuple(found.values())

    def moving(self, alpha: FloatArray) -> list[tuple[str, FreeMotion]]:
        """What moves, with its motion, for amounts alpha (q,) of the motions: components, or where these are opened the
        parts of them; without what are rounding errors."""
        of_components = self.of(alpha)
        found = [(self.bodies[one.component], one) for one in of_components]
        count = 0 if self.openings is None else self.openings.shape[2]
        if count and np.max(np.abs(alpha[-count:])) > SMALL * np.max(np.abs(alpha)):
            rigid = {one.component: one for one in of_components}
            found = [(part.name, part.motion(alpha[-count:], rigid.get(part.component))) for part in self.opened_parts]
        most = SMALL * max(one.size for _, one in found)
        return [(name, one.tidy(SMALL)) for name, one in found if one.size > most]

    def resultants(self, e: FloatArray) -> tuple[RigidLoad, ...]:
        """Force and moment on every component that can move, as far as it can, of loads e (q,) along the motions."""
        found = []
        for number in dict.fromkeys(motion.component for motion in self.motions):
            own = [(motion, load) for motion, load in zip(self.motions, e, strict=True) if motion.component == number]
            part = own[0][0].part
            M = np.array([np.concatenate([one.translation, part.radius * one.rotation]) for one, _ in own])
            load = np.linalg.lstsq(M, np.array([load for _, load in own]), rcond=None)[0]
            found.append(RigidLoad(number, part, load[:3], part.radius * load[3:]))
        return tuple(found)

    def projected(self, forces: FloatArray, x: FloatArray) -> FloatArray:
        """Nodal forces (k, 3) less their resultants along the motions, spread over the nodes as the motions are;
        collective."""
        if not self.motions:
            return forces
        R = self.modes(x)
        gram = self.comm.allreduce(np.einsum("kci,kcj->ij", R, R), op=MPI.SUM)
        resultant = self.comm.allreduce(np.einsum("kci,kc->i", R, forces), op=MPI.SUM)
        return forces - R @ np.linalg.solve(gram, resultant)

    def opened(
        self,
        openings: FloatArray,
        motions: Sequence[tuple[str, RigidPart, FloatArray]],
        x: FloatArray,
        places: npt.NDArray[np.bool_],
        parts: Sequence[OpenedPart],
    ) -> FreeMotions:
        """With p motions more, which move several components against each other; collective.

        Args:
            openings: Their displacements, metres, shape (k, 3, p).
            motions: What each is called in messages, where it is, and along which direction (3,) it opens.
            x: This rank's nodes, metres, shape (k, 3).
            places: Which nodes suit as anchors, shape (k,).
            parts: What they move.
        """
        count, names = len(self.bodies), tuple(name for name, *_ in motions)
        more = tuple(FreeMotion(count + k, part, along, np.zeros(3)) for k, (_, part, along) in enumerate(motions))
        known, anchors = self.modes(x), list(self.anchors)
        for k in range(len(more)):  # each is anchored where it moves most while no anchor before does
            E = self._rows(known, anchors)
            own = openings[:, :, k] - known @ np.linalg.solve(E, self._rows(openings[:, :, [k]], anchors))[:, 0]
            there = np.where(places[:, None], np.abs(own), 0.0)
            node, axis = divmod(int(np.argmax(there)), 3) if there.size else (0, 0)
            best = self.comm.allgather(float(np.max(there, initial=0.0)))
            rank = int(np.argmax(best))
            node, axis, at = self.comm.bcast((node, axis, x[node] if there.size else None), root=rank)
            anchors.append(Anchor(rank, node, axis, at))
            known = np.concatenate([known, openings[:, :, [k]]], axis=2)
        return replace(
            self,
            motions=self.motions + more,
            anchors=tuple(anchors),
            bodies=self.bodies + names,
            openings=openings,
            of_openings=self._rows(known, anchors),
            opened_parts=tuple(parts),
        )

    def _rows(self, R: FloatArray, anchors: Sequence[Anchor]) -> FloatArray:
        """Rows of motions R (k, 3, q) at degrees of freedom, shape (anchors, q); collective."""
        E = np.zeros((len(anchors), R.shape[2]))
        for row, anchor in enumerate(anchors):
            if anchor.rank == self.comm.rank:
                E[row] = R[anchor.node, anchor.axis]
        return self.comm.allreduce(E, op=MPI.SUM)


def free_motions(
    x: FloatArray,
    component: npt.NDArray[np.int64],
    forces: FloatArray,
    limit: float,
    places: Sequence[npt.NDArray[np.bool_]],
    comm: MPI.Comm,
) -> FreeMotions:
    """The rigid motions of the components of a body that cause no forces; collective.

    Args:
        x: This rank's nodes, metres, shape (k, 3).
        component: Their components, shape (k,).
        forces: Nodal forces that supports and springs make of the `component_modes`, in any unit, shape (k, 3, 6).
        limit: Energy of a motion up to which it is free, in the same unit and metres.
        places: Which nodes suit as anchors, the best first, shapes (k,).
        comm: The ranks.
    """
    motions: list[FreeMotion] = []
    anchors: list[Anchor] = []
    modes, parts = component_modes(x, component, comm)
    for number, part in enumerate(parts):
        here = component == number
        energy = comm.allreduce(np.einsum("kci,kcj->ij", modes[here], forces[here]), op=MPI.SUM)
        basis = _basis_along_axes(null_space(energy, limit))
        if basis.shape[1] == 0:
            continue
        found = [FreeMotion(number, part, column[:3], column[3:] / part.radius) for column in basis.T]
        motions += found
        anchors += anchors_of(x, [here & suited for suited in places], partial(_displacements_at, found), comm)
    centres = (", ".join(f"{value:.3g}" for value in tidy(part.centre, part.radius)) for part in parts)
    bodies = tuple(f"component {k} of the body, around ({centre})" for k, centre in enumerate(centres, 1))
    return FreeMotions(comm, component, tuple(motions), tuple(anchors), bodies if len(parts) > 1 else ("the body",))


def joined_motions(parts: Sequence[FreeMotions], names: Sequence[str], nodes: Sequence[slice]) -> FreeMotions:
    """The free motions of several bodies, of which this rank's nodes follow each other."""
    motions: list[FreeMotion] = []
    anchors: list[Anchor] = []
    bodies: list[str] = []
    component = []
    for part, name, own in zip(parts, names, nodes, strict=True):
        first = len(bodies)
        component.append(first + part.component)
        motions += [replace(motion, component=first + motion.component) for motion in part.motions]
        anchors += [replace(anchor, node=own.start + anchor.node) for anchor in part.anchors]
        bodies += [body.replace("the body", f'body "{name}"') for body in part.bodies]
    return FreeMotions(parts[0].comm, np.concatenate(component), tuple(motions), tuple(anchors), tuple(bodies))


def _displacements_at(motions: Sequence[FreeMotion], x: FloatArray) -> FloatArray:
    return np.stack([motion.at(x) for motion in motions], axis=2)


def _basis_along_axes(free: FloatArray) -> FloatArray:
    """A basis of free motions: translations first, along axes where that is possible; shape (6, q)."""
    _, sizes, right = np.linalg.svd(free[3:], full_matrices=True)
    turning = int(np.sum(sizes > _PURE))
    pure, other = free @ right[turning:].T, free @ right[:turning].T
    translations = _along_axes(pure[:3])
    directions = _along_axes(np.linalg.qr(other[3:])[0])
    spins = other @ np.linalg.lstsq(other[3:], directions, rcond=None)[0]
    basis = np.zeros((6, free.shape[1]))
    basis[:3, : translations.shape[1]] = translations
    basis[:, translations.shape[1] :] = spins / np.maximum(np.linalg.norm(spins, axis=0), 1.0)
    return np.where(np.abs(basis) < _TIDY, 0.0, basis)


def _along_axes(span: FloatArray) -> FloatArray:
    """Orthonormal directions with the span of orthonormal columns (3, r), along axes where these are in it."""
    rest, found = span @ span.T, np.zeros((3, span.shape[1]))
    for number in range(span.shape[1]):
        lengths = np.linalg.norm(rest, axis=0)
        axis = int(np.argmax(lengths > (1.0 - 1e-6) * lengths.max()))
        found[:, number] = rest[:, axis] / lengths[axis]
        rest = rest - np.outer(found[:, number], found[:, number])
    return found


def motions_in_words(free: FreeMotions, combinations: FloatArray) -> tuple[str, ...]:
    """A basis of combinations (q, p) of free motions, in words: first the motions of single components."""
    of = np.array([motion.component for motion in free.motions])
    left, said = combinations, []
    for number in dict.fromkeys(of.tolist()):
        if left.shape[1] == 0:
            break
        here = of == number
        _, sizes, right = np.linalg.svd(left[~here], full_matrices=True)
        alone = int(np.sum(sizes > _PURE))
        own = [free.motions[k] for k in np.flatnonzero(here)]
        M = np.array([np.concatenate([one.translation, one.part.radius * one.rotation]) for one in own]).T
        basis = _basis_along_axes(np.linalg.qr(M @ left[here] @ right[alone:].T)[0])
        motions = [FreeMotion(number, own[0].part, c[:3], c[3:] / own[0].part.radius) for c in basis.T]
        said += [f"{free.bodies[number]} {motion}" for motion in motions]
        left = left @ right[:alone].T
    for column in left.T:
        said.append(" while ".join(f"{name} {one}" for name, one in free.moving(column)))
    return tuple(said)
