"""The pairs of the files, judged as those of a problem by code that shares nothing with the mortar integration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...fem.contact import NO_SHAPE, Claims
from ...model.pair_checks import PairFindings, PairReference, Side, findings, probing_fields, tied_nodes
from ..run_files import WrittenFace, WrittenRun
from .case_reference import CaseReference
from .contact_nodes import ContactNodes
from .face_geometry import written_shape


def judged_pairs(
    run: WrittenRun,
    nodes: ContactNodes,
    case: CaseReference | None,
    faces: Sequence[tuple[WrittenFace, npt.NDArray[np.int32]]],
) -> tuple[PairFindings, ...]:
    """What is off in the contact points of all pairs, with the displacement of the files; `faces` are of every contact
    face its grid and its facets.  Without a case gaps that are 0 are taken as closed, and those between surfaces that
    are known to the run alone are not judged."""
    found = []
    fields = probing_fields(run.body.x, float(np.max(np.abs(run.body.x))) or 1.0)
    u: FloatArray = run.on_body["displacement"]
    known = np.full(len(u), case is None)  # without a case ties are not known
    known[run.node[nodes.index[nodes.written]]] = True
    if case is not None and case.tied:
        known[np.argsort(case.nodes_of_tied_body(run))[tied_nodes(case.tied_body)]] = True
    for other in run.opposite:
        number, here = other.contact, nodes.only(nodes.part == other.contact)
        (face, facets), there = faces[number], other.face.part
        shape = written_shape(run, number) if case is None else case.contacts[number].shape
        node = (run.node[here.index] - face.part.nodes.start).astype(np.int64)
        gap = np.full(len(node), np.nan) if shape is None else here.gap - here.given_gap
        one = Side(face.part.body, facets, run.held_in(face.part))
        two = Side(there.body, other.face.number, run.held_in(there))
        reference = PairReference(one, two, node, shape or NO_SHAPE)
        sides = face.part.nodes, there.nodes
        averages = np.stack([here.weights @ fields[run.node], here.opposite @ fields])
        weights = reference.weights((fields[sides[0]], fields[sides[1]]), averages)
        rows = np.einsum("mij,mj->mi", here.frames, here.displacement(run, u))
        moved = reference.displacement((u[sides[0]], u[sides[1]]), here.mirrored, here.frames, rows)
        held = run.held.projector_at(run.node[here.index])
        adjust = np.inf if case is None else case.contacts[number].adjust
        claims = Claims(node, here.frames[:, 0], gap, here.area, held, adjust)
        x, name = here.place(run.on_face["x"]), run.face_names[number]
        off, left = reference.samples.deviations(claims), reference.left_out(known[face.part.nodes])
        found.append(findings(name, other.against, x, off, weights, moved, left))
    return tuple(found)
