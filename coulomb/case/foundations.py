"""The rigid surface of a case: that of a foundation, or one for which facets stand."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from ..fem.geometry import Cylinder, Plane, RigidFoundation, SignedDistance, Sphere
from .values import FileName, Length, Table, Vector


class FoundationTable(Table):
    """A rigid plane (point, normal towards the body), sphere (centre, radius) or cylinder (point, axis, radius), or the
    solid of an STL file (file, scale).

    Lengths in metres; `hollow` for a body inside a spherical cup or a bore.
    """

    shape: Literal["plane", "sphere", "cylinder", "stl"] = "plane"
    point: Vector | None = None
    normal: Vector | None = None
    centre: Vector | None = None
    axis: Vector | None = None
    radius: Length | None = None
    hollow: bool = False
    file: FileName | None = None
    scale: Length | None = None

    @model_validator(mode="after")
    def _complete(self) -> FoundationTable:
        needed = {"plane": {"point", "normal"}, "sphere": {"centre", "radius"}, "cylinder": {"point", "axis", "radius"}}
        wanted = {**needed, "stl": {"file"}}[self.shape]
        keys = ("point", "normal", "centre", "axis", "radius", "file", "scale")
        given = {name for name in keys if getattr(self, name) is not None}
        given |= {"hollow"} if self.hollow else set()
        may = {"plane": set[str](), "stl": {"scale"}}.get(self.shape, {"hollow"})
        missing, odd = wanted - given, given - wanted - may
        for names, fault in ((missing, "needs"), (odd, "has no")):
            if names:
                raise ValueError(f'a foundation of shape "{self.shape}" {fault} {", ".join(sorted(names))}')
        self.foundation()  # for its own errors
        return self

    def foundation(self) -> RigidFoundation:
        if self.shape == "sphere":
            assert self.centre is not None and self.radius is not None
            return Sphere(self.centre, self.radius, self.hollow)
        if self.shape == "stl":
            assert self.file is not None
            return SignedDistance.of_stl(self.file, self.scale or 1.0)
        assert self.point is not None
        if self.shape == "cylinder":
            assert self.axis is not None and self.radius is not None
            return Cylinder(self.point, self.axis, self.radius, self.hollow)
        assert self.normal is not None
        return Plane(self.point, self.normal)


def surface_of(table: FoundationTable | None) -> RigidFoundation | None:
    return None if table is None else table.foundation()
