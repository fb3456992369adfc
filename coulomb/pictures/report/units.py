"""Numbers with their units, in prefixes of the SI, and the law of friction in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from ...io.accuracy import rounded

NARROW = "\u202f"
"""Non-breaking space between a number and its unit."""

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}
_DIGITS: Final = 1e-4
_AREAS = ((1.0, "m²"), (1e-4, "cm²"), (1e-6, "mm²"), (1e-12, "µm²"))


def scale_of(largest: float, unit: str) -> tuple[float, str]:
    """The SI prefix suited for numbers up to `largest` in the bare unit, of either sign: the factor to divide by, and
    the unit with its prefix, as (1e6, "MPa")."""
    size = abs(largest)
    if not unit or unit == "°" or size == 0.0 or not math.isfinite(size):
        return 1.0, unit
    if unit == "m²":
        return next((pair for pair in _AREAS if size >= 0.9995 * pair[0]), _AREAS[-1])
    power = 3 * math.floor(math.log10(size * 1.0005) / 3.0)  # 999.96 reads 1000: the next prefix
    power = min(max(power, min(_PREFIXES)), 3 if unit == "s" else max(_PREFIXES))
    if unit == "s":
        power = min(power, 0)
    return 10.0**power, _PREFIXES[power] + unit


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


def quantity(
    value: float | None, unit: str = "", digits: int = 4, accuracy: Mapping[str, float] = MappingProxyType({})
) -> str:
    """A number with its unit: 151.3 MPa; 0 up to the `accuracy` of the unit (`io.accuracy`)."""
    if value is None:
        return "–"
    (value,) = rounded([value], accuracy.get(unit, 0.0))
    factor, prefixed = scale_of(value, unit)
    return f"{number(value / factor, digits)}{NARROW}{prefixed}" if prefixed else number(value, digits)


def in_nodes(count: int, kind: str = "") -> str:
    """A number of nodes: 1 node, 12 contact nodes."""
    return f"{count} {kind}{' ' if kind else ''}{'node' if count == 1 else 'nodes'}"


def in_few(names: Sequence[str], most: int = 3) -> str:
    """Some names: "a, b, c and 2 more"."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def in_seconds(value: float) -> str:
    """A time of a history or of a run in seconds, without prefixes: 0.25 s."""
    return f"{number(value, 4)}{NARROW}s"


def vector(
    values: Sequence[float], unit: str, digits: int = 4, accuracy: Mapping[str, float] = MappingProxyType({})
) -> str:
    """Components with one unit: (−14.7, −22.5, 104) MN; rounding errors relative to the largest are shown as 0, and
    what is up to the `accuracy` of the unit (`io.accuracy`)."""
    values = rounded(values, accuracy.get(unit, 0.0))
    largest = max((abs(value) for value in values), default=0.0)
    factor, prefixed = scale_of(largest, unit)
    shown = ", ".join(number(0.0 if abs(v) <= 1e-9 * largest else v / factor, digits) for v in values)
    return f"({shown}){NARROW}{prefixed}"


def with_bar(values: Sequence[float], bars: Sequence[float] | None, unit: str) -> str:
    """A number, or the components of a vector, with error bars in two digits: 104.42 ± 0.59 MN; without bars in four
    digits.  At most six decimals; the prefix suits the larger one: 0.0 ± 1.8 µm."""
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
    return f"{listed([rounded_off(value) for value in values])} ± {listed(small)}{NARROW}{prefixed}"


def compared_in_words(summary: Mapping[str, Any]) -> str:
    """The other meshes of the entry `error` of a summary, if it has one: meshes of 1620 and 384 unknowns."""
    if "error" not in summary:
        return ""
    own, *others = summary["error"]["meshes"]
    sizes, orders = [f"{one['unknowns']}" for one in others], {one["order"] for one in others}
    words = {1: "first order", 2: "second order"}
    kind = "" if orders == {own["order"]} or len(orders) > 1 else f" of {words.get(max(orders), 'both orders')}"
    if len(orders) > 1:
        sizes = [f"{size} ({words.get(one['order'], 'both orders')})" for size, one in zip(sizes, others, strict=True)]
    listed = ", ".join([*sizes[:-2], " and ".join(sizes[-2:])])
    return f"{'a mesh' if len(sizes) == 1 else 'meshes'}{kind} of {listed} unknowns"


def bars_in_words(summary: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Name, value with error bar, and observed order of every total in the entry `error` of a summary, but of those
    that are 0 to the tolerance of the solver; before them the error of the stress as a part of it."""
    found = summary.get("error") or {}
    if (stress := found.get("relative_stress_error")) is not None:
        yield "stress, energy norm", f"± {number(100.0 * stress, 2)}{NARROW}%", "–"
    for bar in found.get("bars", ()):
        value, error, order = bar["value"], bar["error"], bar["order"]
        values, bars = ([one] if isinstance(one, float) else one for one in (value, error))
        left = bar.get("parts", {}).get("algebraic", math.inf)
        if not any(values) and (bars is None or max(bars) <= 2.0 * (left if isinstance(left, float) else max(left))):
            continue
        remark = f", {bar['remark']}" if "remark" in bar else ""
        shown = with_bar(values, bars, bar["unit"]) + remark
        yield _total_in_words(bar["quantity"]), shown, "–" if order is None else number(order, 2)


def share_of_tolerance(summary: Mapping[str, Any]) -> tuple[float, str] | None:
    """The largest part of an error bar that the tolerance of the solver leaves, over the bar, and the total that has
    it; None without any.

    Totals that are less than this part, and those with a bar beyond their fourth digit, do not count: some are 0 and
    some exact on any mesh, as forces that follow from the loads alone, and have no error but this one.
    """
    found = []
    for bar in (summary.get("error") or {}).get("bars", ()):
        if "parts" in bar:
            of_all = (bar["value"], bar["error"], bar["parts"]["algebraic"])
            value, error, part = (math.hypot(*([of] if isinstance(of, float) else of)) for of in of_all)
            if part < value and error > _DIGITS * value:
                found.append((part / error, _total_in_words(bar["quantity"])))
    return max(found, default=None)


def _total_in_words(quantity: str) -> str:
    """Of its place in summary.json: normal force, force of clamp_left."""
    place, _, name = quantity.removeprefix("totals.").rpartition(".")
    of = place.partition(".")[2]
    return f"{name.replace('_', ' ')}{f' of {of}' if of else ''}"


def in_prefixed(values: Sequence[float], unit: str) -> str:
    """A number, or the smallest and the largest, with one unit: 1 to 2 MPa."""
    factor, prefixed = scale_of(max(values), unit) if unit else (1.0, "")
    return f"{' to '.join(number(value / factor) for value in values)} {prefixed}".strip()


def friction_in_words(law: Mapping[str, Any], shown: Callable[[Sequence[float], str], str] = in_prefixed) -> str:
    """The law of friction with its coefficients, from its numbers in summary.json: Mohr-Coulomb friction 0.3, cohesion
    2 MPa; `shown` gives the words for a number, or the smallest and the largest, and their unit."""

    def of(name: str, unit: str = "") -> str:
        given = law[name]
        return shown([given["min"], given["max"]] if isinstance(given, Mapping) else [given], unit)

    if law["law"] == "tresca":
        return f"Tresca friction {of('slip_stress', 'Pa')}"
    directed = law.get("friction_along") is not None
    friction = f"{of('friction_along')} along and {of('friction_across')} across" if directed else of("friction")
    if law.get("friction_limit") is not None:
        friction += f", at most {of('friction_limit', 'Pa')}"
    if law["law"] == "coulomb":
        return f"Coulomb friction {friction}"
    return f"Mohr-Coulomb friction {friction}, cohesion {of('cohesion', 'Pa')}"
