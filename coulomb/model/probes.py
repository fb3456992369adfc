"""Displacement, slip and pressure at named points of a body."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray, Int32Array, real_numbers, short
from ..fem.bodies import LocatedPoints, Member, locate
from .nodal_answer import NodalAnswer


@dataclass(frozen=True)
class Probe:
    """A named point at which displacement, slip and pressure are reported.

    Attributes:
        name: Its name, as in the columns of history.csv: "probe_NAME_displacement_x".
        point: Its place in the undeformed body in metres, shape (3,).
        body: The body that it is in, needed where several touch; by default the one that has the point.

    Raises:
        ValueError: If the name is empty or has control characters, or the point has not three finite numbers.
    """

    name: str
    point: Sequence[float]
    body: str | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name or not self.name.isprintable():
            raise ValueError(f"probe: the name must be a printable word, but is {self.name!r}")
        try:
            point = real_numbers(self.point)
        except (TypeError, ValueError):
            point = np.empty(0)
        if point.shape != (3,) or not np.all(np.isfinite(point)):
            raise ValueError(
                f"{self.what}: the point must be three finite numbers in metres, but is {short(self.point)}"
            )
        if self.body is not None and not isinstance(self.body, str):
            raise ValueError(f"{self.what}: body must be the name of a body, but is {self.body!r}")

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"probe {self.name!r}"


@dataclass(frozen=True, eq=False)
class ProbeValue:
    """Values at a probe.

    Attributes:
        name: Its name.
        point: The point as given, metres, shape (3,).
        found_at: The point of the mesh: the same, or for a point outside by a small part of a cell the nearest one.
        face: The contact face that it is on; None for none.
        displacement: In metres, shape (3,).
        slip: On a contact face in metres, a vector in the tangent plane, shape (3,), of a load step since the step
            before; else None.
        pressure: On a contact face in pascals, else None.
        body: The body that it is in; "" if there is only one.
    """

    name: str
    point: FloatArray
    found_at: FloatArray
    face: str | None
    displacement: FloatArray
    slip: FloatArray | None
    pressure: float | None
    body: str = ""

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        return {
            "name": self.name,
            **({"body": self.body} if self.body else {}),
            "point": self.point.tolist(),
            "found_at": self.found_at.tolist(),
            "face": self.face,
            "displacement": self.displacement.tolist(),
            "slip": None if self.slip is None else self.slip.tolist(),
            "pressure": self.pressure,
        }


class LocatedProbes:
    """Probes found in the meshes of one body or several; `faces` are name of the body and this rank's facets there, of
    each contact face; collective.

    Raises:
        ValueError: On every rank, if two probes have the same name, a body is not known, or a point is outside, or in
            two bodies.
    """

    def __init__(self, probes: Sequence[Probe], parts: Sequence[Member], faces: Sequence[tuple[str, Int32Array]]):
        twice = [name for name, count in Counter(probe.name for probe in probes).items() if count > 1]
        if twice:
            raise ValueError(f"probe: the name {twice[0]!r} is given to several probes; give each its own")
        self.probes = tuple(probes)
        self._points: FloatArray = np.array([probe.point for probe in probes], dtype=np.float64).reshape(-1, 3)
        parts_with = [self._found(number, parts) for number in range(len(probes))]
        self._in = []
        for k, part in enumerate(parts):
            own = {number: facets for number, (name, facets) in enumerate(faces) if name == part.name}
            inside = {number: self.probes[number] for number, one in enumerate(parts_with) if one == k}
            self._in.append(_Located(part, inside, self._points[list(inside)], own))

    def _found(self, number: int, parts: Sequence[Member]) -> int:
        """The body that has a point; collective."""
        probe, names = self.probes[number], [part.name for part in parts]
        if len(parts) == 1 and probe.body is None:
            return 0
        if probe.body is not None:
            if probe.body not in names:
                known = f"the bodies are {', '.join(names)}" if names != [""] else "there is only one: leave body out"
                raise ValueError(f"{probe.what}: there is no body {probe.body!r}; {known}")
            return names.index(probe.body)
        point, inside, outside = self._points[number : number + 1], [], []
        for k, part in enumerate(parts):
            try:
                locate(point, [f"{probe.what}: body {part.name!r}"], part.body, [])
                inside.append(k)
            except ValueError as error:
                outside.append(str(error))
        if not inside:
            raise ValueError("; ".join(outside))
        if len(inside) > 1:
            both = " and ".join(repr(names[k]) for k in inside)
            raise ValueError(f"{probe.what}: the point is in the bodies {both}: give body, one of them")
        return inside[0]

    def values(
        self,
        u: FloatArray,
        answer: NodalAnswer,
        nodes: npt.NDArray[np.integer[Any]],
        slips: FloatArray | None = None,
    ) -> tuple[ProbeValue, ...]:
        """What is at the probes, by the displacement u (k, 3) and the answer at the contact nodes with these numbers,
        by default with its slip (m, 3); collective, the same on every rank.

        Slip and pressure are those of contact.xdmf, interpolated: 0 at nodes of the face that are no contact nodes.  In
        pairs they are at the face with the contact points; of a node in several contacts those of the one that presses
        most.
        """
        if not self.probes:
            return ()
        slip, pressure = np.zeros((2, *u.shape))
        order = np.argsort(answer.force[:, 0], kind="stable")  # of a node in several contacts that which presses most
        slip[nodes[order]] = (answer.slip if slips is None else slips)[order]
        pressure[nodes[order], 0] = (answer.force[:, 0] / answer.area)[order]
        value_of = {number: value for part in self._in for number, value in part.values(u, slip, pressure, answer)}
        return tuple(value_of[number] for number in range(len(self.probes)))


class _Located:
    """The probes in one body, and the facets of contact faces on it, by their numbers; collective."""

    def __init__(self, part: Member, probes: dict[int, Probe], points: FloatArray, faces: dict[int, Int32Array]):
        self._part, self._probes, self._points, self._faces = part, probes, points, list(faces)
        self._located: LocatedPoints | None = None
        if probes:
            self._located = locate(points, [probe.what for probe in probes.values()], part.body, list(faces.values()))

    def values(
        self, u: FloatArray, slip: FloatArray, pressure: FloatArray, answer: NodalAnswer
    ) -> list[tuple[int, ProbeValue]]:
        """Number and values of each, from displacement, slip and pressure at the nodes of all bodies; collective."""
        located, body, nodes, comm = self._located, self._part.body, self._part.nodes, answer.comm
        if located is None:
            return []
        slip, pressure = slip[nodes], pressure[nodes]
        if not body.positive:  # contact points are vertices, between which these are linear
            slip, pressure = body.linear_between_vertices(slip), body.linear_between_vertices(pressure)
        moved, slid, pressed = (
            by.of(body.function(values).x.array.reshape(-1, 3), comm)
            for by, values in ((located.body, u[nodes]), (located.surface, slip), (located.surface, pressure))
        )
        values = []
        for k, (number, face) in enumerate(zip(self._probes, located.faces, strict=True)):
            value = ProbeValue(
                name=self._probes[number].name,
                point=self._points[k],
                found_at=located.x[k],
                face=answer.faces[self._faces[face]] if face >= 0 else None,
                displacement=moved[k],
                slip=slid[k] if face >= 0 else None,
                pressure=float(pressed[k, 0]) if face >= 0 else None,
                body=self._part.name,
            )
            values.append((number, value))
        return values
