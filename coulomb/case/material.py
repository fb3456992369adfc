"""The tables of a case file about materials and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

import coulomb

from .curves import AmplitudeTable, amplitude_of
from .values import (
    ROWS,
    TABLES,
    Conductivity,
    Density,
    Expansion,
    FileName,
    Length,
    Name,
    NodeNumber,
    Number,
    SpatialNumber,
    SpatialVector,
    Table,
    Young,
    coefficient,
    field,
)

if TYPE_CHECKING:
    from ..fem.bodies import AnyMaterial, Temperatures, ThermalLoad

ONE_NUMBER, THREE_NUMBERS = "one number", "three numbers"


def _count(given: Any) -> str:
    return THREE_NUMBERS if isinstance(given, list | tuple) else ONE_NUMBER


NotNegative = Annotated[float, Field(ge=0.0, le=1e24, strict=True)]
PoissonRatio = Annotated[float, Field(gt=-1.0, lt=0.5, strict=True)]

YoungValue = Annotated[
    Annotated[Young, Tag(ONE_NUMBER)] | Annotated[tuple[Young, Young, Young], Tag(THREE_NUMBERS)], Discriminator(_count)
]
PoissonValue = Annotated[
    Annotated[PoissonRatio, Tag(ONE_NUMBER)] | Annotated[tuple[Number, Number, Number], Tag(THREE_NUMBERS)],
    Discriminator(_count),
]
ExpansionValue = Annotated[
    Annotated[Expansion, Tag(ONE_NUMBER)] | Annotated[tuple[Expansion, Expansion, Expansion], Tag(THREE_NUMBERS)],
    Discriminator(_count),
]


class MaterialTable(Table):
    """Young's modulus in pascals, Poisson's ratio, density in kg/m^3, expansion in 1/K, conductivity in W/(m K).

    With three of Young's moduli, Poisson's ratios and shear moduli: orthotropic, with the first and second direction.
    With a law: hyperelastic, for large motions; the Mooney-Rivlin law has c1, c2 and bulk in
    pascals in their place, Ogden's lists mu in pascals and alpha, and bulk.
    """

    law: Literal["neo-hookean", "st-venant-kirchhoff", "mooney-rivlin", "ogden"] | None = None
    young: YoungValue | None = None
    poisson: PoissonValue | None = None
    c1: NotNegative | None = None
    c2: NotNegative | None = None
    mu: Annotated[tuple[Number, ...], Field(max_length=9)] | None = None
    alpha: Annotated[tuple[Number, ...], Field(max_length=9)] | None = None
    bulk: Young | None = None
    shear: tuple[Young, Young, Young] | None = None
    directions: tuple[SpatialVector, SpatialVector] | None = None
    density: Density | None = None
    expansion: ExpansionValue | None = None
    conductivity: Conductivity | None = None

    @model_validator(mode="after")
    def _constants_of_its_law(self) -> MaterialTable:
        own = {"mooney-rivlin": ("c1", "c2", "bulk"), "ogden": ("mu", "alpha", "bulk")}
        needed = own.get(self.law or "", ("young", "poisson"))
        for name in needed:
            if getattr(self, name) is None:
                raise ValueError(f"{name} is missing" + (f"; law = {self.law!r} needs it" if self.law else ""))
        linear = ("shear", "directions", "conductivity") if self.law else ()
        for name in {"young", "poisson", "c1", "c2", "mu", "alpha", "bulk"} - {*needed} | {*linear}:
            if getattr(self, name) is not None:
                law = "an elastic material" if self.law is None else f"law = {self.law!r}"
                raise ValueError(f"{name} does not belong to {law}, which has {', '.join(needed)} and density")
        if self.law and isinstance(self.young, tuple) | isinstance(self.poisson, tuple):
            raise ValueError(f"law = {self.law!r} has one number each in young and poisson")
        return self

    @model_validator(mode="after")
    def _of_one_kind(self) -> MaterialTable:
        given = {"young": isinstance(self.young, tuple), "poisson": isinstance(self.poisson, tuple)}
        given |= {"shear": self.shear is not None}
        if any(given.values()) and not all(given.values()):
            lacks = ", ".join(name for name, there in given.items() if not there)
            raise ValueError(
                "an orthotropic material has three numbers each in young (E1, E2, E3), poisson (nu12, nu13, nu23) and "
                f"shear (G12, G13, G23), but not in {lacks}; an isotropic one has one number in young and poisson"
            )
        for name in ("directions", "expansion") if not self.orthotropic else ():
            if isinstance(getattr(self, name), tuple):
                what = "directions are" if name == "directions" else "three numbers in expansion are"
                raise ValueError(f"{what} for an orthotropic material, which has three numbers in young")
        if self.law or self.orthotropic:
            try:
                self.material()
            except ValueError as error:
                raise ValueError(str(error).removeprefix("material: ")) from None
        return self

    @property
    def orthotropic(self) -> bool:
        return isinstance(self.young, tuple)

    def material(self) -> AnyMaterial:
        """ValueError if the strain energy is not positive, or directions are parallel."""
        if isinstance(self.young, tuple) and isinstance(self.poisson, tuple) and self.shear is not None:
            from ..fem.bodies import COORDINATE_AXES

            given = self.directions
            directions = COORDINATE_AXES if given is None else (field(given[0]), field(given[1]))
            return coulomb.OrthotropicMaterial(
                self.young, self.poisson, self.shear, directions, self.density, self.expansion, self.conductivity
            )

        expansion = self.expansion
        assert not isinstance(expansion, tuple)
        if self.c1 is not None and self.c2 is not None and self.bulk is not None:
            return coulomb.MooneyRivlin(self.c1, self.c2, self.bulk, self.density, expansion)
        if self.mu is not None and self.alpha is not None and self.bulk is not None:
            return coulomb.Ogden(self.mu, self.alpha, self.bulk, self.density, expansion)
        assert isinstance(self.young, float) and isinstance(self.poisson, float)
        if self.law is not None:
            kind = coulomb.NeoHookean if self.law == "neo-hookean" else coulomb.StVenantKirchhoff
            return kind(self.young, self.poisson, self.density, expansion)
        return coulomb.Material(self.young, self.poisson, self.density, expansion, self.conductivity)


class GroupMaterialTable(MaterialTable):
    """The material of a group of cells."""

    cells: Name


ONE, SEVERAL = "one [material]", "several [[material]]"
MaterialTables = Annotated[
    Annotated[MaterialTable, Tag(ONE)]
    | Annotated[tuple[GroupMaterialTable, ...], Field(max_length=TABLES), Tag(SEVERAL)],
    Discriminator(lambda given: SEVERAL if isinstance(given, list | tuple) else ONE),
]


def tables_of(given: MaterialTable | tuple[GroupMaterialTable, ...] | None) -> tuple[MaterialTable, ...]:
    """One material, or those of all groups, as a tuple."""
    return () if given is None else (given,) if isinstance(given, MaterialTable) else given


def materials_of(groups: tuple[GroupMaterialTable, ...]) -> dict[str, AnyMaterial]:
    return {table.cells: table.material() for table in groups}


def refuse_groups(given: MaterialTable | tuple[GroupMaterialTable, ...], box: bool, table: str) -> None:
    """Check the groups of materials as far as they can be known before files are read.

    Raises:
        ValueError: If two materials are for one group, there is none, or a box has groups, where one `table` is right.
    """
    if isinstance(given, MaterialTable):
        return
    groups = [table.cells for table in given]
    if len(set(groups)) < len(groups) or not groups:
        raise ValueError(f"material: give one for every group of cells, but they are for {groups}")
    if box:
        raise ValueError(f"material: a box has no groups of cells; give one {table}")


class TemperatureAtTable(Table):
    """The temperature of the nodes of a set or of a group of cells of the mesh file, or of some by their numbers there
    (in several bodies "body:12")."""

    nodes: Name | Annotated[tuple[NodeNumber | Name, ...], Field(min_length=1, max_length=ROWS)]
    value: Number

    @field_validator("nodes", mode="before")
    @classmethod
    def _named_or_numbered(cls, given: object) -> object:
        if not isinstance(given, str | list | tuple) or not all(isinstance(one, int | str) for one in given):
            raise ValueError('give the name of a set, as "hot", or numbers of nodes of the mesh file, as [11, 12]')
        return given


class TemperatureTable(Table):
    """Temperature in kelvin or degrees Celsius: a value, with others at some nodes, or a field of a file; and that of
    the unstrained body.

    With `body` it is that of one of several bodies; the others have no thermal strain.
    """

    value: SpatialNumber | None = None
    file: FileName | None = None
    field: Name | None = None
    scale: Length = 1.0
    reference: Number = 0.0
    amplitude: AmplitudeTable | None = None
    body: Name | None = None
    at: Annotated[tuple[TemperatureAtTable, ...], Field(max_length=ROWS)] = ()

    @model_validator(mode="after")
    def _at_nodes(self) -> TemperatureTable:
        if self.at and (self.body is not None or not isinstance(self.value, float)):
            raise ValueError("at goes with a value that is a number, that of all other nodes, and without body")
        return self

    @model_validator(mode="after")
    def _one_source(self) -> TemperatureTable:
        if (self.value is None) == (self.file is None):
            raise ValueError("give either value, or file and field, one of the two")
        if (self.file is None) != (self.field is None):
            raise ValueError("file and field go together: the file, and the name of the temperatures in it")
        if self.file is None and "scale" in self.model_fields_set:
            raise ValueError("scale goes with file: it is the metres per unit of length of the file")
        return self

    def thermal(self) -> ThermalLoad:
        from ..fem.bodies import ThermalLoad

        amplitude = amplitude_of(self.amplitude)
        if self.file is not None and self.field is not None:
            field = coulomb.NodalField.from_file(self.file, self.field, self.scale)
            return ThermalLoad(field, self.reference, amplitude)
        assert self.value is not None
        return ThermalLoad(coefficient(self.value), self.reference, amplitude)

    def of_bodies(self, temperature: Temperatures, bodies: Sequence[str]) -> Temperatures | dict[str, Temperatures]:
        """The temperature of one body without a name, or of those of several that have one, with that at nodes.

        Raises:
            ValueError: If nodes are of no body.
        """
        if self.body is not None:
            return {self.body: temperature}
        if not self.at or not isinstance(self.value, float):
            return temperature
        from ..fem.bodies import NodeTemperatures

        of_body: dict[str, list[tuple[str | tuple[int, ...], float]]] = {name: [] for name in bodies or [""]}
        for one in self.at:
            several = not isinstance(one.nodes, str)
            names: dict[str, list[str]] = {}
            for node in map(str, one.nodes if several else [one.nodes]):
                body, _, name = node.partition(":") if bodies else ("", "", node)
                if body not in of_body or (several and not name.isdigit()):
                    known = " or ".join(f'"{one}:{name or node}"' for one in bodies[:3]) if bodies else "numbers"
                    raise ValueError(f"temperature.at: nodes = {node!r}: of no body: give {known}")
                names.setdefault(body, []).append(name)
            for body, named in names.items():
                of_body[body].append((tuple(map(int, named)) if several else named[0], one.value))
        value = self.value
        found: dict[str, Temperatures] = {name: NodeTemperatures(value, tuple(rows)) for name, rows in of_body.items()}
        return found if bodies else found[""]
