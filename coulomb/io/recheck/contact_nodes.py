"""The nodes of the contact faces in the files as data of the check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ...fem.geometry import Spin, inverse_frames
from ...model.evidence import pair_actions
from ...model.master_fields import carried, carrying
from ...model.nodal_answer import Accumulated, NodalAnswer
from ...solvers.laws import FrictionLaw
from ..field_files import OPPOSITE
from ..run_files import WrittenRun
from ..written_faces import WrittenOpposite


@dataclass(frozen=True)
class ContactNodes:
    """Nodes of contact faces, m of them; a node on two faces may be here twice.

    Attributes:
        index: Their numbers among the q nodes of the written faces, shape (m,).
        weights: By which displacements, gaps and places of the q nodes are averaged, shape (m, q).
        opposite: In pairs, by which those of the k nodes of the bodies are averaged over the face opposite, shape
            (m, k); empty rows against foundations.
        mirrored: In pairs, projectors on the directions across planes of symmetry, shape (m, 3, 3); else 0.
        part: Which face they are on, shape (m,).
        written: Whether they are written as contact nodes of this face, shape (m,).
        frames: Rows n, t1, t2, as `ContactSurface.frames`, shape (m, 3, 3).
        gap: Before deformation in metres, shape (m,).
        given_gap: The part of it that is given beside the distance to the foundation, metres, shape (m,).
        chord: As `ContactSurface.chord`, shape (m,); 0 as long as it is unknown.
        area: In m^2, shape (m,).
        friction: Coefficient of friction, shape (m,).
        cohesion: In pascals, shape (m,).
        origin: Displacement from which slip is measured, shape (m, 3).
        moved: Displacement of the foundation in the load step, metres, shape (m, 3); 0 as long as it is unknown.
        earlier: Accumulated slip, friction work and largest pressure before, shape (m, 3).
    """

    index: npt.NDArray[np.int64]
    weights: scipy.sparse.csr_matrix
    opposite: scipy.sparse.csr_matrix
    mirrored: FloatArray
    part: npt.NDArray[np.int64]
    written: npt.NDArray[np.bool_]
    frames: FloatArray
    gap: FloatArray
    given_gap: FloatArray
    chord: FloatArray
    area: FloatArray
    friction: FloatArray
    cohesion: FloatArray
    origin: FloatArray
    moved: FloatArray
    earlier: FloatArray

    @staticmethod
    def joined(faces: Sequence[ContactNodes]) -> ContactNodes:
        """Those of several faces."""
        parts = {name: [vars(face)[name] for face in faces] for name in vars(faces[0])}
        rows = {name: scipy.sparse.vstack(parts.pop(name), format="csr") for name in ("weights", "opposite")}
        return ContactNodes(**rows, **{name: np.concatenate(values) for name, values in parts.items()})

    def only(self, which: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> ContactNodes:
        """A subset of the nodes."""
        return ContactNodes(**{name: values[which] for name, values in vars(self).items()})

    @property
    def averaged(self) -> bool:
        """Whether they stand for averages over the facets around them."""
        return bool(self.weights.nnz != len(self.index))

    @property
    def paired(self) -> npt.NDArray[np.bool_]:
        """Which of them are in pairs of faces, shape (m,)."""
        return np.asarray(np.diff(self.opposite.indptr) > 0)

    def displacement(self, run: WrittenRun, u: FloatArray) -> FloatArray:
        """Their displacements of u (k, 3); in pairs against the face opposite; shape (m, 3)."""
        displacement: FloatArray = self.weights @ u[run.node] - self.opposite @ u
        displacement -= np.einsum("mij,mj->mi", self.mirrored, displacement)
        return displacement

    def place(self, x: FloatArray) -> FloatArray:
        """Where their forces act, of coordinates x (q, 3) of the nodes of the written faces, shape (m, 3)."""
        mean = self.weights @ x
        place: FloatArray = mean + np.einsum("mij,mj->mi", self.mirrored, x[self.index] - mean)
        return place

    def nodal_forces(self, run: WrittenRun, forces: FloatArray) -> FloatArray:
        """Forces at the nodes of all bodies in newtons, shape (k, 3), of forces at those of the written faces, shape
        (q, 3): those of contact points act by the weights, in pairs the opposite ones on the face opposite."""
        mine, nodal = self.only(self.written), forces
        if self.averaged:
            nodal = forces.copy()
            nodal[mine.index] = 0.0
            nodal = nodal + mine.weights.T @ forces[mine.index]
        at_nodes = np.zeros((len(run.body.x), 3))
        np.add.at(at_nodes, run.node, nodal)
        on_bodies: FloatArray = at_nodes - mine.opposite.T @ forces[mine.index]
        return on_bodies

    def actions(self, run: WrittenRun, forces: FloatArray) -> FloatArray | None:
        """What acts on both sides of every pair, with the forces opposite as written (`Evidence.actions`), of forces at
        the nodes of the written faces in newtons, shape (q, 3)."""
        x, found = run.body.x - run.body.x.mean(axis=0), []
        for other in run.opposite:
            mine = self.only(self.written & (self.part == other.contact))
            on_points, (slave, master) = forces[mine.index], np.zeros((2, *x.shape))
            np.add.at(slave, run.node, mine.weights.T @ on_points)
            np.add.at(master, other.face.node, other.fields["contact_force"])
            at, there = mine.weights @ run.on_face["x"], mine.opposite @ run.body.x
            found.append(pair_actions(x, slave, master, at, there, on_points))
        return np.array(found) if found else None

    def answer(
        self, run: WrittenRun, u: FloatArray, on_body: FloatArray, x: FloatArray, spins: tuple[Spin | None, ...]
    ) -> NodalAnswer:
        """The answer at the nodes, with displacements u (k, 3) of the nodes of the bodies, and contact forces on the
        body at the nodes x of the written faces, shapes (q, 3)."""
        against: list[str | None] = [None] * len(face_names(run))
        for one in run.opposite:
            against[one.contact] = one.against
        return NodalAnswer(
            comm=MPI.COMM_SELF,
            law=FrictionLaw(self.cohesion * self.area, self.friction),
            faces=tuple(face_names(run)),
            part=self.part,
            x=self.place(x),
            frames=self.frames,
            gap=self.gap,
            given_gap=self.given_gap,
            chord=self.chord,
            area=self.area,
            slip_origin=np.einsum("kij,kj->ki", self.frames, self.origin),
            displacement=np.einsum("kij,kj->ki", self.frames, self.displacement(run, u)),
            force=-np.einsum("kij,kj->ki", inverse_frames(self.frames), on_body[self.index]),
            slip_bound=run.on_face["slip_bound"][self.index],
            spins=spins,
            earlier=Accumulated(*self.earlier.T),
            against=tuple(against),
            opposite_x=self.opposite @ run.body.x if run.opposite else None,
            several=len(run.body.parts) > 1,
        )


def face_names(run: WrittenRun) -> list[str]:
    """Names of the contact faces in summary.json; ValueError if it has none."""
    try:
        names = run.summary["totals"]["faces"]
        if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
            return list(names)
    except (KeyError, TypeError):
        pass
    raise ValueError(f"{run.files.summary}: totals.faces does not name the contact faces")


def opposite_fields(
    run: WrittenRun, nodes: ContactNodes, answer: NodalAnswer, other: WrittenOpposite
) -> dict[str, FloatArray]:
    """The fields of a face opposite, carried over from the written contact nodes with the answer there."""
    here = nodes.part == other.contact
    rows = nodes.opposite[here]
    weights = carrying(rows, nodes.area[here])
    fields = {name: values[here] for name, values in answer.fields().items()}
    at_nodes = carried(fields, lambda values: np.asarray(weights.T @ values))
    at_nodes[OPPOSITE] = np.full(len(at_nodes["status"]), float(other.contact))
    at_nodes["contact_force"] = -(rows.T @ fields["contact_force"])
    body, local = other.face.part.body, other.face.node - other.face.part.nodes.start
    area, outward = (values[local] for values in body.positive_weights(other.face.number))
    length = np.linalg.norm(outward, axis=1)[:, None]
    found = {name: values[other.face.node] for name, values in at_nodes.items()}
    return found | {"normal": outward / np.where(length > 0.0, length, 1.0), "area": area}
