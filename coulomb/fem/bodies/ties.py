"""What nodes of a face follow: nodes of another, or unknowns of the tie's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Protocol

import numpy as np
import scipy.sparse
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, IntArray
from ...units import used
from ..geometry import Amplitude, evaluate_amplitude, on_all_ranks
from .lasting_supports import Lasting
from .rigid_modes import Wrench, displacements_of

_SAME_DISPLACEMENT: Final = 1e-9
"""Part of the prescribed displacements up to which they are the same."""


class GivenFace:
    """What a rigid face prescribes, and the springs at its reference point; fields as of `RigidFace`."""

    face: str
    kind: str
    amplitude: Amplitude
    amplitudes: Sequence[Amplitude | None]
    translation_stiffness: Sequence[float]
    rotation_stiffness: Sequence[float]

    @property
    def what(self) -> str:
        return f"{self.kind} {self.face!r}"

    def factors(self, time: float) -> FloatArray:
        """Those of the six components at a time, shape (6,); ValueError if an amplitude has no value then."""
        own = [self.amplitude if amplitude is None else amplitude for amplitude in self.amplitudes]
        return np.array([evaluate_amplitude(one, time, self.what) for one in own])

    @property
    def prescribed(self) -> BoolArray:
        """Which of the six components are prescribed, shape (6,)."""
        raise NotImplementedError

    @property
    def stiffness(self) -> FloatArray:
        """The diagonal of S, shape (6,)."""
        return np.array([*self.translation_stiffness, *self.rotation_stiffness], dtype=np.float64)

    @property
    def holds(self) -> str:
        """What its spring holds, in words."""
        along, about = (
            "(" + ", ".join(f"{float(one):g}" for one in given) + ")"
            for given in (self.translation_stiffness, self.rotation_stiffness)
        )
        return f"stiffness {along} {used().name('N/m')} and {about} {used().name('N m/rad')} at its reference point"


_SAME_TIME: Final = 1e-9
"""Relative difference up to which times are the same."""


class GivenBolt:
    """The tightening of a bolt; fields as of `Pretension`."""

    force: float | None
    shortening: float | None
    amplitude: Amplitude
    lock: float | None

    @property
    def what(self) -> str:
        """Kind and faces, for messages."""
        raise NotImplementedError

    def locked(self, time: float) -> bool:
        """Whether a time is after tightening."""
        return self.lock is not None and time > self.lock + _SAME_TIME * abs(self.lock)

    def fixed(self, time: float) -> bool:
        """Whether the shortening is given at a time: prescribed, or locked."""
        return self.force is None or self.locked(time)

    def value(self, time: float, comm: MPI.Comm) -> float:
        """Force in newtons, or prescribed shortening in metres, at a time; collective.

        Raises:
            ValueError: On every rank, if the amplitude has no value then.
        """
        time = time if self.lock is None else min(time, self.lock)
        factor = on_all_ranks(lambda: evaluate_amplitude(self.amplitude, time, self.what), "", comm)
        return factor * float((self.shortening if self.force is None else self.force) or 0.0)


@dataclass(frozen=True, eq=False)
class FaceMotion:
    """The motion of a rigid face.

    Attributes:
        place: The reference point, metres, shape (3,).
        nodes: Its nodes among this rank's k nodes, ascending, shape (m,).
        ways: Orthonormal directions along which its nodes follow the motion, shape (d, 3).
        motions: The free motions as translations of the point and rotations about it, shape (6, r).
        given_part: What each component prescribes as such a motion, for an amplitude of 1, shape (6, 6).
        spread: C, shape (m, 3, 6); 0 but on one component of the mesh, so that forces on each are by its own motion.
    """

    given: GivenFace
    place: FloatArray
    nodes: IntArray
    ways: FloatArray
    motions: FloatArray
    given_part: FloatArray
    spread: FloatArray

    finite: ClassVar[bool] = False
    """Whether rotations are finite: `FiniteMotion`."""

    def at_place(self, x: FloatArray, near: FloatArray, comm: MPI.Comm) -> FaceMotion:
        """Itself, whose motions are the same of nodes at another place x (k, 3)."""
        return self

    @property
    def point(self) -> FloatArray:
        """The reference point where it is known to be, metres, shape (3,)."""
        return self.place

    @property
    def turn(self) -> FloatArray:
        """The rotation vector of its pose, of a `FiniteMotion`; else 0; radians, shape (3,)."""
        return np.zeros(3)

    def own(self, x: FloatArray) -> FloatArray:
        """N: displacements of its nodes by its free amounts, before deformation at x (k, 3), shape (m, 3, r)."""
        return self.ways.T @ self.ways @ moved_at(self.motions, x[self.nodes] - self.place)

    def of_components(self, x: FloatArray) -> FloatArray:
        """Displacements of its nodes, of those at x (k, 3), by changes of its six components, shape (m, 3, 6)."""
        return self.ways.T @ self.ways @ moved_at(self.given_part, x[self.nodes] - self.place)

    def moved_by(self, y: FloatArray, time: float, comm: MPI.Comm) -> tuple[FloatArray, FloatArray]:
        """Its point (3,) in metres, and its motion (6,) by amounts y (r,) at a time; collective."""
        return self.place, self.values(time, comm) + self.motions @ y

    def pull(self, u: FloatArray, comm: MPI.Comm) -> FloatArray:
        """Nodal forces in newtons of its spring where the displacement is u (k, 3), of the same shape; collective."""
        return self.spring_force(u, self.given.stiffness, comm)

    def pull_rate(self, x: FloatArray, way: FloatArray, comm: MPI.Comm) -> FloatArray:
        """Derivative of `pull` as its nodes, at x (k, 3), move along a way (k, 3), of the same shape; collective."""
        return self.pull(way, comm)

    def bent(self, forces: FloatArray, wrenches: Sequence[Wrench], comm: MPI.Comm) -> FloatArray:
        """As of `FiniteMotion`: 0, shape (r, r)."""
        return np.zeros(2 * self.motions.shape[1:])

    def spring_force(self, u: FloatArray, stiffness: FloatArray, comm: MPI.Comm) -> FloatArray:
        """Nodal forces in newtons of a spring of a diagonal stiffness (6,) at changes u of displacements (k, 3), or (k,
        3, j), of the same shape; collective."""
        q = comm.allreduce(np.einsum("mcp,mc...->p...", self.spread, u[self.nodes]))
        forces = np.zeros_like(u)
        forces[self.nodes] = -np.einsum("mcp,p,p...->mc...", self.spread, stiffness, q)
        return forces

    def unit_stiffness(self, x: FloatArray, comm: MPI.Comm) -> FloatArray:
        """The stiffness (6,) of unit springs at all nodes, of those x (k, 3) of this rank, where the spring has any;
        collective."""
        count, square = comm.allreduce(
            np.array([len(self.nodes), np.sum((x[self.nodes] - self.place) ** 2)]), op=MPI.SUM
        )
        return np.where(self.given.stiffness > 0.0, np.repeat([count, square], 3), 0.0)

    def values(self, time: float, comm: MPI.Comm) -> FloatArray:
        """The prescribed motion at a time, shape (6,); collective.

        Raises:
            ValueError: On every rank, if an amplitude has no value then.
        """
        return np.asarray(self.given_part @ on_all_ranks(lambda: self.given.factors(time), "", comm))

    def prescribed(self, x: FloatArray, time: float, comm: MPI.Comm) -> FloatArray:
        """t at nodes x (k, 3) of the face, 0 at others, metres, shape (k, 3), of which `ways` matter; collective."""
        values, t = self.values(time, comm), np.zeros_like(x)
        t[self.nodes] = moved_at(values[:, None], x[self.nodes] - self.place)[:, :, 0]
        return t

    def prescribed_rate(self, x: FloatArray, time: float, comm: MPI.Comm) -> FloatArray:
        """Derivative of `prescribed` along the common factor of its components, arguments as there; collective."""
        return self.prescribed(x, time, comm)

    def refuse_other(self, held: FloatArray, size: float, comm: MPI.Comm) -> None:
        """ValueError on every rank if supports prescribe other displacements at its nodes than it does: `held` (k, 3)
        is the difference along held directions, of displacements of a size, metres; collective."""
        if comm.allreduce(bool(np.any(np.abs(held[self.nodes] @ self.ways.T) > _SAME_DISPLACEMENT * size)), op=MPI.LOR):
            raise ValueError(
                f"{self.given.what}: supports prescribe other displacements at some of its nodes: leave these "
                "components free, or end the supports before the face"
            )


def moved_at(motions: FloatArray, r: FloatArray) -> FloatArray:
    """Displacements at r (p, 3) from the point in motions (6, q), shape (p, 3, q)."""
    return displacements_of(r, np.ones(len(r))) @ motions


@dataclass(frozen=True, eq=False)
class Section:
    """The section of a bolt, whose own unknown is along it.

    Attributes:
        place: Its middle, metres, shape (3,).
        direction: n, out of the slave face, shape (3,).
        radius: Root of its area over pi, metres.
        rim: Which of the tie's nodes on this rank are outermost: by the points that these follow it turns, shape (r,).
        arms: From its middle to these before deformation, turned as it has turned, metres, shape (r, 3).
        shortening: Where it is at a displacement (`turned_section`), s, metres.
    """

    face: str
    given: GivenBolt
    place: FloatArray
    direction: FloatArray
    radius: float
    rim: IntArray
    arms: FloatArray
    shortening: float = 0.0


@dataclass(frozen=True, eq=False)
class Prescribed:
    """By how much nodes are prescribed to be apart from what they follow.

    Attributes:
        amounts: Metres at an amplitude of 1, of each of j amplitudes, shape (m, 3, j).
        amplitudes: What each belongs to, in words, and its factor as a function of time.
    """

    amounts: FloatArray
    amplitudes: tuple[tuple[str, Amplitude], ...]

    def at(self, time: float, comm: MPI.Comm) -> FloatArray:
        """The sum at a time, metres, shape (m, 3); ValueError on every rank if an amplitude has no value then;
        collective."""

        def factors() -> FloatArray:
            return np.array([evaluate_amplitude(given, time, what) for what, given in self.amplitudes])

        return self.amounts @ on_all_ranks(factors, "", comm)


@dataclass(frozen=True, eq=False)
class Tie:
    """Two faces that are tied to each other; this rank's slave nodes.

    Attributes:
        kind: "tie", "cyclic symmetry", "rigid face", "pretension" or "equation".
        face, against: The faces; nodes of the first follow those of the other.  Of a rigid face and of equations both
            are the same, of the latter in words.
        why: Why it is the first, in words.
        nodes: Slave nodes among this rank's k nodes, ascending, shape (m,).
        area: Integrals of their functions over the tie, m^2, shape (m,).
        normal: Their outward unit normals, shape (m, 3).
        rows: W, their displacements by those of all nodes, shape (3 m, 3 nodes of all ranks).
        beside: The part of W of nodes of the slave face that are not tied, as clamped ones, of the same shape.
        traction: Tractions at them by forces on nodes, 1/m^2, shape (m, nodes of all ranks).
        remarks: What a user should know of it.
        conducting: Which nodes' temperatures follow others, of those that are not left out (k,), and their weights
            over all nodes, shapes (n,) and (n, nodes of all ranks); collective; None if none do.
        arm: Largest distance of a slave node from the point that it follows, over all ranks, metres.
        directions: Projectors on the directions along which the nodes follow others, shape (m, 3, 3): all of them, but
            for nodes on an axis of cyclic symmetry, which may move along it, and those of a rigid face that is free
            along itself.
        own: N, their displacements by q unknowns that the tie has of its own, metres per metre, shape (m, 3, q), the
            same q on every rank.
        motion: Of a rigid face, whose amounts its own unknowns are.
        bolt: Of the section of a bolt, whose shortening its own unknown is.
        prescribed: Of equations, their constants.
        lasting: When it acts, in words; empty if always.
    """

    kind: str
    face: str
    against: str
    why: str
    nodes: IntArray
    area: FloatArray
    normal: FloatArray
    rows: scipy.sparse.csr_matrix
    beside: scipy.sparse.csr_matrix
    traction: scipy.sparse.csr_matrix
    remarks: tuple[str, ...]
    directions: FloatArray
    own: FloatArray
    conducting: Callable[[BoolArray], tuple[IntArray, scipy.sparse.csr_matrix]] | None = None
    arm: float = 0.0
    motion: FaceMotion | None = None
    bolt: Section | None = None
    prescribed: Prescribed | None = None
    lasting: str = ""

    def joins(self, face: str, against: str) -> bool:
        """Whether it is of these two faces."""
        return {self.face, self.against} == {face, against}

    @property
    def of_faces(self) -> bool:
        """Whether it holds two faces together."""
        return self.face != self.against


class LinkedNodes(Protocol):
    """Springs between nodes: `Links`."""

    given: Sequence[Any]

    @property
    def nodes(self) -> list[IntArray]: ...

    @property
    def stiffness(self) -> scipy.sparse.csr_matrix: ...

    def forces(self, u: FloatArray, unit: bool = False) -> Iterator[tuple[Any, FloatArray]]: ...


class Follower(Lasting, Protocol):
    """What makes nodes follow others, as given."""

    @property
    def what(self) -> str:
        """Kind and faces, for messages."""
        ...

    def joined(self, body: Any, taken: BoolArray) -> Tie:
        """Its rows, of nodes that do not follow others already (`taken`, (k,)); ValueError on every rank if there are
        none; collective."""
        ...

    def as_made(self, tie: Tie) -> Follower:
        """The same, with the nodes of the same face as slaves whatever the meshes and supports."""
        ...


@dataclass(frozen=True, eq=False)
class Bolt:
    """The section of a bolt: its slave face, its middle (3,) in metres, its direction out of that face (3,), by how
    much it is shortened, metres, and whether that is given."""

    face: str
    centre: FloatArray
    direction: FloatArray
    shortening: float
    locked: bool
