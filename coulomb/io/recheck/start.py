"""The start of a load step, as the files of the step before have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays import FloatArray
from ...model.accumulated import ACCUMULATED
from ..run_files import WrittenRun
from .case_reference import CaseReference
from .face_nodes import FaceNodes


@dataclass(frozen=True)
class Start:
    """Start of a load step.

    Attributes:
        time: Its time.
        run: The step before; None before the first: a body without displacement.
        began: Time at which the step before began.
    """

    time: float
    run: WrittenRun | None
    began: float = 0.0

    def slip_rate(self, run: WrittenRun) -> FloatArray:
        """Slip of the step before over its duration at the nodes of this step's contact face, m/s, shape (q,).

        Raises:
            ValueError: If it has another mesh.
        """
        if self.run is None:
            return np.zeros(len(run.node))
        rate = np.linalg.norm(self.run.on_face["slip"], axis=1) / max(self.time - self.began, 1e-300)
        here: FloatArray = rate[run.on_faces_of(self.run)]
        return here

    def accumulated(self, run: WrittenRun) -> FloatArray:
        """Accumulated slip, friction work and largest pressure before, at the nodes of this step's contact face, shape
        (q, 3).

        Raises:
            ValueError: If the step before has another mesh.
        """
        if self.run is None:
            return np.zeros((len(run.node), len(ACCUMULATED)))
        return written_accumulated(self.run)[run.on_faces_of(self.run)]

    def given_gap(self, run: WrittenRun, nodes: FaceNodes, case: CaseReference | None) -> FloatArray:
        """The gaps given with the contacts at the start of the step, by the case or as the step before wrote them, at
        nodes of this step, metres, shape (m,).

        Raises:
            ValueError: If the step before has another mesh.
        """
        given: FloatArray = np.zeros(len(nodes.index))
        x = run.on_face["x"]
        if self.run is not None:
            given = self.run.on_face["given_gap"][run.on_faces_of(self.run)][nodes.index]
        for part in range(len(case.contacts) if case is not None else 0):
            if case is not None and not case.lacks_gap(part):
                here, field = nodes.only(nodes.part == part), np.zeros(len(x))
                if np.any(here.paired):
                    given[nodes.part == part] = case.given_gap(part, self.time, here.average(x))
                    continue
                near = np.unique(here.weights.indices)
                field[near] = case.given_gap(part, self.time, x[near])
                given[nodes.part == part] = here.average(field)
        return given

    def at(self, run: WrittenRun, name: str = "displacement") -> FloatArray:
        """Vectors of the step before at the nodes of this step's body, shape (k, 3).

        Raises:
            ValueError: If it has another mesh.
        """
        if self.run is None:
            return np.zeros_like(run.body.x)
        values = self.run.on_body[name]
        return values if run.body.has_meshes_of(self.run.body) else values[run.in_bodies_of(self.run)]


def written_accumulated(run: WrittenRun) -> FloatArray:
    """The written fields `ACCUMULATED`, shape (q, 3)."""
    return np.column_stack([run.on_face[name] for name in ACCUMULATED])
