"""The free rigid motions of a body: those of its components against which no support and no spring has energy.

Contact alone holds a body along them.  The stiffness K is then singular, with the free motions R as its kernel.  As
many springs as there are motions, at single degrees of freedom on which no motion but zero vanishes, make it
positive definite.  With E the rows of R at these, of full rank, and S the springs, K + S gives exact answers to loads
that are in equilibrium along R: from (K + S) u = f follows R^T S u = E^T s (u at the anchors) = R^T f = 0, so that u is
zero there, the springs carry nothing, and K u = f.  The stiffness of the springs does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.sparse
from mpi4py import MPI
from scipy.sparse.csgraph import connected_components

from ...arrays import BoolArray, FloatArray, IntArray
from ...units import amount as in_units
from ..meshes import fetched, starts_of
from .rigid_modes import SMALL, RigidLoad, RigidPart, component_modes, direction_in_words, null_space, tidy
from .ties import Section, Tie

_WORSE: Final = 0.3
"""How much worse the first places may determine the motions than the best."""


def anchors(free: FreeMotions, R: FloatArray, x: FloatArray, places: Sequence[BoolArray], comm: MPI.Comm) -> BoolArray:
    """As many unknowns as there are free motions, which these determine well, shape (n, 3); collective.

    They are the pivots of the rows of R at the extreme nodes in 26 directions, by components; of the first places that
    determine the motions nearly as well as the best.

    Args:
        R: This rank's n unknowns in them, by nodes of three, shape (n, 3, q).
        x: Where these are, metres, shape (n, 3).
        places: Which nodes suit, the best first, shapes (n,); the last ones determine all motions.
    """
    anchored = np.zeros(R.shape[:2], dtype=bool)
    of = np.array([motion.component for motion in free.motions], dtype=np.int64)
    for number in np.unique(of):
        own = R[:, :, of == number]
        if number >= len(free.bodies) - free.opening:  # bolts: against what the anchors before hold
            E = np.concatenate(comm.allgather(R[anchored]))
            before = of < number
            own = own - R[:, :, before] @ np.linalg.solve(E[:, before], E[:, of == number])
        moved = np.any(own != 0.0, axis=(1, 2))
        suited = [np.flatnonzero(place & moved) for place in places]
        tried = [_pivots(own, nodes, comm) for nodes in (*(_extremes(x, one, comm) for one in suited), suited[-1])]
        best = max(size for _, size in tried)
        anchored |= next(pivots for pivots, size in tried if size >= _WORSE * best)
    return anchored


def _extremes(x: FloatArray, nodes: IntArray, comm: MPI.Comm) -> IntArray:
    """Of all ranks' nodes the extreme ones in 26 directions; those of this rank, ascending; collective."""
    ways = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) != (0, 0, 0)])
    ways = ways / np.linalg.norm(ways, axis=1)[:, None] + np.array([3.1e-3, 1.7e-3, 5.3e-3])  # of equals the same one
    heights = x[nodes] @ ways.T
    farthest = np.array(comm.allgather(np.max(heights, axis=0, initial=-np.inf)))
    own = np.flatnonzero(np.argmax(farthest, axis=0) == comm.rank)
    return np.unique(nodes[np.argmax(heights[:, own], axis=0)]) if len(nodes) else nodes


def _pivots(R: FloatArray, nodes: IntArray, comm: MPI.Comm) -> tuple[BoolArray, float]:
    """The pivots of the rows of R (n, 3, q) at some of this rank's nodes, shape (n, 3), and the size of the last;
    collective."""
    pivots, size = np.zeros(R.shape[:2], dtype=bool), 0.0
    rows = R[nodes]
    for _ in range(R.shape[2]):
        lengths = np.linalg.norm(rows, axis=2)
        each = comm.allgather(float(np.max(lengths, initial=0.0)))
        rank, size = int(np.argmax(each)), max(each)
        row = None
        if comm.rank == rank and lengths.size:
            node, axis = divmod(int(np.argmax(lengths)), 3)
            row = rows[node, axis] / (size or 1.0)
            pivots[nodes[node], axis] = True
        row = comm.bcast(row, root=rank)
        if row is None:  # no node suits
            return pivots, 0.0
        rows = rows - (rows @ row)[:, :, None] * row
    return pivots, size


_PURE: Final = 1e-6
"""A motion whose rotation moves the component by less than this part of its motion is a translation."""

_TIDY: Final = 1e-9
"""Components of directions below this are rounding errors."""


@dataclass(frozen=True, eq=False)
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
        pure = abs(along) <= _PURE * turn * self.part.radius
        screw = "" if pure else f", {in_units(along / turn, 'm')} per radian along it"
        place = ", ".join(f"{value:.4g}" for value in tidy(through, self.part.radius))
        return f"spins about {direction_in_words(self.rotation)} through ({place}){screw}"


@dataclass(frozen=True, eq=False)
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
        motion = FreeMotion(self.component, self.part, own[:3], own[3:] / self.part.radius)
        if whole is None:
            return motion
        there = whole.at(self.part.centre[None])[0]
        return replace(motion, translation=motion.translation + there, rotation=motion.rotation + whole.rotation)


@dataclass(frozen=True, eq=False)
class FreeMotions:
    """The free rigid motions of a body, q of them, linearly independent; those of a component follow each other.

    Attributes:
        component: The component of each of this rank's k nodes, shape (k,).
        motions: Each of one metre: at the centre of its component, or at the radius.
        bodies: What each component is called in messages.
        openings: Displacements of the last p of the motions, which move several components against each other, metres,
            shape (k, 3, p); they count as components of their own, of no nodes.
        opened_parts: The parts that the last p motions move, if there are any.
    """

    comm: MPI.Comm
    component: IntArray
    motions: tuple[FreeMotion, ...]
    bodies: tuple[str, ...]
    openings: FloatArray | None = None
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

    @property
    def opening(self) -> int:
        """The number p of `openings`."""
        return 0 if self.openings is None else self.openings.shape[2]

    def of(self, alpha: FloatArray) -> tuple[FreeMotion, ...]:
        """The motion of every component that can move, for amounts alpha (q,) of the motions."""
        motion_of: dict[int, FreeMotion] = {}
        for amount, motion in zip(alpha, self.motions, strict=True):
            last = motion_of.get(motion.component, replace(motion, translation=np.zeros(3), rotation=np.zeros(3)))
            way, turn = last.translation + amount * motion.translation, last.rotation + amount * motion.rotation
            motion_of[motion.component] = replace(motion, translation=way, rotation=turn)
        return tuple(motion_of.values())

    def moving(self, alpha: FloatArray) -> list[tuple[str, FreeMotion]]:
        """What moves, with its motion, for amounts alpha (q,) of the motions: components, or where these are opened the
        parts of them; without what are rounding errors."""
        of_components = self.of(alpha)
        found = [(self.bodies[one.component], one) for one in of_components]
        count = self.opening
        if count and np.max(np.abs(alpha[-count:])) > SMALL * np.max(np.abs(alpha)):
            rigid = {one.component: one for one in of_components}
            found = [(part.name, part.motion(alpha[-count:], rigid.get(part.component))) for part in self.opened_parts]
        most = SMALL * max(one.size for _, one in found)
        return [(name, one.tidy(SMALL)) for name, one in found if one.size > most]

    def resultants(self, e: FloatArray) -> tuple[RigidLoad, ...]:
        """Force and moment on every component that can move, as far as it can, of loads e (q,) along the motions."""
        loads = []
        for number in dict.fromkeys(motion.component for motion in self.motions):
            own = [(motion, load) for motion, load in zip(self.motions, e, strict=True) if motion.component == number]
            part = own[0][0].part
            M = np.array([np.concatenate([one.translation, part.radius * one.rotation]) for one, _ in own])
            load = np.linalg.lstsq(M, np.array([load for _, load in own]), rcond=None)[0]
            loads.append(RigidLoad(number, part, load[:3], part.radius * load[3:]))
        return tuple(loads)

    def projected(self, forces: FloatArray, x: FloatArray) -> FloatArray:
        """Nodal forces (k, 3) or several of them (k, 3, j) less their resultants along the motions, spread over the
        nodes as the motions are; collective."""
        if not self.motions:
            return forces
        R = self.modes(x)
        gram = self.comm.allreduce(np.einsum("kci,kcj->ij", R, R))
        resultant = self.comm.allreduce(np.einsum("kci,kc...->i...", R, forces))
        return forces - R @ np.linalg.solve(gram, resultant)

    def opened(
        self,
        openings: FloatArray,
        motions: Sequence[tuple[str, RigidPart, FloatArray]],
        parts: Sequence[OpenedPart],
    ) -> FreeMotions:
        """With p motions more, which move several components against each other.

        Args:
            openings: Their displacements, metres, shape (k, 3, p).
            motions: What each is called in messages, where it is, and along which direction (3,) it opens.
            parts: What they move.
        """
        count, names = len(self.bodies), tuple(name for name, *_ in motions)
        more = tuple(FreeMotion(count + k, part, along, np.zeros(3)) for k, (_, part, along) in enumerate(motions))
        return replace(
            self, motions=self.motions + more, bodies=self.bodies + names, openings=openings, opened_parts=tuple(parts)
        )


_HARDLY: Final = 1e-10
"""Energy of a motion by unit springs, over that of the motion against which they have most, up to which it is free."""


def free_motions(
    x: FloatArray,
    component: IntArray,
    names: Sequence[str],
    forces: FloatArray,
    comm: MPI.Comm,
    per_node: float | None = None,
) -> FreeMotions:
    """The rigid motions of the components of a body that cause no forces; collective.

    Args:
        x: This rank's nodes, metres, shape (k, 3).
        component: Their components, shape (k,).
        names: What the components are called in messages.
        forces: Nodal forces that supports and springs make of the `component_modes`, in any unit, shape (k, 3, 6).
        per_node: Energy of a motion up to which it is free, in the same unit and metres, over the number of nodes of
            the component; None where the forces are those of unit springs.
    """
    motions: list[FreeMotion] = []
    modes, parts = component_modes(x, component, comm)
    for number, part in enumerate(parts):
        here = component == number
        energy = comm.allreduce(np.einsum("kci,kcj->ij", modes[here], forces[here]))
        limit = least_energy(energy) if per_node is None else per_node * comm.allreduce(int(here.sum()))
        basis = _basis_along_axes(null_space(energy, limit))
        motions += [FreeMotion(number, part, column[:3], column[3:] / part.radius) for column in basis.T]
    return FreeMotions(comm, component, tuple(motions), tuple(names))


def least_energy(energy: FloatArray) -> float:
    """The energy up to which a motion is free, of the energy of motions by unit springs, a matrix (q, q)."""
    return _HARDLY * max(float(np.linalg.norm(energy, 2)), 1.0)


def names_of_components(parts: Sequence[RigidPart]) -> tuple[str, ...]:
    """What the components of a body are called in messages."""
    centres = (", ".join(f"{value:.3g}" for value in tidy(part.centre, part.radius)) for part in parts)
    names = tuple(f"component {k} of the body, around ({centre})" for k, centre in enumerate(centres, 1))
    return names if len(parts) > 1 else ("the body",)


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
    rest, along_axes = span @ span.T, np.zeros((3, span.shape[1]))
    for number in range(span.shape[1]):
        lengths = np.linalg.norm(rest, axis=0)
        axis = int(np.argmax(lengths > (1.0 - 1e-6) * lengths.max()))
        along_axes[:, number] = rest[:, axis] / lengths[axis]
        rest = rest - np.outer(along_axes[:, number], along_axes[:, number])
    return along_axes


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


SHORTENS: Final = 1e-6
"""Part by which a motion of bodies changes the length of a bolt above which it does."""


def openings(
    amounts: FloatArray, sections: Sequence[Section]
) -> tuple[FloatArray, list[tuple[str, RigidPart, FloatArray]]]:
    """The combinations of q motions that change the lengths of bolts, by the amounts (bolts, q) of each: of every bolt
    by itself where that is possible, shape (q, p); and of each what it is called, where it is, and along which
    direction."""
    left, sizes, right = np.linalg.svd(amounts)
    rank = int(np.sum(sizes > SHORTENS))
    bolts = left[:, :rank]
    alone = np.linalg.norm(bolts @ bolts.T - np.eye(len(sections)), axis=0) < SHORTENS
    wanted = np.eye(len(sections))[:, alone]
    others = np.linalg.svd(bolts - wanted @ (wanted.T @ bolts))[0]
    wanted = np.column_stack([wanted, others[:, : rank - wanted.shape[1]]])
    named = []
    for way in wanted.T:
        moving = [sections[k] for k in np.flatnonzero(np.abs(way) > SHORTENS)]
        name = " with ".join(f"the bolt at {section.face!r}" for section in moving)
        named.append((name, RigidPart(moving[0].place, moving[0].radius), moving[0].direction))
    ways: FloatArray = right[:rank].T @ ((bolts / sizes[:rank]).T @ wanted)
    return ways, named


def together(
    ties: Sequence[Tie], component: IntArray, names: tuple[str, ...], comm: MPI.Comm, links: Sequence[IntArray] = ()
) -> tuple[IntArray, tuple[str, ...]]:
    """The component of every node, where those of these ties, and of linked nodes, are one, shape (k,), and their
    names; collective."""
    if not ties and not links:
        return component, names
    starts, joined = starts_of(comm, len(component)), [np.empty((0, 2), dtype=np.int64)]
    for tie in ties:
        entries = tie.rows.tocoo()
        masters = fetched(comm, starts, (entries.col // 3).astype(np.int64), component)
        joined.append(np.unique(np.column_stack([component[tie.nodes[entries.row // 3]], masters]), axis=0))
        if tie.own.shape[2]:  # moved by the same unknowns
            moved = np.unique(np.concatenate(comm.allgather(np.unique(component[tie.nodes]))))
            joined.append(np.column_stack([moved[:-1], moved[1:]]))
    for nodes in links:
        linked = fetched(comm, starts, nodes, component)
        joined.append(np.column_stack([linked[:-1], linked[1:]]))
    pairs = np.concatenate(comm.allgather(np.concatenate(joined)))
    graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), pairs.T), (len(names), len(names)))
    number = connected_components(graph, directed=False)[1].astype(np.int64)
    _, number = np.unique(number, return_inverse=True)
    groups = [[name for name, at in zip(names, number, strict=True) if at == k] for k in range(max(number) + 1)]
    return number[component], tuple(group[0] if len(group) == 1 else " with ".join(group) for group in groups)
