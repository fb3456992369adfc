"""Faces that move as rigid bodies: all nodes follow the motion of a reference point.

A motion is a combination of r rigid motions rho_j, those that are neither prescribed nor prevented by supports on the
face.  Their amounts are unknowns of the face's own, in metres: u = rho(x) alpha + t(x), t the prescribed part.
Equilibrium of the forces on it is that of their resultants along the free motions.  A plane face that is free along
itself has the motions along its normal n alone, and n . u follows them.

In large motions rotations are finite (`finite_motions`).

A spring of stiffness S between the reference point and the ground acts on q = C^T u, the rigid motion that fits the
displacements best: C = A (A^T A)^-1, A the rigid motions at the nodes.  Its nodal forces -C S q have resultants -S q.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import scipy.sparse
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, is_number
from ...units import amount
from ..geometry import Amplitude, Point, check_angle, check_point, rotation_matrix
from .deformable import Deformable
from .finite_motions import FiniteMotion
from .rigid_modes import null_space
from .ties import FaceMotion, GivenFace, Tie, moved_at

_FREE: Final = 1e-10
"""Part of the energy of a motion that supports take below which they do not prevent it."""

_SAME_COMPONENT: Final = 1e-9
"""Part of the prescribed components up to which they are the same."""

_PLANE: Final = 1e-5
"""Distance of nodes from a plane over the size of the face up to which it is plane; 1 less the cosine of an angle."""


@dataclass(frozen=True)
class RigidFace(GivenFace):
    """A face that moves as a rigid body, with a reference point.

    Loads on the face act on its motion by their resultants; supports on some of its nodes, as planes of symmetry
    through it, prevent what they hold.

    Attributes:
        face: Name of the face.
        point: The reference point, metres; by default the middle of the face.
        translation: Displacement of the point along x, y and z in metres; None where it is free.
        rotation: Rotation about axes along x, y and z through the point, radians; None where it is free.  In large
            motions the components of the rotation vector, the axis times the angle.
        amplitude: Factor of translation and rotation as a function of time.
        amplitudes: Factors of single components of translation and rotation, six, in place of it; None for that.
        translation_stiffness: Stiffness of a spring between the point and the ground along x, y and z, N/m.
        rotation_stiffness: The same against rotation about axes along x, y and z, N m per radian; in large motions the
            energy is half of it times the squares of the components of the rotation vector.
        along: "rigid", or "free" for a plane face that stays plane, of which the nodes move freely along the face: only
            translation along its normal and rotation about axes in it are motions then.

    Raises:
        ValueError: If an entry is neither None nor a finite number, a stiffness is negative, `along` is something else,
            or there are not six amplitudes.
    """

    face: str
    point: Point | None = None
    translation: Sequence[float | None] = (None, None, None)
    rotation: Sequence[float | None] = (None, None, None)
    amplitude: Amplitude = 1.0
    amplitudes: Sequence[Amplitude | None] = (None,) * 6
    translation_stiffness: Sequence[float] = (0.0, 0.0, 0.0)
    rotation_stiffness: Sequence[float] = (0.0, 0.0, 0.0)
    along: Literal["rigid", "free"] = "rigid"

    kind = "rigid face"
    begin = end = reaches = None

    def __post_init__(self) -> None:
        if not isinstance(self.face, str) or not self.face:
            raise ValueError(f"{self.kind}: a face must be given by its name, but is {self.face!r}")
        if self.point is not None:
            check_point(f"{self.what}: point", self.point)
        for name, given in (("translation", self.translation), ("rotation", self.rotation)):
            if len(given) != 3 or not all(one is None or is_number(one, -np.inf) for one in given):
                raise ValueError(
                    f"{self.what}: {name} must be three numbers, or None where it is free, but is {given!r}"
                )
        for one in self.rotation:
            if one is not None:
                check_angle(f"{self.what}: rotation", one)
        for name in ("translation_stiffness", "rotation_stiffness"):
            given = getattr(self, name)
            if len(given) != 3 or not all(is_number(one, 0.0) for one in given):
                raise ValueError(f"{self.what}: {name} must be three numbers >= 0, but is {given!r}")
        if len(self.amplitudes) != 6:
            raise ValueError(f"{self.what}: amplitudes must be six, or None, but are {len(self.amplitudes)}")
        if self.along not in ("rigid", "free"):
            raise ValueError(f"{self.what}: along must be 'rigid' or 'free', but is {self.along!r}")

    @property
    def prescribed(self) -> BoolArray:
        """Which of the six components are prescribed, shape (6,)."""
        return np.array([one is not None for one in (*self.translation, *self.rotation)])

    def as_made(self, tie: Tie) -> RigidFace:
        """Itself."""
        return self

    def joined(self, body: Deformable, taken: BoolArray) -> Tie:
        """Its nodes, and how they move; collective; errors as of `rigid_face_of`."""
        return rigid_face_of(body, self, taken)


def rigid_face_of(body: Deformable, given: RigidFace, taken: BoolArray) -> Tie:
    """A rigid face of nodes that are in no tie (`taken`, (k,)), with its motion; collective.

    Raises:
        ValueError: On every rank, if the face is unknown, nodes of it are tied, or nothing of it can move; if it is to
            be free along itself also if it is not plane, or what is prescribed or held is not along its normal.
    """
    comm, (member, facets) = body.comm, body.face(given.face, given.kind)
    nodes = (member.nodes.start + member.body.nodes_of(facets)).astype(np.int64)
    if comm.allreduce(bool(np.any(taken[nodes])), op=MPI.LOR):
        raise ValueError(
            f"{given.what}: some of its nodes are tied already: give the rigid face before ties, or another"
        )
    x, area = body.x[nodes], member.body.area_of(facets)
    normal = member.body.normal_of(facets).sum(axis=0)
    whole = comm.allreduce(np.concatenate([area @ member.body.x, normal, [area.sum()]]))
    middle = whole[:3] / whole[6]
    point = middle if given.point is None else np.array(given.point, dtype=np.float64)
    r = x - point
    size = comm.allreduce(float(np.max(np.linalg.norm(r, axis=1), initial=0.0)), op=MPI.MAX)
    held = body.held.projector_at(nodes)
    ways: FloatArray = np.eye(3)
    possible: FloatArray = np.diag([1.0] * 3 + [1.0 / size] * 3)
    component = body.component[nodes]
    sprung = comm.allreduce(int(np.min(component, initial=np.iinfo(np.int64).max)), op=MPI.MIN)
    rigid = moved_at(possible, r) * (component == sprung)[:, None, None]
    gram = comm.allreduce(np.einsum("mcp,mcq->pq", rigid, rigid))
    spread = rigid @ np.linalg.solve(gram, possible)
    if given.along == "free":
        n = _normal(given, whole[3:6] / whole[6], x - middle, comm)
        ways, tangents = n[None], np.linalg.svd(n[None])[2][1:]
        possible = np.block([[n[:, None], np.zeros((3, 2))], [np.zeros((3, 1)), tangents.T / size]])
        part = np.einsum("i,mij,j->m", n, held, n)
        if comm.allreduce(bool(np.any((part > _PLANE) & (part < 1.0 - _PLANE))), op=MPI.LOR):
            raise ValueError(
                f"{given.what}: supports hold some of its nodes along a direction that is neither along its normal nor "
                "along the face: end them before the face"
            )
    free, given_part = _left_free(given, possible, size)
    follow = ways.T @ ways
    against = np.einsum("mij,jk,mkq->miq", held, follow, moved_at(free, r))
    energy = comm.allreduce(np.einsum("miq,mip->qp", against, against))
    count = comm.allreduce(float(len(nodes)))
    motions = free @ null_space(energy, _FREE * count) if free.shape[1] else free
    moved = follow @ moved_at(motions, r)
    sizes, axes = np.linalg.eigh(comm.allreduce(np.einsum("miq,mip->qp", moved, moved)))
    motions = motions @ axes[:, sizes > _FREE * count]  # not those about a line of nodes
    none = scipy.sparse.csr_matrix((3 * len(nodes), 3 * body.numbering.total))
    motion = FaceMotion(given, point, nodes, ways, motions, given_part, spread)
    if member.body.large:
        motion = _finite(motion, r, held, size, comm)
    return Tie(
        given.kind,
        given.face,
        given.face,
        "its nodes follow its motion",
        nodes=nodes,
        area=np.zeros(len(nodes)),
        normal=np.zeros((len(nodes), 3)),
        rows=none,
        beside=none,
        traction=scipy.sparse.csr_matrix((len(nodes), body.numbering.total)),
        remarks=(),
        directions=np.tile(follow, (len(nodes), 1, 1)),
        own=motion.own(body.x),
        motion=motion,
    )


def _finite(motion: FaceMotion, r: FloatArray, held: FloatArray, size: float, comm: MPI.Comm) -> FaceMotion:
    """The same motion with finite rotations, of a face of a size with nodes at r (m, 3) from its point, which are held
    along the directions of projectors (m, 3, 3); itself where it cannot turn; collective.

    Raises:
        ValueError: On every rank, if that needs directions that turn, or the rotation does not follow from the nodes.
    """
    given, linear, part = motion.given, motion.motions[3:], motion.given_part.sum(axis=1)
    if len(motion.ways) < 3:
        if np.any(np.abs(linear) * size > _SAME_COMPONENT) or np.any(part[3:]):
            raise ValueError(
                f"{given.what}: along = 'free' is in large motions for a face that moves along its normal and does not "
                "turn: prescribe its rotation as 0, or leave along out"
            )
        return motion
    sums = comm.allreduce(np.column_stack([r.T @ r, r.sum(axis=0), np.full(3, len(r))]))
    spread = sums[:, :3] - np.outer(sums[:, 3], sums[:, 3]) / sums[0, 4]
    if np.linalg.eigvalsh(spread)[1] < _PLANE * size**2:
        raise ValueError(f"{given.what}: its nodes are on a line, about which its rotation would be unknown")
    finite = FiniteMotion(**vars(motion), arms=r)
    free = np.linalg.norm(motion.motions * np.repeat([1.0, size], 3)[:, None], axis=0)
    scales = np.divide(1.0, free, out=np.zeros_like(free), where=free > 0.0)
    for number in range(2):
        q = part + motion.motions @ (scales * np.cos(1.0 + number + np.arange(len(scales))))
        moved = q[:3] + r @ rotation_matrix(q[3:]).T - r
        off = np.einsum("mij,mj->mi", held, moved - part[:3])
        if comm.allreduce(bool(np.any(np.abs(off) > _PLANE * size)), op=MPI.LOR):
            raise ValueError(
                f"{given.what}: supports hold some of its nodes along directions in which finite rotations move them: "
                "let supports on its nodes be planes of symmetry, and prescribe the rest by translation and rotation"
            )
    return finite


def _normal(given: RigidFace, mean: FloatArray, r: FloatArray, comm: MPI.Comm) -> FloatArray:
    """The unit normal (3,) of a plane face, by the mean of normals and its nodes at r (m, 3) from its middle;
    collective.

    Raises:
        ValueError: On every rank, if the face is not plane.
    """
    length = float(np.linalg.norm(mean))
    n = mean / (length or 1.0)
    n[np.abs(n) < _FREE] = 0.0
    size, off = (
        comm.allreduce(float(np.max(of, initial=0.0)), op=MPI.MAX) for of in (np.linalg.norm(r, axis=1), np.abs(r @ n))
    )
    if off > _PLANE * size or length < 1.0 - _PLANE:
        raise ValueError(
            f"{given.what}: along = 'free' is for a plane face, but nodes are up to {amount(off)} off the plane of its "
            f"mean normal ({', '.join(f'{one:.3g}' for one in n)}); leave along out for a face that moves as a whole"
        )
    return n


def _left_free(given: RigidFace, possible: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    """Of possible motions, the span of columns (6, q) of a face of a size, those without the prescribed components,
    shape (6, r), and what each of these adds to one with them, shape (6, 6).

    Raises:
        ValueError: If no motion has these components, or its spring resists other motions.
    """
    which, scale = given.prescribed, np.repeat([1.0, size], 3)
    asked = np.diag(scale * [one or 0.0 for one in (*given.translation, *given.rotation)])[which]
    rows = (scale[:, None] * possible)[which]
    amounts = np.linalg.pinv(rows) @ asked
    off = rows @ amounts - asked
    if all(amplitude is None for amplitude in given.amplitudes):
        off = off.sum(axis=1, keepdims=True)
    off = np.any(np.abs(off) > _SAME_COMPONENT * np.max(np.abs(asked), initial=0.0), axis=1)
    if np.any(off | (np.linalg.norm(rows, axis=1) < _PLANE)):
        raise ValueError(
            f"{given.what}: no motion of it has the components that are prescribed: along the face its nodes are free, "
            "so that it moves along its normal and rotates about axes in it; hold nodes along the face by supports"
        )
    S, span = np.diag(given.stiffness / scale**2), scale[:, None] * possible
    if np.any(np.abs(S - S @ span @ span.T) > _PLANE * np.max(S)):
        raise ValueError(
            f"{given.what}: its spring resists motions along the face, where its nodes are free: give stiffness along "
            "its normal and about axes in it, and springs on other faces"
        )
    return possible @ null_space(rows.T @ rows, _FREE), possible @ amounts
