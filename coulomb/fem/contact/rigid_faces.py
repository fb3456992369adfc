"""Faces that move as rigid bodies: all nodes follow the motion of a reference point.

A motion is a combination of r rigid motions rho_j, those that are neither prescribed nor prevented by supports on the
face.  r degrees of freedom of nodes of the face determine its amounts, alpha = E^-1 (u - t) there, E the motions at
them; all others follow, u = rho(x) alpha + t(x), t the prescribed part.  So the face has no unknowns but those of its
nodes, and equilibrium of the forces on it, T^T of the nodal forces, is that of their resultants along the free motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray, is_number
from ..bodies import Deformable, Tie, anchors_of, null_space
from ..geometry import Amplitude, Point, check_point, evaluate_amplitude, on_all_ranks
from ..meshes import starts_of

_FREE = 1e-10
"""Part of the energy of a motion that supports take below which they do not prevent it."""

_ROUNDING = 1e-9
"""Part of the prescribed displacements up to which they are the same."""


@dataclass(frozen=True)
class RigidFace:
    """A face that moves as a rigid body, with a reference point.

    Loads on the face act on its motion by their resultants; supports on some of its nodes, as planes of symmetry
    through it, prevent what they hold.

    Attributes:
        face: Name of the face.
        point: The reference point, metres; by default the middle of the face.
        translation: Displacement of the point along x, y and z in metres; None where it is free.
        rotation: Rotation about axes along x, y and z through the point, radians, in the theory of small strains; None
            where it is free.
        amplitude: Factor of translation and rotation as a function of time.

    Raises:
        ValueError: If an entry is neither None nor a finite number.
    """

    face: str
    point: Point | None = None
    translation: Sequence[float | None] = (None, None, None)
    rotation: Sequence[float | None] = (None, None, None)
    amplitude: Amplitude = 1.0

    kind = "rigid face"

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

    @property
    def what(self) -> str:
        return f"{self.kind} {self.face!r}"

    @property
    def prescribed(self) -> npt.NDArray[np.bool_]:
        """Which of the six components are prescribed, shape (6,)."""
        return np.array([one is not None for one in (*self.translation, *self.rotation)])

    def values(self, time: float, comm: MPI.Comm) -> FloatArray:
        """The prescribed components at a time, 0 where free, shape (6,); collective.

        Raises:
            ValueError: On every rank, if the amplitude has no value then.
        """
        factor = on_all_ranks(lambda: evaluate_amplitude(self.amplitude, time, self.what), "", comm)
        return factor * np.array([one or 0.0 for one in (*self.translation, *self.rotation)])

    def joined(self, body: Deformable, taken: npt.NDArray[np.bool_]) -> tuple[Tie, FaceMotion]:
        """Its nodes, and how they move; collective; errors as of `rigid_face_of`."""
        return rigid_face_of(body, self, taken)


@dataclass(frozen=True)
class FaceMotion:
    """The motion of a rigid face.

    Attributes:
        given: As given.
        point: The reference point, metres, shape (3,).
        nodes: Its nodes among this rank's k nodes, ascending, shape (m,).
        motions: The free motions as translations of the point and rotations about it, shape (6, r).
        anchors: Number of the node of each of the r degrees of freedom among this rank's, -1 elsewhere, and its axis.
        inverse: E^-1, shape (r, r).
    """

    given: RigidFace
    point: FloatArray
    nodes: npt.NDArray[np.int64]
    motions: FloatArray
    anchors: tuple[tuple[int, int], ...]
    inverse: FloatArray

    def prescribed(self, x: FloatArray, time: float, comm: MPI.Comm) -> FloatArray:
        """t at nodes x (k, 3) of the face, 0 at others, metres, shape (k, 3); collective."""
        values, t = self.given.values(time, comm), np.zeros_like(x)
        t[self.nodes] = _moved(values[:, None], x[self.nodes] - self.point)[:, :, 0]
        return t

    def refuse_other(self, held: FloatArray, size: float, comm: MPI.Comm) -> None:
        """ValueError on every rank if supports prescribe other displacements at its nodes than it does: `held` (k, 3)
        is the difference along held directions, of displacements of a size, metres; collective."""
        if comm.allreduce(bool(np.any(np.abs(held[self.nodes]) > _ROUNDING * size)), op=MPI.LOR):
            raise ValueError(
                f"{self.given.what}: supports prescribe other displacements at some of its nodes: leave these "
                "components free, or end the supports before the face"
            )

    def found(self, u: FloatArray, t: FloatArray, values: FloatArray, comm: MPI.Comm) -> FloatArray:
        """Translation of the point and rotation about it, shape (6,), of displacements u with the prescribed part t (k,
        3) of the values (6,); collective."""
        there = [u[node, axis] - t[node, axis] if node >= 0 else 0.0 for node, axis in self.anchors]
        amounts = self.inverse @ comm.allreduce(np.array(there), op=MPI.SUM)
        motion: FloatArray = values + self.motions @ amounts
        return motion


def _moved(motions: FloatArray, r: FloatArray) -> FloatArray:
    """Displacements at r (p, 3) from the point in motions (6, q), shape (p, 3, q)."""
    turned = np.cross(np.broadcast_to(motions[3:].T[None], (len(r), motions.shape[1], 3)), r[:, None, :])
    found: FloatArray = motions[None, :3] + np.swapaxes(turned, 1, 2)
    return found


def rigid_face_of(body: Deformable, given: RigidFace, taken: npt.NDArray[np.bool_]) -> tuple[Tie, FaceMotion]:
    """A rigid face of nodes that are in no tie (`taken`, (k,)), and its motion; collective.

    Raises:
        ValueError: On every rank, if the face is unknown, nodes of it are tied, or nothing of it can move.
    """
    comm, (member, facets) = body.comm, body.face(given.face, given.kind)
    nodes = (member.nodes.start + member.body.nodes_of(facets)).astype(np.int64)
    if comm.allreduce(bool(np.any(taken[nodes])), op=MPI.LOR):
        raise ValueError(
            f"{given.what}: some of its nodes are tied already: give the rigid face before ties, or another"
        )
    x, area = body.x[nodes], member.body.area_of(facets)
    whole = comm.allreduce(np.append(area @ member.body.x, area.sum()), op=MPI.SUM)
    point = whole[:3] / whole[3] if given.point is None else np.array(given.point, dtype=np.float64)
    r = x - point
    size = comm.allreduce(float(np.max(np.linalg.norm(r, axis=1), initial=0.0)), op=MPI.MAX)
    unit = np.diag([1.0] * 3 + [1.0 / size] * 3)[:, ~given.prescribed]
    held = body.held.projector_at(nodes)
    against = np.einsum("mij,mjq->miq", held, _moved(unit, r))
    energy = comm.allreduce(np.einsum("miq,mip->qp", against, against), op=MPI.SUM)
    count = comm.allreduce(float(len(nodes)), op=MPI.SUM)
    motions = unit @ null_space(energy, _FREE * count) if unit.shape[1] else unit
    if motions.shape[1] == 0:
        raise ValueError(
            f"{given.what}: nothing of it is free; prescribe its motion by PrescribedDisplacement or a clamp"
        )
    everywhere = np.zeros(len(body.x), dtype=bool)
    everywhere[nodes] = True
    anchors = anchors_of(body.x, [everywhere], lambda at: _moved(motions, at - point), comm)
    first, rows_of_anchors = starts_of(comm, len(body.x)), np.zeros((len(anchors), motions.shape[1]))
    for row, anchor in enumerate(anchors):
        rows_of_anchors[row] = _moved(motions, anchor.x[None] - point)[0, anchor.axis]
    inverse = np.linalg.inv(rows_of_anchors)
    columns = np.array([3 * (first[anchor.rank] + anchor.node) + anchor.axis for anchor in anchors], dtype=np.int64)
    free, directions = np.eye(3) - held, np.tile(np.eye(3), (len(nodes), 1, 1))
    place = {int(node): number for number, node in enumerate(nodes)}
    mine = [(anchor.node if anchor.rank == comm.rank else -1, anchor.axis) for anchor in anchors]
    for node, axis in mine:
        if node >= 0:
            directions[place[node], axis, axis] = 0.0
    blocks = directions @ free @ (_moved(motions, r) @ inverse)
    shape = (3 * len(nodes), 3 * body.numbering.total)
    rows = scipy.sparse.csr_matrix(
        (blocks.ravel(), np.tile(columns, 3 * len(nodes)), np.arange(3 * len(nodes) + 1) * len(anchors)), shape
    )
    rows.eliminate_zeros()
    none, nothing = scipy.sparse.csr_matrix((len(nodes), body.numbering.total)), np.zeros((len(nodes), 3))
    tie = Tie(
        *(given.kind, given.face, given.face, "its nodes follow its motion", nodes, np.zeros(len(nodes)), nothing),
        *(rows, rows, none, (), directions),
    )
    return tie, FaceMotion(given, point, nodes, motions, tuple(mine), inverse)
