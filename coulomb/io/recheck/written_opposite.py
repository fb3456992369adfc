"""Fields on the faces opposite in pairs, recomputed from the contact points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arrays import FloatArray
from ...model.evidence import pair_actions
from ...model.master_fields import carried, carrying
from ...model.nodal_answer import NodalAnswer
from ..field_files import OPPOSITE
from ..run_files import WrittenRun
from ..written_faces import WrittenOpposite
from .comparison import Comparison
from .face_nodes import FaceNodes

Fields = dict[str, FloatArray]


def opposite_fields(run: WrittenRun, nodes: FaceNodes, answer: NodalAnswer, other: WrittenOpposite) -> Fields:
    """The fields of a face opposite.

    Args:
        run: The files.
        nodes: The written contact nodes.
        answer: The answer there.
        other: The face.
    """
    here = nodes.part == other.contact
    rows = nodes.opposite[here]
    weights = carrying(rows, nodes.area[here])
    fields = {name: values[here] for name, values in answer.fields().items()}

    def spread(values: FloatArray) -> FloatArray:
        return np.asarray(weights.T @ values)

    at_nodes = carried(fields, spread)
    at_nodes[OPPOSITE] = np.full(len(at_nodes["status"]), float(other.contact))
    at_nodes["contact_force"] = -(rows.T @ fields["contact_force"])
    body, local = other.face.part.body, other.face.node - other.face.part.nodes.start
    area, outward = (values[local] for values in body.positive_weights(other.face.number))
    length = np.linalg.norm(outward, axis=1)[:, None]
    found = {name: values[other.face.node] for name, values in at_nodes.items()}
    return found | {"normal": outward / np.where(length > 0.0, length, 1.0), "area": area}


def written_actions(run: WrittenRun, nodes: FaceNodes, forces: FloatArray) -> FloatArray | None:
    """What acts on both sides of every face opposite, with the forces on it as written: `Evidence.actions`.

    Args:
        run: The files.
        nodes: The contact nodes.
        forces: Forces at the nodes of the written faces in newtons, shape (q, 3).
    """
    x = run.body.x - run.body.x.mean(axis=0)
    found = []
    for other in run.opposite:
        mine = nodes.only(nodes.written & (nodes.part == other.contact))
        on_points = forces[mine.index]
        slave, master = np.zeros_like(x), np.zeros_like(x)
        np.add.at(slave, run.node, mine.weights.T @ on_points)
        np.add.at(master, other.face.node, other.fields["contact_force"])
        at, opposite = mine.average(run.on_face["x"]), mine.opposite @ run.body.x
        found.append(pair_actions(x, slave, master, at, opposite, on_points))
    return np.array(found) if found else None


def compare_opposite(other: WrittenOpposite, variants: Sequence[Fields], found: Comparison) -> None:
    """Compare the fields of a face opposite with those recomputed from the numbers as written, and perturbed."""
    first, *others = variants
    x = other.fields["x"]
    for name, expected in first.items():
        rounded = [] if name in ("status", OPPOSITE) else [fields[name] for fields in others]
        floor = 1e-13 if name == "normal" else 1e-12 * float(np.max(np.abs(expected), initial=0.0))
        source = "the contact points opposite"
        found.field(
            f"contact.xdmf: {name} of {other.face.name}", other.fields[name], expected, x, source, rounded, floor
        )
