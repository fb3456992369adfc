"""The nodes of the contact faces in the files as data of the check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray
from ...fem.geometry import Spin, inverse_frames
from ...model.accumulated import Accumulated
from ...model.nodal_answer import NodalAnswer
from ...solvers.laws import FrictionLaw
from ..run_files import WrittenRun


@dataclass(frozen=True)
class FaceNodes:
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
    area: FloatArray
    friction: FloatArray
    cohesion: FloatArray
    origin: FloatArray
    moved: FloatArray
    earlier: FloatArray

    def only(self, which: npt.NDArray[np.bool_]) -> FaceNodes:
        """A subset of the nodes."""
        return FaceNodes(**{name: values[which] for name, values in vars(self).items()})

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
        mean = self.average(x)
        place: FloatArray = mean + np.einsum("mij,mj->mi", self.mirrored, x[self.index] - mean)
        return place

    def average(self, values: FloatArray) -> FloatArray:
        """Averages of values at the nodes of the written face (q,) or (q, 3), shape (m,) or (m, 3)."""
        averages: FloatArray = self.weights @ values
        return averages

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

    def answer(
        self,
        run: WrittenRun,
        displacement: FloatArray,
        on_body: FloatArray,
        x: FloatArray,
        spins: tuple[Spin | None, ...],
    ) -> NodalAnswer:
        """The answer at the nodes.

        Args:
            run: The files.
            displacement: Displacement of the nodes of the body in metres, shape (k, 3).
            on_body: Contact forces on the body at the nodes of the written face in newtons, shape (q, 3).
            x: Coordinates of these, shape (q, 3).
            spins: Rotations of the foundations of the faces.
        """
        frames = self.frames
        return NodalAnswer(
            comm=MPI.COMM_SELF,
            law=FrictionLaw(self.cohesion * self.area, self.friction),
            faces=tuple(face_names(run)),
            part=self.part,
            x=self.place(x),
            frames=frames,
            gap=self.gap,
            given_gap=self.given_gap,
            area=self.area,
            slip_origin=np.einsum("kij,kj->ki", frames, self.origin),
            displacement=np.einsum("kij,kj->ki", frames, self.displacement(run, displacement)),
            force=-np.einsum("kij,kj->ki", inverse_frames(frames), on_body[self.index]),
            slip_bound=run.on_face["slip_bound"][self.index],
            spins=spins,
            earlier=Accumulated(*self.earlier.T),
            against=against_of(run),
            opposite_x=self.opposite @ run.body.x if run.opposite else None,
            several=len(run.body.parts) > 1,
        )


def face_names(run: WrittenRun) -> list[str]:
    """Names of the contact faces in summary.json.

    Raises:
        ValueError: If it has none.
    """
    try:
        names = run.summary["totals"]["faces"]
        if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
            return list(names)
    except (KeyError, TypeError):
        pass
    raise ValueError(f"{run.files.summary}: totals.faces does not name the contact faces")


def against_of(run: WrittenRun) -> tuple[str | None, ...]:
    """Of every contact face the face opposite, if it is one of a pair."""
    found: list[str | None] = [None] * len(face_names(run))
    for opposite in run.opposite:
        found[opposite.contact] = opposite.against
    return tuple(found)
