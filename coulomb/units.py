"""The units of a problem, and numbers with them.  Standard library only.

A problem may be posed in any consistent units: those of length and stress give the others with the second and the
kelvin (mm and MPa: N, mJ, tonnes), and nothing is converted.  Words show numbers in prefixes of the SI: 24 µm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

NARROW: Final = "\u202f"
"""Non-breaking space between a number and its unit."""

_PLAIN: Final = str.maketrans(f"{NARROW}−µ⁻⁰¹²³⁴⁵⁶⁷⁸⁹", " -u-0123456789") | str.maketrans({"±": "+-"})
_PREFIXES: Final = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
_LEAST: Final = 1e-13
"""Amounts in the SI below this are given without prefix: 6.8e-16 m."""

_AREAS: Final = ((1.0, "m²", 0.1), (1e-4, "cm²", 1e-4), (1e-6, "mm²", 1e-8), (1e-12, "µm²", 0.0))
"""Factor, unit, and the least area in m² that is given in it."""

LENGTHS: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}
STRESSES: Final = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "psi": 4.4482216152605 / 0.0254**2}
"""Units that a problem may have, in those of the SI."""

_CUSTOMARY: Final = ("in", "ft", "psi")
"""Units without prefixes."""

_DIMENSIONS: Final = {
    **{"m": (1, 0), "m²": (2, 0), "1/m": (-1, 0), "rad/m": (-1, 0), "m/s": (1, 0)},
    **{"Pa": (0, 1), "N": (2, 1), "N m": (3, 1), "J": (3, 1), "W": (3, 1), "J/m²": (1, 1), "W/m²": (1, 1)},
    **{"N/m": (1, 1), "N/m³": (-1, 1), "m/N": (-1, -1), "N m/rad": (3, 1)},
    **{"m/s²": (1, 0), "kg/m³": (-2, 1), "W/(m K)": (2, 1), "W/(m² K)": (1, 1), "W/m³": (0, 1)},
}
"""Powers of length and stress; of other units none."""


@dataclass(frozen=True)
class Units:
    """The units of length and stress of a problem: keys of `LENGTHS` and `STRESSES`.

    Raises:
        ValueError: If one of them is unknown.
    """

    length: str = "m"
    stress: str = "Pa"

    def __post_init__(self) -> None:
        for name, given, known in (("length", self.length, LENGTHS), ("stress", self.stress, STRESSES)):
            if given not in known:
                raise ValueError(f"units: {name} must be one of {', '.join(known)}, but is {given!r}")

    def factor(self, unit: str) -> float:
        """What 1 of the quantity is in this unit of the SI."""
        length, stress = _DIMENSIONS.get(unit, (0, 0))
        return float(LENGTHS[self.length] ** length * STRESSES[self.stress] ** stress)

    @property
    def customary(self) -> bool:
        return self.length in _CUSTOMARY or self.stress in _CUSTOMARY

    def name(self, unit: str) -> str:
        """The problem's own unit in place of one of the SI: N mm for N m."""
        if self == Units() or unit not in _DIMENSIONS:
            return unit
        if unit in ("N", "J", "W") and not self.customary:
            power = round(math.log10(self.factor(unit)))
            if power in _PREFIXES:
                return f"{_PREFIXES[power]}{unit}"
        force = "lbf" if (self.length, self.stress) == ("in", "psi") else f"{self.stress} {self.length}²"
        force = force if unit == "N" or self.customary else self.name("N")
        force = f"({force})" if " " in force and unit != "N" else force
        energy = f"{force} {self.length}" if unit in ("J", "W") or self.customary else self.name("J")
        whole = {"N": force, "J": energy, "W": f"{energy}/s", "Pa": self.stress}
        if unit in whole:
            return whole[unit]
        names = {**whole, "m": self.length}
        return re.sub("[A-Za-z]+", lambda symbol: names.get(symbol[0], symbol[0]), unit)


_used = Units()


def use(length: str = "m", stress: str = "Pa") -> None:
    """State the units of the problems of this process, for messages, reports and files; nothing is converted.

    Raises:
        ValueError: If one of them is unknown.
    """
    global _used
    _used = Units(length, stress)


def used() -> Units:
    """The units of the problems of this process."""
    return _used


def scale_of(largest: float, unit: str) -> tuple[float, str]:
    """The SI prefix suited for numbers up to `largest`, of either sign, of a quantity that is in `unit` in the SI: the
    factor to divide by, and the unit with its prefix, as (1e6, "MPa"); of customary units no prefix."""
    factor = _used.factor(unit)
    size = abs(largest) * factor
    if not unit or unit == "°" or not math.isfinite(size) or _used.customary or size < _LEAST:
        return 1.0, _used.name(unit)
    if unit == "m²":
        return next((of / factor, name) for of, name, least in _AREAS if size >= 0.9995 * least)
    power = 3 * math.floor(math.log10(size * 1.0005) / 3.0)  # 999.96 reads 1000: the next prefix
    power = min(max(power, min(_PREFIXES)), 3 if unit in ("s", "m") else max(_PREFIXES))  # no Mm, which is read as mm
    if unit == "s":
        power = min(power, 0)
    return 10.0**power / factor, _PREFIXES[power] + unit


def number(value: float, digits: int = 4) -> str:
    """A number in few digits; very large and small ones as 1.2×10⁻⁸, nan as a dash."""
    if not math.isfinite(value):
        return "–"
    shown = f"{value:.{digits}g}"
    if "e+" in shown and abs(value) < 1e6:
        shown = f"{float(shown):.0f}"
    shown = shown.replace("-", "−")
    if "e" not in shown:
        return shown
    mantissa, power = shown.split("e")
    power = power.replace("−", "-")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{mantissa}×10{raised}"


def plain(text: str) -> str:
    """In ASCII, which every terminal, log file and pipe has: 24 um, 1 m^2, 1.2e-8."""
    return text.replace("m²", "m^2").replace("×10", "e").translate(_PLAIN)


def rounded(values: Iterable[float], least: float) -> list[float]:
    """Numbers, of which those up to `least` are 0."""
    return [0.0 if abs(value) <= least else value for value in values]


def quantity(
    value: float | None, unit: str = "", digits: int = 4, accuracy: Mapping[str, float] = MappingProxyType({})
) -> str:
    """A number with its unit: 151.3 MPa; 0 up to the `accuracy` of the unit (`io.accuracy`)."""
    if value is None:
        return "–"
    (value,) = rounded([value], accuracy.get(unit, 0.0))
    factor, prefixed = scale_of(value, unit)
    return f"{number(value / factor, digits)}{NARROW}{prefixed}" if prefixed else number(value, digits)


def amount(value: float, unit: str = "m", digits: int = 3) -> str:
    """A number with its unit in ASCII, for messages: 24 um."""
    return plain(quantity(value, unit, digits))


def in_seconds(value: float) -> str:
    """A time of a history or of a run in seconds, without prefixes: 0.25 s."""
    return f"{number(value, 4)}{NARROW}s"


def vector(
    values: Iterable[float], unit: str, digits: int = 4, accuracy: Mapping[str, float] = MappingProxyType({})
) -> str:
    """Components with one unit: (−14.7, −22.5, 104) MN; those below the last digit of the largest are shown as 0, and
    what is up to the `accuracy` of the unit (`io.accuracy`)."""
    values = rounded(values, accuracy.get(unit, 0.0))
    largest = max((abs(value) for value in values), default=0.0)
    factor, prefixed = scale_of(largest, unit)
    shown = ", ".join(number(v / factor, digits) for v in rounded(values, 0.5 * 10.0**-digits * largest))
    return f"({shown}){NARROW}{prefixed}"


def with_bar(
    values: Sequence[float], bars: Sequence[float] | None, unit: str, of_inputs: Sequence[float] | None = None
) -> str:
    """A number, or the components of a vector, with error bars in two digits: 104.42 ± 0.59 MN; without bars in four
    digits.  At most six decimals; the prefix suits the larger one: 0.0 ± 1.8 µm.  With those of inputs: 104.42 ± 0.59
    (mesh) ± 2.1 (inputs) MN."""
    factor, prefixed = scale_of(max(map(abs, [*values, *(bars or ())])), unit)
    largest = 0.0 if bars is None else max(bars) / factor
    decimals = min(max(1 - math.floor(math.log10(largest)), 0), 6) if 0.0 < largest < math.inf else 4

    def listed(numbers: Sequence[str]) -> str:
        return numbers[0] if len(numbers) == 1 else f"({', '.join(numbers)})"

    def rounded_off(value: float) -> str:
        return f"{round(value / factor, decimals) + 0.0:.{decimals}f}".replace("-", "−")  # no -0

    if bars is None:
        return f"{listed([number(value / factor) for value in values])}{NARROW}{prefixed}"
    small = [rounded_off(bar) if round(bar / factor, decimals) else number(bar / factor, 2) for bar in bars]
    both = listed(small)
    if of_inputs is not None:
        both += f" (mesh) ± {listed([number(bar / factor, 2) for bar in of_inputs])} (inputs)"
    return f"{listed([rounded_off(value) for value in values])} ± {both}{NARROW}{prefixed}"


def in_prefixed(values: Sequence[float], unit: str) -> str:
    """A number, or the smallest and the largest, with one unit: 1 to 2 MPa."""
    factor, prefixed = scale_of(max(values), unit) if unit else (1.0, "")
    return f"{' to '.join(number(value / factor) for value in values)} {prefixed}".strip()
