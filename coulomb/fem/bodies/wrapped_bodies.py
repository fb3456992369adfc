"""Bodies with something added, such as ties: what it does not change is theirs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from .constraints import Numbering
from .deformable import Deformable, Loading, Member
from .loads import NodalForces


class WrappedBodies(Deformable):
    """Bodies with something added; nodes, faces, loads and supports are those of `bodies`."""

    def __init__(self, bodies: Deformable):
        self.bodies = bodies
        self.x, self.held, self.materials, self.loads = bodies.x, bodies.held, bodies.materials, bodies.loads
        self.contradictions = bodies.contradictions

    @cached_property
    def _held_diagonal(self) -> FloatArray:
        return np.concatenate([member.body.held_diagonal for member in self.members])

    @property
    def component(self) -> npt.NDArray[np.int64]:
        return self.bodies.free.component

    @property
    def numbering(self) -> Numbering:
        return self.bodies.numbering

    @property
    def members(self) -> tuple[Member, ...]:
        return self.bodies.members

    def face(self, name: str, what: str) -> tuple[Member, npt.NDArray[np.int32]]:
        return self.bodies.face(name, what)

    def numbers_of(self, member: Member, numbers: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        return self.bodies.numbers_of(member, numbers)

    def internal_force(self, u: FloatArray) -> FloatArray:
        return self.bodies.internal_force(u)

    def outdated(self, loading: Loading) -> bool:
        return self.bodies.outdated(loading.untied or loading)

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        return self.bodies.loads_in(loading.untied or loading)

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        return self.bodies.shares(reaction)

    def blocked_displacement(self, loading: Loading) -> float:
        return self.bodies.blocked_displacement(loading.untied or loading)

    def forms(self) -> Mapping[str, Any] | None:
        return self.bodies.forms()
