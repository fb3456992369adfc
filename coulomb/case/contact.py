"""The tables of a case file that describe contact and foundations."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

import coulomb

from ..arrays import FloatArray
from ..io.run_directory import as_toml
from .curves import AmplitudeTable, MotionTable, amplitude_of, in_radians, motion_of, rows_of
from .foundations import FoundationTable, surface_of
from .values import (
    ISOTROPIC,
    ORTHOTROPIC,
    TABLES,
    AlongAxes,
    Closed,
    Direction,
    Friction,
    Length,
    Name,
    Number,
    SpatialFriction,
    SpatialGap,
    SpatialSpeed,
    SpatialStress,
    SpatialVector,
    Stiffness,
    Stress,
    Table,
    Vector,
    Young,
    coefficient,
    field,
)

if TYPE_CHECKING:
    from ..fem.contact import FoundPair, FoundPairs
    from ..fem.geometry import Coefficient
    from ..fem.meshes import JoinedMesh


LAW_KEYS = ("friction", "slip_stress", "cohesion", "friction_limit")
"""What describes the law of friction of a face or a region."""


def _one_number(given: Any) -> Any:
    if isinstance(given, list | tuple):
        raise ValueError("should be one number: friction by slip rate is the same in all directions")
    return given


def _two_numbers(given: Any) -> Any:
    if isinstance(given, list | tuple) and any(isinstance(value, dict) for value in given):
        raise ValueError("should be two numbers: friction by slip rate is the same in all directions")
    return given


def _by_axes(given: Any) -> Any:
    """Three numbers as components along x, y and z."""
    return dict(zip("xyz", given, strict=True)) if isinstance(given, list | tuple) and len(given) == 3 else given


class SlipRateTable(Table):
    """Friction by the slip rate v of the load step before, in m/s: kinetic + (static - kinetic) exp(-v/decay_speed)."""

    static: Annotated[SpatialFriction, BeforeValidator(_one_number)]
    kinetic: Annotated[SpatialFriction, BeforeValidator(_one_number)]
    decay_speed: Annotated[SpatialSpeed, BeforeValidator(_one_number)]


class PressureTable(Table):
    """Friction by the contact pressure in pascals, linear between the points given and constant outside."""

    pressure: Annotated[tuple[Stress, ...], Field(min_length=1, max_length=TABLES)]
    coefficient: tuple[Friction, ...]

    @model_validator(mode="after")
    def _points(self) -> PressureTable:
        self.friction()  # for its own errors
        return self

    def friction(self) -> coulomb.PressureFriction:
        return coulomb.PressureFriction(self.pressure, self.coefficient)


BY_SLIP_RATE, BY_PRESSURE = "by slip rate", "by pressure"


def _kind(given: Any) -> str:
    if isinstance(given, PressureTable) or (isinstance(given, dict) and "pressure" in given):
        return BY_PRESSURE
    if isinstance(given, dict | SlipRateTable):
        return BY_SLIP_RATE
    return ORTHOTROPIC if isinstance(given, list | tuple) else ISOTROPIC


FrictionValue = Annotated[
    Annotated[SpatialFriction, Tag(ISOTROPIC)]
    | Annotated[tuple[SpatialFriction, SpatialFriction], BeforeValidator(_two_numbers), Tag(ORTHOTROPIC)]
    | Annotated[SlipRateTable, Tag(BY_SLIP_RATE)]
    | Annotated[PressureTable, Tag(BY_PRESSURE)],
    Discriminator(_kind),
]
"""One coefficient, or two: along a direction and across it; or by slip rate, or by pressure."""


class RegionTable(Table):
    """A part of the contact face, inside a box given by two corners in metres, with friction of its own."""

    box: tuple[Vector, Vector]
    friction: FrictionValue | None = None
    slip_stress: SpatialStress | None = None
    cohesion: SpatialStress | None = None
    friction_limit: SpatialStress | None = None

    @model_validator(mode="after")
    def _corners(self) -> RegionTable:
        if any(low > high for low, high in zip(*self.box, strict=True)):
            raise ValueError(f"box must be [lower corner, upper corner], but is {[list(c) for c in self.box]}")
        return self

    def holds(self, x: FloatArray) -> Any:
        """Which of the points x (3, k) lie in it, to 1e-9 of its size; shape (k,)."""
        low, high = np.array(self.box)[:, :, None]
        margin = 1e-9 * float(np.max(high - low))
        return np.all((x >= low - margin) & (x <= high + margin), axis=0)


class RotationTable(Table):
    """Rotation of a foundation: a point of the axis in metres, its direction, and rows [time, angle] in radians, or
    `degrees`."""

    point: Vector
    axis: Direction
    angle: AmplitudeTable

    _in_radians = model_validator(mode="before")(in_radians)

    def rotation(self) -> coulomb.Rotation:
        return coulomb.Rotation(self.point, self.axis, amplitude_of(self.angle))


class ThermalContactTable(Table):
    """Conductance + factor (pressure/hardness)^exponent in W/(m^2 K), temperature of a foundation, and the part of the
    heat of friction that goes into the face."""

    conductance: Stiffness = 0.0
    factor: Stiffness = 0.0
    hardness: Young = 1e9
    exponent: Annotated[float, Field(gt=0.0, le=10.0, strict=True)] = 0.95
    temperature: Number | None = None
    share: Annotated[float, Field(ge=0.0, le=1.0, strict=True)] = 0.5

    def thermal(self) -> coulomb.ThermalContact:
        return coulomb.ThermalContact(
            self.conductance, self.factor, self.hardness, self.exponent, self.temperature, self.share
        )


class ContactTable(Table):
    """The contact face and its law: friction (Coulomb), perhaps with cohesion, or slip_stress (Tresca), in pascals."""

    face: Name
    friction: FrictionValue | None = None
    slip_stress: SpatialStress | None = None
    region: Annotated[tuple[RegionTable, ...], Field(max_length=TABLES)] = ()
    foundation: FoundationTable | None = None
    normals: Literal["foundation", "body"] = "foundation"
    motion: MotionTable | None = None
    cohesion: SpatialStress | None = None
    direction: SpatialVector | None = None
    friction_amplitude: AmplitudeTable | None = None
    rotation: RotationTable | None = None
    gap: SpatialGap = 0.0
    gap_amplitude: AmplitudeTable | None = None
    against: Name | None = None
    adjust: Closed = 0.0
    smooth: bool = False
    surface: FoundationTable | None = None
    against_surface: FoundationTable | None = None
    slave: bool = False
    thermal: ThermalContactTable | None = None
    friction_limit: SpatialStress | None = None
    force: Annotated[AlongAxes, BeforeValidator(_by_axes)] = AlongAxes()
    moment: Annotated[AlongAxes, BeforeValidator(_by_axes)] = AlongAxes()
    force_point: Vector | None = None
    force_amplitude: AmplitudeTable | None = None

    @model_validator(mode="after")
    def _one_thing_to_touch(self) -> ContactTable:
        if self.against is None:
            if np.any(self.adjust):
                raise ValueError("adjust goes with against: it closes gaps between two meshes; for foundations use gap")
            if self.slave:
                raise ValueError("slave goes with against: a face on a foundation has the contact points itself")
            given = {"smooth", "surface", "against_surface"} & self.model_fields_set
            if given:
                raise ValueError(f"{', '.join(sorted(given))} goes with against: it is for gaps between two meshes")
            return self
        of_foundation = {"foundation", "motion", "rotation", "normals", "force", "moment"}
        given = (of_foundation | {"force_point", "force_amplitude"}) & self.model_fields_set
        if given:
            raise ValueError(
                f"{', '.join(sorted(given))} does not go with against: it is for rigid foundations; a body is moved by "
                "its supports"
            )
        return self

    @model_validator(mode="after")
    def _one_load(self) -> ContactTable:
        moments = [component for component in self.moment.components if component is not None]
        if not moments and not any(component is not None for component in self.force.components):
            given = {"force", "moment", "force_point", "force_amplitude"} & self.model_fields_set
            if given:
                raise ValueError(
                    f"{', '.join(sorted(given))}: give components of the force or moment on the foundation, as force = "
                    "{ z = -500.0 }"
                )
        if moments and self.rotation is not None:
            raise ValueError("a foundation has a given rotation, or turns under a moment: give one of the two")
        return self

    @model_validator(mode="after")
    def _one_law(self) -> ContactTable:
        if (self.friction is None) == (self.slip_stress is None):
            raise ValueError("give either friction (Coulomb) or slip_stress (Tresca), one of the two")
        if self.cohesion is not None and self.friction is None:
            raise ValueError("cohesion goes with friction; slip_stress is a cohesion alone")
        if self.friction_limit is not None and self.friction is None:
            raise ValueError("friction_limit goes with friction; slip_stress is a limit itself")
        if any(part.friction_limit == 0.0 for part in self._parts):
            raise ValueError("friction_limit must be a stress > 0; friction = 0 is without friction")
        if self.gap_amplitude is not None and self.gap == 0.0:
            raise ValueError("gap_amplitude is a factor of gap, which is not given")
        frictions = [part.friction for part in self._parts]
        orthotropic = any(isinstance(friction, tuple) for friction in frictions)
        by_pressure = any(isinstance(friction, PressureTable) for friction in frictions)
        if (by_pressure or any(isinstance(friction, SlipRateTable) for friction in frictions)) and (
            orthotropic or self.direction
        ):
            raise ValueError(
                "friction by slip rate or pressure is the same in all directions: give neither a direction nor two "
                "coefficients"
            )
        if by_pressure and any(region.friction is not None for region in self.region):
            raise ValueError(
                "friction by pressure is the same on all of the face: give regions no friction of their own"
            )
        if orthotropic and self.direction is None:
            raise ValueError("two coefficients, friction = [along, across], need a direction")
        if self.direction is not None and not orthotropic:
            raise ValueError("a direction needs two coefficients, friction = [along, across]")
        if self.friction_amplitude is not None:
            if self.friction is None:
                raise ValueError("friction_amplitude goes with friction")
            if any(row[1] < 0.0 for row in rows_of(self.friction_amplitude)):
                raise ValueError("friction_amplitude: factors must be >= 0")
        given = [name for name in LAW_KEYS if getattr(self, name) is not None]
        for number, region in enumerate(self.region):
            named = [name for name in LAW_KEYS if getattr(region, name) is not None]
            if not named or not set(named) <= set(given):
                wanted = " or ".join(given) + (", or both" if len(given) > 1 else "")
                raise ValueError(
                    f"region.{number} must give {wanted}, as the contact does, and nothing else but its box"
                )
        return self

    @property
    def _parts(self) -> tuple[ContactTable | RegionTable, ...]:
        return (self, *self.region)

    @property
    def sloped(self) -> bool:
        """Whether friction grows with pressure anywhere on the face."""
        given = [part.friction for part in self._parts if part.friction is not None]
        return any(isinstance(number, str) or number > 0.0 for f in given for number in _coefficients(f))

    def toml(self) -> str:
        """The table as text of a case file, if it has no tables of its own but friction by slip rate."""
        given = self.model_dump(mode="json", exclude_unset=True)
        return as_toml({"contact": [given]})

    def contact(self) -> coulomb.Contact:
        return coulomb.Contact(
            self.face,
            self._friction(),
            self._coefficient("slip_stress"),
            surface_of(self.foundation),
            self.normals,
            motion_of(self.motion),
            self._coefficient("cohesion"),
            None if self.direction is None else field(self.direction),
            amplitude_of(self.friction_amplitude),
            self.rotation.rotation() if self.rotation is not None else None,
            coefficient(self.gap),
            amplitude_of(self.gap_amplitude),
            self.against,
            self.adjust,
            self.smooth,
            surface_of(self.surface),
            surface_of(self.against_surface),
            slave=self.slave,
            thermal=(self.thermal or ThermalContactTable()).thermal(),
            friction_limit=self._coefficient("friction_limit"),
            force=self.force.components,
            moment=self.moment.components,
            force_point=self.force_point,
            force_amplitude=amplitude_of(self.force_amplitude),
        )

    def _friction(
        self,
    ) -> Coefficient | tuple[Coefficient, Coefficient] | coulomb.SlipRateFriction | coulomb.PressureFriction | None:
        """One coefficient, or two with a direction; by slip rate if the contact or a region has such a table."""
        if isinstance(self.friction, PressureTable):
            return self.friction.friction()
        if self.direction is not None:
            along, across = self._by_parts(_pair)
            return along, across
        if any(isinstance(part.friction, SlipRateTable) for part in self._parts):
            return coulomb.SlipRateFriction(*self._by_parts(_decaying))
        return self._coefficient("friction")

    def _by_parts(self, numbers: Callable[[FrictionValue], tuple[float | str, ...]]) -> list[Coefficient]:
        """Each of the numbers of which friction is made, by region."""
        assert self.friction is not None
        given = [None if region.friction is None else numbers(region.friction) for region in self.region]
        return [
            self._by_region(base, [None if own is None else own[k] for own in given])
            for k, base in enumerate(numbers(self.friction))
        ]

    def _coefficient(self, law: Literal["friction", "slip_stress", "cohesion", "friction_limit"]) -> Coefficient | None:
        """Of this law: nothing, a number, or a function of place by region."""
        base = getattr(self, law)
        return None if base is None else self._by_region(base, [getattr(region, law) for region in self.region])

    def _by_region(self, base: float | str, others: list[float | str | None]) -> Coefficient:
        """A number, or a function of place with those of the regions, if not None; of two regions the last counts."""
        everywhere = coefficient(base)
        if not self.region:
            return everywhere
        inside = [(region, coefficient(o)) for region, o in zip(self.region, others, strict=True) if o is not None]

        def at(value: Coefficient, x: FloatArray) -> FloatArray:
            return value(x) if callable(value) else np.full(x.shape[1], float(value))

        def by_region(x: FloatArray) -> FloatArray:
            number = np.full(x.shape[1], -1)  # of the last region that holds a point
            for k, (region, _) in enumerate(inside):
                number[region.holds(x)] = k
            values = np.zeros(x.shape[1])
            for k, value in enumerate((everywhere, *(value for _, value in inside)), -1):
                values[number == k] = at(value, x[:, number == k])
            return values

        return by_region


def _coefficients(friction: FrictionValue) -> tuple[float | str, ...]:
    """All coefficients that are given."""
    if isinstance(friction, PressureTable):
        return friction.coefficient
    return _decaying(friction)[:2] if isinstance(friction, SlipRateTable) else _pair(friction)


def _pair(friction: FrictionValue) -> tuple[float | str, float | str]:
    """Along the direction and across it."""
    assert not isinstance(friction, SlipRateTable | PressureTable)
    return friction if isinstance(friction, tuple) else (friction, friction)


def _decaying(friction: FrictionValue) -> tuple[float | str, float | str, float | str]:
    """Static, kinetic, decay speed; a constant does not decay, at any speed."""
    if isinstance(friction, SlipRateTable):
        return friction.static, friction.kinetic, friction.decay_speed
    assert not isinstance(friction, tuple | PressureTable)
    return friction, friction, 1.0


FACE, FACES = "one [contact]", "several [[contact]]"
ContactTables = Annotated[
    Annotated[ContactTable, Tag(FACE)]
    | Annotated[tuple[ContactTable, ...], Field(min_length=1, max_length=TABLES), Tag(FACES)],
    Discriminator(lambda given: FACES if isinstance(given, list | tuple) else FACE),
]


def _without_direction(friction: FrictionValue | None) -> FrictionValue | None:
    if isinstance(friction, tuple):
        raise ValueError("should be one coefficient: two need a direction, which a [[contact]] has")
    return friction


_OneLaw = Annotated[FrictionValue, AfterValidator(_without_direction)]


class AutoPairTable(Table):
    """What is different for some of the pairs found: those of two names, each of a body, a component, a cell group or a
    face, or a pattern such as "bolt*" (`fnmatch`); with `slave` the first of the two has the contact points."""

    of: tuple[Name, Name]
    friction: _OneLaw | None = None
    adjust: Closed | None = None
    smooth: bool | None = None
    slave: bool = False
    leave_out: bool = False

    def order(self, pair: FoundPair) -> tuple[str, str] | None:
        """The faces of a pair in the order of the two names; None if they are others."""
        faces = (pair.face, pair.against)
        names = list(zip(faces, pair.bodies, pair.groups, strict=True))
        for one, other in ((0, 1), (1, 0)):
            if _is_called(names[one], self.of[0]) and _is_called(names[other], self.of[1]):
                return faces[one], faces[other]
        return None


def _is_called(names: Iterable[str], pattern: str) -> bool:
    return any(fnmatchcase(name, pattern) for name in names)


class AutoContactTable(Table):
    """Contact of all faces that face each other within a distance in metres, with one law; that of some in `pair`."""

    distance: Length
    friction: _OneLaw
    adjust: Closed = 0.0
    smooth: bool = False
    pair: Annotated[tuple[AutoPairTable, ...], Field(max_length=TABLES)] = ()

    def pairs_on(self, mesh: coulomb.NamedMesh | JoinedMesh) -> FoundPairs:
        """The pairs found; ValueError on every rank if there is none; collective."""
        try:
            return coulomb.auto_pairs(mesh, self.distance)
        except ValueError as error:
            raise ValueError(str(error).replace("auto_pairs", "auto_contact", 1)) from None

    def tables(self, pairs: Iterable[FoundPair]) -> list[ContactTable]:
        """The contact of every pair found.

        Raises:
            ValueError: If an entry of `pair` is of none of them.
        """
        pairs, tables, used = list(pairs), [], set()
        for one in pairs:
            faces = (one.face, one.against)
            given = {name: getattr(self, name) for name in ("friction", "adjust", "smooth")}
            left_out = slave = False
            for number, table in enumerate(self.pair):
                if (ordered := table.order(one)) is not None:
                    used.add(number)
                    own = {name: getattr(table, name) for name in given}
                    given |= {name: value for name, value in own.items() if value is not None}
                    left_out, slave, faces = table.leave_out, table.slave, ordered if table.slave else faces
            if not left_out:
                keys = {"face": faces[0], "against": faces[1], **given, "slave": slave}
                fields = ContactTable.model_fields
                named = {name: value for name, value in keys.items() if value != fields[name].default}
                tables.append(ContactTable.model_validate(named))
        for number, table in enumerate(self.pair):
            if number not in used:
                listed = "; ".join(f"{pair.face!r} and {pair.against!r}" for pair in pairs[:5])
                more = f"; and {len(pairs) - 5} more" if len(pairs) > 5 else ""
                raise ValueError(
                    f"auto_contact.pair.{number}: none of the pairs found is of {table.of[0]!r} and {table.of[1]!r}; "
                    f"those found are {listed}{more}"
                )
        return tables
