"""Loads and reactions in the files of a run, recomputed with the loads and supports of its case."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray
from ...fem.loaded_body import LoadedBody
from ...fem.nodal_forces import NodalForces
from ...linalg.reductions import Reductions
from ...model.resultants import Acting, acting
from ..run_files import WrittenRun, places


class SupportedBody:
    """The body of a case, to which the forces in the files of a run are given.

    Args:
        body: The body; its nodes may be in another order than those of the run.
        time: Time of the loads.
        run: The files, with the same nodes.
    """

    def __init__(self, body: LoadedBody, time: float, run: WrittenRun):
        self._body, self._x = body, run.body.x
        self._of_run = places(body.x, run.body.x)
        self._of_body = np.argsort(self._of_run)
        self._loads = [self._at_nodes_of_run(load) for load in body.loads_at(time)]

    def acting(
        self, u: FloatArray, held: FloatArray, on_body: FloatArray, taken: Callable[[FloatArray], FloatArray]
    ) -> Acting:
        """Resultants and balance (`recomputed.Supported`)."""

        def perturbed(parts: list[NodalForces]) -> Iterator[NodalForces]:
            for part in parts:
                yield NodalForces(part.kind, part.face, taken(part.forces))

        supports = chain(self._body.shares(held[self._of_body]), self._body.spring_forces(u[self._of_body]))
        reactions = [self._at_nodes_of_run(support) for support in supports]
        over = Reductions(MPI.COMM_SELF)
        return acting(perturbed(self._loads), perturbed(reactions), on_body, taken(self._x), over)

    def _at_nodes_of_run(self, part: NodalForces) -> NodalForces:
        return NodalForces(part.kind, part.face, part.forces[self._of_run])
