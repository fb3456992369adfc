"""Probes in the files of a run, recomputed from the written fields."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...model.nodal_answer import NodalAnswer
from ...model.probes import LocatedProbes, Part, Probe
from ..run_directory import OLD
from ..run_files import WrittenRun
from ..written_faces import WrittenFace
from .case_reference import CaseReference


class WrittenProbes:
    """The probes of a run, found in the mesh of its files.

    Args:
        run: The files.
        case: The case, if there is one: then the probes are its, else those of summary.json.
        grids: Of every contact face its grid and its facets.

    Raises:
        ValueError: If summary.json has no probes, or a point is outside the mesh.
    """

    def __init__(
        self,
        run: WrittenRun,
        case: CaseReference | None,
        grids: Sequence[tuple[WrittenFace, npt.NDArray[np.int32]]],
    ):
        probes = _of_summary(run) if case is None else [table.probe() for table in case.settings.probe]
        parts = [Part(part.name, part.body, part.nodes) for part in run.body.parts]
        self._located = LocatedProbes(probes, parts, [(face.part.name, facets) for face, facets in grids])

    def values(
        self,
        u: FloatArray,
        answer: NodalAnswer,
        nodes: npt.NDArray[np.int64],
        taken: Callable[..., FloatArray],
    ) -> list[dict[str, Any]]:
        """Their entries in summary.json (`recomputed.Probing`).  The weights by which nodal values are interpolated
        are rounded: where a value nearly vanishes, those around decide how accurate it is."""
        pressed = answer.force[:, 0] / answer.area
        largest = [float(np.max(np.abs(values), initial=0.0)) for values in (u, answer.slip, pressed)]
        entries = []
        for value in self._located.values(u, answer, nodes):
            moved = taken(value.displacement, largest[0])
            slip = None if value.slip is None else taken(value.slip, largest[1])
            pressure = None if value.pressure is None else float(taken(np.array(value.pressure), largest[2]))
            rounded = replace(value, found_at=taken(value.found_at), displacement=moved, slip=slip, pressure=pressure)
            entries.append(rounded.entry())
        return entries


def _of_summary(run: WrittenRun) -> Sequence[Probe]:
    try:
        return [Probe(given["name"], given["point"], given.get("body")) for given in run.summary.get("probes", [])]
    except (KeyError, TypeError):
        raise ValueError(f"{run.files.summary}: probes: {OLD}") from None
