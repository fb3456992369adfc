"""The tables of a case file about heat: what heats and cools the bodies, and conduction through contacts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from .curves import AmplitudeTable, amplitude_of
from .values import Name, Number, SpatialNumber, Stiffness, Table, Young, coefficient

if TYPE_CHECKING:
    from ..fem.bodies import HeatLoad
    from ..model.contact import ThermalContact


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

    def load(self) -> HeatLoad:
        from ..fem.bodies import HeatLoad

        temperature, flux, ambient, source = (
            None if value is None else coefficient(value)
            for value in (self.temperature, self.flux, self.ambient, self.source)
        )
        return HeatLoad(
            self.face, temperature, flux, self.film, ambient, source, self.body, amplitude_of(self.amplitude)
        )


class ThermalContactTable(Table):
    """Conductance + factor (pressure/hardness)^exponent in W/(m^2 K), temperature of a foundation, and the part of the
    heat of friction that goes into the face."""

    conductance: Stiffness = 0.0
    factor: Stiffness = 0.0
    hardness: Young = 1e9
    exponent: Annotated[float, Field(gt=0.0, le=10.0, strict=True)] = 0.95
    temperature: Number | None = None
    share: Annotated[float, Field(ge=0.0, le=1.0, strict=True)] = 0.5

    def thermal(self) -> ThermalContact:
        from ..model.contact import ThermalContact

        return ThermalContact(
            *(self.conductance, self.factor, self.hardness, self.exponent, self.temperature, self.share)
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
