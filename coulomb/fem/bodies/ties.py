"""What nodes of a face follow: nodes of another, or unknowns of the tie's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ...arrays import FloatArray


@dataclass(frozen=True)
class Tie:
    """Two faces that are tied to each other; this rank's slave nodes.

    Attributes:
        kind: "tie", "cyclic symmetry", "rigid face" or "pretension".
        face, against: The faces; nodes of the first follow those of the other.
        why: Why it is the first, in words.
        nodes: Slave nodes among this rank's k nodes, ascending, shape (m,).
        area: Integrals of their functions over the tie, m^2, shape (m,).
        normal: Their outward unit normals, shape (m, 3).
        rows: W, their displacements by those of all nodes, shape (3 m, 3 nodes of all ranks).
        beside: The part of W of nodes of the slave face that are not tied, as clamped ones, of the same shape.
        traction: Tractions at them by forces on nodes, 1/m^2, shape (m, nodes of all ranks).
        remarks: What a user should know of it.
        directions: Projectors on the directions along which the nodes follow others, shape (m, 3, 3): all of them, but
            for nodes on an axis of cyclic symmetry, which may move along it, and those of a rigid face that is free
            along itself.
        own: N, their displacements by q unknowns that the tie has of its own, metres per metre, shape (m, 3, q), the
            same q on every rank.
    """

    kind: str
    face: str
    against: str
    why: str
    nodes: npt.NDArray[np.int64]
    area: FloatArray
    normal: FloatArray
    rows: scipy.sparse.csr_matrix
    beside: scipy.sparse.csr_matrix
    traction: scipy.sparse.csr_matrix
    remarks: tuple[str, ...]
    directions: FloatArray
    own: FloatArray
