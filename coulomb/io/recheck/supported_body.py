"""Loads and reactions in the files of a run, recomputed with the loads and supports of its case."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ...fem.bodies import LoadedBody, NodalForces
from ...fem.meshes import SEPARATOR
from ...linalg.reductions import Reductions
from ...model.resultants import Acting, acting
from ..matched_points import places
from ..run_files import WrittenRun


class SupportedBody:
    """The bodies of a case, to which the forces in the files of a run are given.

    Args:
        bodies: The bodies by name; their nodes may be in another order than those of the run.
        time: Time of the loads.
        run: The files, with the same nodes.
    """

    def __init__(self, bodies: Mapping[str, LoadedBody], time: float, run: WrittenRun):
        self._x, self._slices = run.body.x, run.body.slices
        self._bodies = [
            _Supported(member, places(body.x, part.body.x), part.nodes, len(run.body.x))
            for member, body, part in zip(_members(bodies), bodies.values(), run.body.parts, strict=True)
        ]
        self._loads = [load for one in self._bodies for load in one.everywhere(one.member.body.loads_at(time))]

    def acting(
        self, u: FloatArray, held: FloatArray, on_body: FloatArray, taken: Callable[[FloatArray], FloatArray]
    ) -> Acting:
        """Resultants and balance (`recomputed.Supported`)."""

        def perturbed(parts: Iterable[NodalForces]) -> Iterator[NodalForces]:
            for part in parts:
                yield NodalForces(part.kind, part.face, taken(part.forces))

        shares = chain.from_iterable(one.shares(held) for one in self._bodies)
        supports = chain(shares, chain.from_iterable(one.spring_forces(u) for one in self._bodies))
        over = Reductions(MPI.COMM_SELF)
        return acting(perturbed(self._loads), perturbed(supports), on_body, taken(self._x), over, (), self._slices)


class _Member(NamedTuple):
    """A body of a case with its name; "" if it is the only one."""

    name: str
    body: LoadedBody


def _members(bodies: Mapping[str, LoadedBody]) -> list[_Member]:
    return [_Member(name, body) for name, body in bodies.items()]


class _Supported(NamedTuple):
    """A body of a case, and where its nodes are in the files: numbers in its own order, and the run's `nodes` of it."""

    member: _Member
    of_run: npt.NDArray[np.int64]
    nodes: slice
    total: int

    def shares(self, held: FloatArray) -> Iterator[NodalForces]:
        """Forces of every support at the nodes of the run."""
        yield from self.everywhere(self.member.body.shares(self._of_body(held)))

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        """Forces of every spring at the nodes of the run."""
        yield from self.everywhere(self.member.body.spring_forces(self._of_body(u)))

    def _of_body(self, values: FloatArray) -> FloatArray:
        """Values at the nodes of the run, those of the body in its own order."""
        return values[self.nodes][np.argsort(self.of_run)]

    def everywhere(self, parts: Iterable[NodalForces]) -> Iterator[NodalForces]:
        """Forces at the nodes of the body as forces at those of the run, with the name of the body."""
        name = self.member.name
        for part in parts:
            forces = np.zeros((self.total, 3))
            forces[self.nodes] = part.forces[self.of_run]
            face = part.face if not name else name if part.face is None else f"{name}{SEPARATOR}{part.face}"
            yield NodalForces(part.kind, face, forces)
