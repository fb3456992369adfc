"""Words of a summary: contacts, ties, error bars, other meshes, the law of friction, numbers of nodes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from ...units import NARROW, in_prefixed, number, quantity, with_bar

_DIGITS: Final = 1e-4
"""Part of a total that its fourth digit is."""


def in_nodes(count: int, kind: str = "") -> str:
    """A number of nodes: 1 node, 12 contact nodes."""
    return f"{count} {kind}{' ' if kind else ''}{'node' if count == 1 else 'nodes'}"


def in_few(names: Sequence[str], most: int = 3, sep: str = ", ", room: int = 1000) -> str:
    """Some names: "a, b, c and 2 more", in about so many characters."""
    while most > 1 and sum(map(len, names[:most])) > room:
        most -= 1
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return sep.join(names[:most]) + more


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
    accuracy = summary.get("error") or {}
    if (stress := accuracy.get("relative_stress_error")) is not None:
        yield "stress, energy norm", f"± {number(100.0 * stress, 2)}{NARROW}%", "–"
    for bar in accuracy.get("bars", ()):
        value, error, order = bar["value"], bar["error"], bar["order"]
        values, bars = ([one] if isinstance(one, float) else one for one in (value, error))
        left = bar.get("parts", {}).get("algebraic", math.inf)
        if not any(values) and (bars is None or max(bars) <= 2.0 * (left if isinstance(left, float) else max(left))):
            continue
        remark = f", {bar['remark']}" if "remark" in bar else ""
        of_inputs = _bar_of_inputs(summary, bar["quantity"], _NO_CHANGE * max(map(abs, values)))
        shown = with_bar(values, bars, bar["unit"], of_inputs) + remark
        yield _total_in_words(bar["quantity"]), shown, "–" if order is None else number(order, 2)


def _bar_of_inputs(summary: Mapping[str, Any], quantity: str, least: float) -> list[float] | None:
    """What the tolerances of inputs make uncertain in a total, by its place in the summary, 0 up to the least; None
    where it is not known."""
    place, _, total = quantity.replace("heat.flows.", "heat_flows.").rpartition(".")
    kind, _, name = place.partition(".")
    faces, others = summary.get("input_bars", {}), summary.get("other_input_bars", {})
    if kind in ("totals", "faces"):
        bars = faces.get(name or next(iter(faces), ""), {})
    else:
        bars = others.get(kind or "bodies", {}).get(name, {})  # the energy of the only body
    bar = bars.get(total)
    each = [bar] if isinstance(bar, float) else bar
    return each and [one if one > least else 0.0 for one in each]


def other_totals(summary: Mapping[str, Any]) -> Iterator[tuple[str, str, dict[str, list[float]]]]:
    """What 1 % more of inputs does to totals beside contact forces: words of the total, its unit, and the changes, of
    one number or several, by the names of the inputs, largest first.

    Totals that nothing changes are left out, and mean pressures where areas stay: they are in proportion to the normal
    forces.
    """
    entries = summary.get("sensitivity") or ()
    for kind, words, name, unit in _OTHERS:
        for of in entries[0].get(kind, ()) if entries else ():
            change_of = {
                entry["input"]: [0.01 * change for change in (given if isinstance(given, list) else [given])]
                for entry in entries
                if (given := entry.get(kind, {}).get(of, {}).get(name)) is not None
            }
            sizes = {given: math.hypot(*change) for given, change in change_of.items()}
            largest = [given for given in sorted(sizes, key=lambda given: -sizes[given]) if sizes[given] > 0.0]
            fixed = name == "mean_pressure" and not any(entry[kind][of]["contact_area"] for entry in entries)
            if not fixed and largest:
                where = of.removeprefix("heat_").replace("_", " ") if kind == "heat_flows" else of
                total = f"{words} {where!r}" if of else words.removesuffix(" of")
                shown = [given for given in largest if sizes[given] > _NO_CHANGE * sizes[largest[0]]]
                yield total, unit, {given: change_of[given] for given in shown}


_NO_CHANGE: Final = 1e-8
"""Change of a total over the largest that is an error of the derivatives."""

_OTHERS: Final = (
    ("totals", "contact area of", "contact_area", "m²"),
    ("totals", "mean pressure of", "mean_pressure", "Pa"),
    ("totals", "largest pressure of", "greatest_pressure", "Pa"),
    ("totals", "largest slip of", "greatest_slip", "m"),
    ("totals", "friction work of the step on", "dissipated_energy", "J"),
    ("bodies", "strain energy of", "strain_energy", "J"),
    ("heat_flows", "heat flow of", "power", "W"),
    ("bolts", "force of bolt", "force", "N"),
    ("bolts", "shear of bolt", "shear", "N"),
    ("bolts", "bending of bolt", "bending", "N m"),
    ("probes", "displacement of probe", "displacement", "m"),
    ("probes", "pressure at probe", "pressure", "Pa"),
    ("probes", "slip at probe", "slip", "m"),
    ("ties", "force of", "force", "N"),
    ("rigid_faces", "translation of rigid face", "translation", "m"),
    ("rigid_faces", "force on rigid face", "force", "N"),
    ("loaded_foundations", "translation of", "translation", "m"),
    ("reactions", "force of", "force", "N"),
    ("totals", "moment about the origin on", "moment", "N m"),
)
"""Keys of such totals among the sensitivities of a summary, words, the name of the number, and its unit."""


def share_of_tolerance(summary: Mapping[str, Any]) -> tuple[float, str] | None:
    """The largest part of an error bar that the tolerance of the solver leaves, over the bar, and the total that has
    it; None without any.

    Totals that are less than this part, and those with a bar beyond their fourth digit, do not count: some are 0 and
    some exact on any mesh, as forces that follow from the loads alone, and have no error but this one.
    """
    shares = []
    for bar in (summary.get("error") or {}).get("bars", ()):
        if "parts" in bar:
            of_all = (bar["value"], bar["error"], bar["parts"]["algebraic"])
            value, error, part = (math.hypot(*([of] if isinstance(of, float) else of)) for of in of_all)
            if part < value and error > _DIGITS * value:
                shares.append((part / error, _total_in_words(bar["quantity"])))
    return max(shares, default=None)


def _total_in_words(quantity: str) -> str:
    """Of its place in summary.json: normal force, force of clamp_left."""
    place, _, name = quantity.removeprefix("totals.").rpartition(".")
    of = place.partition(".")[2]
    return f"{name.replace('_', ' ')}{f' of {of}' if of else ''}"


def friction_in_words(law: Mapping[str, Any]) -> str:
    """The law of friction with its coefficients, from its numbers in summary.json: Mohr-Coulomb friction 0.3, cohesion
    2 MPa."""

    def of(name: str, unit: str = "") -> str:
        given = math.nan if law[name] is None else law[name]  # without contact points
        return in_prefixed([given["min"], given["max"]] if isinstance(given, Mapping) else [given], unit)

    if law["law"] == "tresca":
        return f"Tresca friction {of('slip_stress', 'Pa')}"
    directed = law.get("friction_along") is not None
    friction = f"{of('friction_along')} along and {of('friction_across')} across" if directed else of("friction")
    if law.get("friction_limit") is not None:
        friction += f", at most {of('friction_limit', 'Pa')}"
    if law["law"] == "coulomb":
        return f"Coulomb friction {friction}"
    return f"Mohr-Coulomb friction {friction}, cohesion {of('cohesion', 'Pa')}"


def contact_in_words(one: Mapping[str, Any]) -> str:
    """A contact from `understood` in a summary: contact points, law, gap, and what it touches."""
    if not one["nodes"]:
        return f"no contact points now; {one['foundation']}"
    given = ""
    if any(one["given_gap"].values()):
        times = " times its amplitude" if "gap amplitude" in one["moves"] else ""
        given = f", of which given {lengths_in_words(one['given_gap'])}{times}"
    moves = f", moves by {one['moves']}" if one["moves"] else ""
    law, gap = friction_in_words(one), lengths_in_words(one["gap"])
    return f"{in_nodes(one['nodes'])}, {law}, gap {gap}{given}; {one['foundation']}{moves}"


def tie_in_words(one: Mapping[str, Any]) -> tuple[str, str]:
    """What a tie from `understood` in a summary is called, and how much is tied."""
    nodes = in_nodes(one["nodes"])
    if not one["area"]:
        return f"{one['kind']} {one['face']!r}", nodes
    apart = f", up to {quantity(one['apart'], 'm')} apart" if "apart" in one else ""
    name = f"{one['kind']} of {one['face']!r} to {one['against']!r}"
    return name, f"{nodes}, {quantity(one['area'], 'm²')}{one.get('acts', '')}{apart}"


def lengths_in_words(ends: Mapping[str, float]) -> str:
    """The smallest and the largest of lengths, once if they are the same."""
    return " to ".join(dict.fromkeys(quantity(ends[name], "m") for name in ("min", "max")))
