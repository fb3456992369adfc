"""The tables of a case file about supports (held, moved or rotated faces, planes of symmetry, springs), loads, heat."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

import coulomb

from .curves import AmplitudeTable, amplitude_of, in_radians
from .foundations import FoundationTable, surface_of
from .values import (
    ROWS,
    Direction,
    Name,
    NodesValue,
    Number,
    SpatialNumber,
    SpatialVector,
    Stiffness,
    Table,
    Vector,
    called_nodes,
    coefficient,
    field,
)

if TYPE_CHECKING:
    from ..fem.bodies import NodalForce, VolumeForce
    from ..fem.meshes import JoinedMesh


Components = Literal["x", "y", "z", "xy", "xz", "yz", "xyz", "normal", "tangential"]


class PlacedTable(Table):
    """What acts on a face; or on nodes, on edges or at points: those of a set of the mesh file by its name, or of some
    by their numbers there (in several bodies "body:12"), or those at places in metres.

    `face` is then what they are called.
    """

    face: Name
    nodes: NodesValue | None = None

    @model_validator(mode="before")
    @classmethod
    def _called(cls, given: object) -> object:
        if not isinstance(given, dict) or not given.get("nodes"):
            return given
        called = called_nodes(given["nodes"])
        if given.get("face", called) != called:
            raise ValueError("give face or nodes, one of the two")
        return {**given, "face": called}


class LastingTable(Table):
    """When a support acts, in seconds: from `begin`, where it takes nodes as they are, to `end`; load steps end there.

    At `reaches` the displacement is the given one; without it, what is given changes it from where it was at `begin`.
    """

    begin: Number | None = None
    end: Number | None = None
    reaches: Number | None = None

    @property
    def lasting(self) -> dict[str, Any]:
        """As arguments of what it is in the problem."""
        return {"begin": self.begin, "end": self.end, "reaches": self.reaches}

    @model_validator(mode="after")
    def _in_order(self) -> LastingTable:
        if self.reaches is not None and (self.begin is None or self.reaches < self.begin):
            raise ValueError("reaches goes with a begin that is not after it")
        if self.end is not None and self.end <= (self.begin or 0.0):
            raise ValueError(f"end must be after begin = {self.begin or 0.0:g}")
        return self


class PrescribedDisplacementTable(PlacedTable, LastingTable):
    """Prescribed displacement in metres on a face, or at nodes."""

    value: SpatialVector
    components: Components = "xyz"
    direction: SpatialVector | None = None
    surface: FoundationTable | None = None
    amplitude: AmplitudeTable | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> PrescribedDisplacementTable:
        if self.direction is not None and "components" in self.model_fields_set:
            raise ValueError("give components or direction, one of the two")
        if self.direction is not None and not any(self.direction):
            raise ValueError("direction must not be zero")
        if self.surface is not None and self.components not in ("normal", "tangential"):
            raise ValueError('surface goes with components = "normal" or "tangential"')
        return self

    def support(self) -> coulomb.PrescribedDisplacement:
        return coulomb.PrescribedDisplacement(
            self.face,
            field(self.value),
            self.components,
            amplitude_of(self.amplitude),
            None if self.direction is None else field(self.direction),
            surface_of(self.surface),
            **self.lasting,
        )


class ClampTable(PrescribedDisplacementTable):
    """Zero displacement of a face, or of nodes.  With a value it is a [[prescribed_displacement]]."""

    value: SpatialVector = (0.0, 0.0, 0.0)

    def support(self) -> coulomb.PrescribedDisplacement:
        if any(self.value) or self.amplitude:
            return super().support()
        direction = None if self.direction is None else field(self.direction)
        return coulomb.Clamp(
            self.face,
            self.components,
            direction,
            surface_of(self.surface),
            **self.lasting,
        )


class PrescribedRotationTable(Table):
    """Prescribed rotation of a face: a point of the axis in metres, its direction, and the angle in radians, or
    degrees."""

    face: Name
    point: Vector
    axis: Direction
    angle: Number
    axial: Literal["held", "free"] = "held"
    amplitude: AmplitudeTable | None = None

    _in_radians = model_validator(mode="before")(in_radians)

    def support(self) -> coulomb.PrescribedRotation:
        return coulomb.PrescribedRotation(
            self.face, self.point, self.axis, self.angle, amplitude_of(self.amplitude), self.axial
        )


class SymmetryTable(LastingTable):
    """A plane of symmetry in which a face lies."""

    face: Name

    def support(self) -> coulomb.SymmetryPlane:
        return coulomb.SymmetryPlane(self.face, **self.lasting)


SupportTable = PrescribedDisplacementTable | PrescribedRotationTable | SymmetryTable


def _along_axes(stiffness: Any) -> Any:
    return [stiffness] * 3 if isinstance(stiffness, int | float) and not isinstance(stiffness, bool) else stiffness


class SpringTable(PlacedTable):
    """Elastic support of a face, stiffness in N/m^3: one number, or three along x, y, z; or at nodes, in N/m."""

    stiffness: Annotated[tuple[Stiffness, Stiffness, Stiffness], BeforeValidator(_along_axes)]

    def spring(self) -> coulomb.Spring:
        return coulomb.Spring(self.face, self.stiffness, at_nodes=self.nodes is not None)


class TractionTable(Table):
    """Surface load in pascals on a face."""

    face: Name
    value: SpatialVector
    amplitude: AmplitudeTable | None = None

    def load(self) -> coulomb.Traction:
        return coulomb.Traction(self.face, field(self.value), amplitude_of(self.amplitude))


class PressureTable(Table):
    """Pressure in pascals normal to a face, positive where it presses on the body."""

    face: Name
    value: SpatialNumber
    amplitude: AmplitudeTable | None = None

    def load(self) -> coulomb.Pressure:
        return coulomb.Pressure(self.face, coefficient(self.value), amplitude_of(self.amplitude))


class TotalForceTable(Table):
    """Force in newtons, spread uniformly over the area of a face."""

    face: Name
    force: Vector
    amplitude: AmplitudeTable | None = None

    def load(self) -> coulomb.TotalForce:
        return coulomb.TotalForce(self.face, self.force, amplitude_of(self.amplitude))


class PointLoadTable(Table):
    """Force in newtons and moment in newton metres at a reference point, spread over a face."""

    face: Name
    force: Vector = (0.0, 0.0, 0.0)
    moment: Vector = (0.0, 0.0, 0.0)
    point: Vector | None = None
    amplitude: AmplitudeTable | None = None

    def load(self) -> coulomb.PointLoad:
        return coulomb.PointLoad(self.face, self.force, self.moment, self.point, amplitude_of(self.amplitude))


ONE_FORCE, FORCES = "one force", "forces"


def _count(given: Any) -> str:
    several = isinstance(given, list | tuple) and any(isinstance(one, list | tuple) for one in given)
    return FORCES if several else ONE_FORCE


ForcesValue = Annotated[
    Annotated[Vector, Tag(ONE_FORCE)]
    | Annotated[tuple[Vector, ...], Field(min_length=1, max_length=ROWS), Tag(FORCES)],
    Discriminator(_count),
]


class NodalForceTable(PlacedTable):
    """Force in newtons at every one of some nodes, or one for each of their numbers."""

    force: ForcesValue
    amplitude: AmplitudeTable | None = None

    @model_validator(mode="after")
    def _one_for_each(self) -> NodalForceTable:
        nodes = self.nodes if isinstance(self.nodes, tuple) and not isinstance(self.nodes[0], tuple) else ()
        if isinstance(self.force[0], tuple) and len(self.force) != len(nodes):
            raise ValueError(f"there are {len(self.force)} forces for {len(nodes)} numbers of nodes: give one for each")
        if isinstance(self.force[0], tuple) and len(set(nodes)) < len(nodes):
            raise ValueError("a node is given twice: give each once, with the sum of its forces")
        return self

    def load(self) -> NodalForce:
        from ..fem.bodies import NodalForce

        numbers = _numbers_of(self.nodes or ()) if isinstance(self.force[0], tuple) else None
        return NodalForce(self.face, self.force, amplitude_of(self.amplitude), numbers)


class VolumeForceTable(Table):
    """Force per volume in N/m^3 in the cells of a group."""

    cells: Name
    value: SpatialVector
    amplitude: AmplitudeTable | None = None

    @property
    def face(self) -> str:
        return self.cells

    def load(self) -> VolumeForce:
        from ..fem.bodies import VolumeForce

        return VolumeForce(self.cells, field(self.value), amplitude_of(self.amplitude))


LoadTable = TractionTable | PressureTable | TotalForceTable | PointLoadTable | NodalForceTable | VolumeForceTable


def with_nodes(mesh: coulomb.NamedMesh | JoinedMesh, tables: Iterable[PlacedTable]) -> coulomb.NamedMesh | JoinedMesh:
    """The mesh with the sets of nodes that tables give by numbers or places; collective.

    Raises:
        ValueError: On every rank, if there is no such node.
    """
    from ..fem.meshes import SEPARATOR, JoinedMesh

    for table in tables:
        if table.nodes is None or isinstance(table.nodes, str):
            continue
        body, _, name = table.face.rpartition(SEPARATOR)
        one = mesh if isinstance(mesh, coulomb.NamedMesh) else mesh.body(body, f"nodes {list(table.nodes)[:5]}")
        if isinstance(table.nodes[0], tuple):
            one = one.with_nodes(name, at=table.nodes)
        else:
            one = one.with_nodes(name, numbers=_numbers_of(table.nodes))
        mesh = one if isinstance(mesh, coulomb.NamedMesh) else JoinedMesh({**mesh.bodies, body: one})
    return mesh


def _numbers_of(nodes: Iterable[object]) -> tuple[int, ...]:
    """Their numbers in the mesh file, without their body."""
    return tuple(int(str(node).rpartition(":")[2]) for node in nodes)


class HeatTable(Table):
    """What heats or cools a face, or heat in the volume: one of temperature, flux in W/m^2, film in W/(m^2 K) with the
    ambient temperature, and source in W/m^3."""

    face: Name | None = None
    temperature: SpatialNumber | None = None
    flux: SpatialNumber | None = None
    film: Stiffness | None = None
    ambient: SpatialNumber | None = None
    source: SpatialNumber | None = None
    body: Name | None = None
    amplitude: AmplitudeTable | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> HeatTable:
        try:
            self.load()
        except ValueError as error:
            raise ValueError(str(error).removeprefix("heat: ")) from None
        return self

    def load(self) -> coulomb.HeatLoad:
        temperature, flux, ambient, source = (
            None if value is None else coefficient(value)
            for value in (self.temperature, self.flux, self.ambient, self.source)
        )
        return coulomb.HeatLoad(
            self.face, temperature, flux, self.film, ambient, source, self.body, amplitude_of(self.amplitude)
        )


def refuse_unfit_heat(
    heat: Sequence[HeatTable], reference: float | None, thermal: Sequence[str], unfit: Sequence[str]
) -> None:
    """ValueError if heat has no reference temperature, or is beside what is `unfit`; or if without heat there is such a
    temperature, or contacts of these keys have `thermal`."""
    if not heat:
        given = [*(f"{key}.thermal" for key in thermal), *(["reference_temperature"] if reference is not None else [])]
        if given:
            raise ValueError(f"{given[0]}: there is no heat: give [[heat]] tables")
        return
    if unfit:
        why = "the temperature follows from heat" if unfit[0] == "temperature" else "not yet"
        raise ValueError(f"heat: not with {unfit[0]}: {why}")
    if reference is None:
        raise ValueError("heat: give reference_temperature, that of the unstrained bodies")
