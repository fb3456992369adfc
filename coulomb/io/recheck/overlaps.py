"""The surface of the bodies in the files of a run, with contact pairs, ties and foundations of the case: where it runs
through itself (`fem.contact.overlaps`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray, unit_vectors
from ...fem.bodies import DisplacementSpace, Tie
from ...fem.contact import Face, Obstacle, Overlap, Part, Sides, Surface, facet_patch
from ...fem.meshes import SEPARATOR, boundary_facets
from ...linalg.reductions import Reductions
from ...model.overlap import deformations
from ..run_bodies import WrittenBody, places
from ..run_files import WrittenFace, WrittenRun
from .case_reference import CaseReference
from .contact_nodes import ContactNodes


class WrittenSurface:
    """The surface of the bodies of a run.

    Args:
        run: The files.
        case: The case; None if it is unknown: then faces have no names, and there are no ties and no foundations.
        time: Of the foundations.
        faces: Each contact face with its facets.
        nodes: The contact nodes.
    """

    def __init__(
        self,
        run: WrittenRun,
        case: CaseReference | None,
        time: float,
        faces: Sequence[tuple[WrittenFace, npt.NDArray[np.int32]]],
        nodes: ContactNodes,
    ):
        self._run, self._names = run, [part.name for part in run.body.parts]
        named: dict[str, dict[str, npt.NDArray[np.int32]]] = {name: {} for name in self._names}
        ties = list[Tie]()
        if case is not None:
            named = {part.name: _named_faces(part, case) for part in run.body.parts}
            ties = [tie for tie in case.tied_body.ties if tie.kind != "rigid face"] if case.tied else []

        def face(name: str) -> Face:
            body, _, own = ("", "", name) if self._names == [""] else name.partition(SEPARATOR)
            return self._names.index(body), named[body][own]

        self._slaves = [(self._names.index(one.part.name), facets) for one, facets in faces]
        sides = [
            Sides(self._slaves[one.contact], (self._names.index(one.face.part.name), one.face.number))
            for one in run.opposite
        ]
        sides += [Sides(face(tie.face), face(tie.against)) for tie in ties]
        points = run.node[nodes.index]
        self._judged = [points[nodes.written & (nodes.part == one.contact)] for one in run.opposite]
        if case is not None and ties:
            order = np.argsort(case.nodes_of_tied_body(run))
            self._judged += [order[tie.nodes] for tie in ties]
        given = [np.max(nodes.given_gap[nodes.part == k], initial=0.0) for k in range(len(faces))]
        self._gaps = [*(float(given[one.contact]) for one in run.opposite), *(0.0 for _ in ties)]
        self._obstacles = [] if case is None else self._of_foundations(case, time, given)
        parts = [Part(part.name, part.body, named[part.name]) for part in run.body.parts]
        self._surface = Surface(parts, sides, run.body.comm)

    def _of_foundations(self, case: CaseReference, time: float, given: Sequence[float]) -> list[Obstacle]:
        each = zip(case.contacts, self._slaves, case.foundations(None), case.foundations(time), given, strict=True)
        return [
            Obstacle(repr(contact.face), face, before, now, float(gap))
            for contact, face, before, now, gap in each
            if before and now
        ]

    def overlap(self, u: FloatArray, internal: FloatArray) -> Overlap | None:
        """The largest, at displacements with these internal forces, shapes (k, 3)."""
        body = self._run.body
        deformation = deformations(u, internal, body.component, Reductions(body.comm))
        return self._surface.deepest(u, body.component, deformation, self._judged, self._gaps, self._obstacles)


def _named_faces(part: WrittenBody, case: CaseReference) -> dict[str, npt.NDArray[np.int32]]:
    """The facets of a body in the files that are on the named faces of the case."""
    body, outer = case.bodies[part.name], boundary_facets(part.body.domain)
    here = _sides(part.body, outer)
    found = {name: places(here, _sides(body, facets)) for name, facets in body.mesh.faces.items()}
    return {name: np.sort(outer[rows[rows >= 0]]) for name, rows in found.items()}


def _sides(space: DisplacementSpace, facets: npt.NDArray[np.int32]) -> FloatArray:
    """Middles and outward normals of facets, ascending, shape (f, 6): those of parts that touch differ."""
    patch = facet_patch(space, facets)
    return np.column_stack([patch.x.mean(axis=1), unit_vectors(patch.middle_vectors) * np.max(np.abs(space.x))])
