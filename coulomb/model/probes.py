"""Displacement, slip and pressure at named points of a body."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..fem.displacement_space import DisplacementSpace
from ..fem.located_points import LocatedPoints, locate
from .nodal_answer import NodalAnswer


@dataclass(frozen=True)
class Probe:
    """A named point at which displacement, slip and pressure are reported.

    Attributes:
        name: Its name, as in the columns of history.csv: "probe_NAME_displacement_x".
        point: Its place in the undeformed body in metres, shape (3,).

    Raises:
        ValueError: If the name is empty or has control characters, or the point has not three finite numbers.
    """

    name: str
    point: Sequence[float]

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name or not self.name.isprintable():
            raise ValueError(f"probe: the name must be a printable word, but is {self.name!r}")
        try:
            point = np.asarray(self.point, dtype=np.float64)
        except (TypeError, ValueError):
            point = np.empty(0)
        if point.shape != (3,) or not np.all(np.isfinite(point)):
            raise ValueError(f"{self.what}: the point must be three finite numbers in metres, but is {self.point!r}")

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"probe {self.name!r}"


@dataclass(frozen=True)
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
    """

    name: str
    point: FloatArray
    found_at: FloatArray
    face: str | None
    displacement: FloatArray
    slip: FloatArray | None
    pressure: float | None

    def entry(self) -> dict[str, Any]:
        """As in summary.json."""
        return {
            "name": self.name,
            "point": self.point.tolist(),
            "found_at": self.found_at.tolist(),
            "face": self.face,
            "displacement": self.displacement.tolist(),
            "slip": None if self.slip is None else self.slip.tolist(),
            "pressure": self.pressure,
        }


class LocatedProbes:
    """Probes found in the mesh of a body; collective.

    Args:
        probes: The probes.
        body: The body.
        faces: This rank's facets of each contact face.

    Raises:
        ValueError: On every rank, if two probes have the same name, or a point is outside the body.
    """

    def __init__(self, probes: Sequence[Probe], body: DisplacementSpace, faces: Sequence[npt.NDArray[np.int32]]):
        twice = [name for name, count in Counter(probe.name for probe in probes).items() if count > 1]
        if twice:
            raise ValueError(f"probe: the name {twice[0]!r} is given to several probes; give each its own")
        self.probes, self._body = tuple(probes), body
        points: FloatArray = np.array([probe.point for probe in probes], dtype=np.float64).reshape(-1, 3)
        self._points: FloatArray = points
        self._located: LocatedPoints | None = None
        if self.probes:
            self._located = locate(points, [probe.what for probe in probes], body, faces)

    def values(self, u: FloatArray, answer: NodalAnswer, nodes: npt.NDArray[np.integer[Any]]) -> tuple[ProbeValue, ...]:
        """What is at the probes; collective, the same on every rank.

        Slip and pressure are those of contact.xdmf, interpolated: 0 at nodes of the face that are no contact nodes.

        Args:
            u: Displacement of this rank's nodes in metres, shape (k, 3).
            answer: The answer at its contact nodes.
            nodes: Their numbers among its nodes, shape (m,).
        """
        located, body, comm = self._located, self._body, answer.comm
        if located is None:
            return ()
        slip, pressure = np.zeros((2, *u.shape))
        slip[nodes] = answer.slip
        pressure[nodes, 0] = answer.force[:, 0] / answer.area
        if not body.positive:  # contact points are vertices, between which these are linear
            slip, pressure = body.linear_between_vertices(slip), body.linear_between_vertices(pressure)
        moved, slid, pressed = (
            by.of(body.function(values).x.array.reshape(-1, 3), comm)
            for by, values in ((located.body, u), (located.surface, slip), (located.surface, pressure))
        )
        return tuple(
            ProbeValue(
                name=probe.name,
                point=self._points[k],
                found_at=located.x[k],
                face=answer.faces[face] if face >= 0 else None,
                displacement=moved[k],
                slip=slid[k] if face >= 0 else None,
                pressure=float(pressed[k, 0]) if face >= 0 else None,
            )
            for k, (probe, face) in enumerate(zip(self.probes, located.faces, strict=True))
        )
