"""Line charts of a run, as SVG that takes the colour of the page's text."""

from __future__ import annotations

import contextlib
import io
import math
import re
from collections.abc import Sequence
from itertools import islice
from typing import Any, Final

import matplotlib
import numpy as np
from matplotlib.ticker import NullLocator

from ...arrays import IntArray
from ...contact_fields import normal_forces
from ...units import scale_of
from .fields import ZONES, zone_counts
from .files import Rows, Run
from .grids import nodes_of
from .problem import values_in_time
from .words import other_totals

_INK = "#010203"  # becomes the page's own colour
_FIRST, _SECOND, _THIRD, _FOURTH = "#0b84d8", "#e06c00", "#009e73", "#b05ea5"
"""Okabe and Ito's colours for the colour-blind, a little brighter, for white and black backgrounds."""

_CURVES = tuple((colour, style) for style in ("o-", "s--") for colour in (_FIRST, _SECOND, _THIRD, _FOURTH))
"""Colours and styles of several curves of one kind; more are not shown."""

_WIDTHS: Final = (3.6, 3.0, 2.4, 1.8, 1.2, 1.2, 1.2, 1.2)
"""Their widths: those that coincide are seen below each other."""


def convergence(run: Run) -> str:
    """Convergence of the (last) solve."""
    if not run.iterations:
        return ""
    return _svg(convergence_figure(run), "Convergence: residuals by step, and CG iterations by step")


def convergence_figure(run: Run) -> Any:
    """Residuals, measured rate, theta, CG iterations by step."""
    rows = run.iterations
    outer = bool(rows) and "change" in rows[0]
    figure, (left, right) = _figure(2)
    number = _column(rows, "iteration")
    _logarithmic(left, number, _column(rows, "residual"), "o-", _FIRST, 4.0, "residual, of the worst contact’s force")
    what = "Tresca problem" if outer else "path-following step" if rows and "theta" in rows[0] else "step"
    if rows and "theta" in rows[0]:
        theta = _column(rows, "theta")
        _logarithmic(left, number, theta, "s--", _SECOND, 3.5, "θ, duality measure")
    if outer:
        change = _column(rows, "change")
        _logarithmic(left, number, change, "s--", _SECOND, 3.5, "change of slip bound")
        _measured_rate(left, number, _column(rows, "residual"), run.summary.get("contraction"))
    if run.case is not None:
        left.axhline(run.tolerance, color=_THIRD, linewidth=1, linestyle=":")
        where = ("axes fraction", "data")
        left.annotate("tolerance", (0.02, run.tolerance), xycoords=where, va="bottom", color=_THIRD)
    left.set(xlabel=what, ylabel="measure")
    _legend(left)
    _decades(left, "residual 0 in every step")
    right.bar(number, _column(rows, "krylov"), color=_FIRST, width=0.7, label="CG iterations")
    if outer:
        right.bar(number, _column(rows, "path_following"), color=_SECOND, width=0.4, label="path-following steps")
        _legend(right)
    right.set(xlabel=what, ylabel="number" if outer else "CG iterations")
    _whole(left.xaxis, right.xaxis, right.yaxis)
    return figure


def _measured_rate(axis: Any, number: Any, residual: Any, rate: float | None) -> None:
    """A line with the measured rate, backwards from the last residual."""
    if rate is None or not 0.0 < rate or len(number) < 2 or not residual[-1] > 0.0:
        return
    shown = residual[-1] * rate ** (number - number[-1])
    label = f"measured rate {rate:.2g} per problem"
    axis.semilogy(number, shown, ":", color=_FOURTH, linewidth=1.5, label=label, scaley=False)


def forces(run: Run) -> str:
    """For a load history: force on the body, or of several contacts the normal force of each if their forces have no
    sum, and energies against time."""
    rows, time = run.rows, _column(run.rows, "time")
    figure, axes = _figure(2)
    if "force_x" in rows[0]:
        what, styles = "contact force on the body", ("o-", "s-", "^-")
        parts = [
            (f"along {axis}", _column(rows, f"force_{axis}", run.accuracy["N"]), (colour, style))
            for axis, colour, style in zip("xyz", (_SECOND, _THIRD, _FIRST), styles, strict=True)
        ]
    else:
        what, pressing = "normal contact force", _normal_forces(run)
        parts = [(name, force, look) for (name, force), look in zip(pressing.items(), _CURVES, strict=False)]
    factor, unit = scale_of(max(float(np.max(np.abs(part))) for _, part, _ in parts), "N")
    for (label, part, (colour, style)), width in zip(parts, _WIDTHS, strict=False):
        axes[0].plot(time, part / factor, style, color=colour, markersize=3, linewidth=width, label=label)
    axes[0].set(xlabel="time, s", ylabel=f"{what}, {unit}")
    names = {"loads": "loads", "prescribed": "prescribed displacements", "foundation": "foundation"}
    every, least = (*names, "elastic", "dissipated"), run.accuracy["J"]
    curves = {names.get(name, name): _column(rows, f"energy_{name}", least) for name in every}
    factor, unit = scale_of(max(float(np.max(np.abs(curve))) for curve in curves.values()), "J")
    for (name, curve), colour in zip(curves.items(), ("#8a8a8a", _FOURTH, "#8a8a8a", _FIRST, _SECOND), strict=True):
        if np.any(curve):
            work = name not in ("elastic", "dissipated")
            label = f"work of {name}" if work else f"{name} energy"
            axes[1].plot(time, curve / factor, "--" if work else "-", color=colour, label=label)
    axes[1].set(xlabel="time, s", ylabel=f"energy since the start, {unit}")
    if not any(np.any(curve) for curve in curves.values()):
        _say(axes[1], "all energies are 0")
    for axis in axes:
        _legend(axis)
        axis.margins(x=0.02)
    return _svg(figure, "Force and energy against time")


def _normal_forces(run: Run) -> dict[str, Any]:
    """Normal force of every contact at every step, by name; by "" of the only one."""
    columns = {name: f"{name}_normal_force" if name else "normal_force" for name in normal_forces(run.rows[0])}
    return {name: _column(run.rows, column, run.accuracy["N"]) for name, column in columns.items()}


def reactions(run: Run) -> str:
    """For a load history: magnitude of force and moment of every support against time; empty without supports."""
    names = [part["name"] for part in run.summary.get("reactions", ())][: len(_CURVES)]
    curves = {
        name.replace("_", " "): [_magnitude(run.rows, f"{name}_{what}") for what in ("force", "moment")]
        for name in names
    }
    labels = ("reaction force", "N"), ("reaction moment", "N m")
    return _against_time(run, curves, labels, "Reactions against time")


def probes(run: Run) -> str:
    """For a load history: displacement of the probes, and pressure of those in contact, against time; empty without
    probes."""
    names = [probe["name"] for probe in run.summary.get("probes", ())][: len(_CURVES)]
    curves = {
        name: [_magnitude(run.rows, f"probe_{name}_displacement"), _column(run.rows, f"probe_{name}_pressure")]
        for name in names
    }
    return _against_time(run, curves, (("displacement", "m"), ("contact pressure", "Pa")), "Probes against time")


def _magnitude(rows: Rows, name: str) -> Any:
    return np.sqrt(sum(_column(rows, f"{name}_{axis}") ** 2 for axis in "xyz"))


def _against_time(
    run: Run, curves: dict[str, list[Any]], labels: tuple[tuple[str, str], tuple[str, str]], title: str
) -> str:
    """Two panels with the curves of each name; labels are quantity and unit.  Empty without curves."""
    if not curves:
        return ""
    figure, axes = _figure(2)
    time = _column(run.rows, "time")
    for k, (axis, (what, bare)) in enumerate(zip(axes, labels, strict=True)):
        for pair in curves.values():
            pair[k] = _exact(pair[k], run.accuracy[bare])
        largest = [float(np.max(np.abs(pair[k]))) for pair in curves.values() if np.any(np.isfinite(pair[k]))]
        factor, unit = scale_of(max(largest, default=0.0), bare)
        for (name, pair), (colour, style), width in zip(curves.items(), _CURVES, _WIDTHS, strict=False):
            if np.any(np.isfinite(pair[k])):
                axis.plot(time, pair[k] / factor, style, color=colour, markersize=3, linewidth=width, label=name)
        axis.set(xlabel="time, s", ylabel=f"{what}, {unit}")
        axis.margins(x=0.02)
        if largest:
            _legend(axis)
        else:
            _say(axis, "none is on a contact face")
    return _svg(figure, title)


def surface(run: Run) -> str:
    """For a load history: zones, and the largest pressure and slip, against time."""
    rows, time = run.rows, _column(run.rows, "time")
    figure, (left, right) = _figure(2)
    counts = [zone_counts(step.grid("contact")) for step in run.steps]
    zones = [(name, colour) for name, colour in ZONES.values() if any(count[name] for count in counts)]
    stacked = [np.array([count[name] for count in counts]) for name, _ in zones]
    ends = np.concatenate(
        [[run.history.get("start", 0.0)], time]
    )  # the width of a step is its duration, of the first as well
    wide = [np.concatenate([counted[:1], counted]) for counted in stacked]
    left.stackplot(ends, wide, colors=[colour for _, colour in zones], labels=[name for name, _ in zones], step="pre")
    left.set(xlabel="time, s", ylabel="contact nodes", ylim=(0, None))
    _legend(left)
    pressure = _column(rows, "greatest_pressure", run.accuracy["Pa"])
    slip = _column(rows, "greatest_slip", run.accuracy["m"])
    factor, unit = scale_of(float(np.max(np.abs(pressure))), "Pa")
    right.plot(time, pressure / factor, "o-", color=_FIRST, markersize=3)
    right.set(xlabel="time, s", ylabel=f"largest contact pressure, {unit}")
    right.yaxis.label.set_color(_FIRST)
    factor, unit = scale_of(float(np.max(np.abs(slip))), "m")
    other = right.twinx()
    other.plot(time, slip / factor, "s--", color=_SECOND, markersize=3)
    other.set(ylabel=f"largest slip in the step, {unit}", ylim=(0, None))
    other.yaxis.label.set_color(_SECOND)
    other.spines[["top", "left"]].set_visible(False)
    other.tick_params(colors=_INK)
    return _svg(figure, "Zones, largest pressure and slip against time")


def force_displacement(run: Run) -> str:
    """For a load history: contact force against the prescribed displacement or motion; empty without one."""
    drive, what = _drive(run)
    if drive is None:
        return ""
    axis = int(np.argmax(np.ptp(drive, axis=0)))
    figure, (tangential, normal) = _figure(2)
    driven = drive[:, axis]
    length, length_unit = scale_of(float(np.max(np.abs(driven))), "m")
    pressing, least = _normal_forces(run), run.accuracy["N"]
    column = f"force_{'xyz'[axis]}"
    along = {"": _column(run.rows, column, least)} if column in run.rows[0] else {}
    along = along or {name: _column(run.rows, f"{name}_{column}", least) for name in pressing}
    for panel, forces_, label, shift in (
        (tangential, along, f"contact force along {'xyz'[axis]}", 1),
        (normal, pressing, "normal contact force", 0),
    ):
        looks = (*_CURVES[shift:], *_CURVES[:shift])
        factor, unit = scale_of(max(float(np.max(np.abs(force))) for force in forces_.values()), "N")
        for (name, force), (colour, style) in zip(forces_.items(), looks, strict=False):
            panel.plot(driven / length, force / factor, style, color=colour, markersize=3, label=name)
            for k in subsampled(len(driven), 8)[:-1]:
                ends = [(driven[j] / length, force[j] / factor) for j in (k, min(k + 1, len(driven) - 1))]
                panel.annotate("", ends[1], ends[0], arrowprops={"arrowstyle": "->", "color": colour})
        if len(forces_) > 1:
            _legend(panel)
        panel.set(xlabel=f"{what} along {'xyz'[axis]}, {length_unit}", ylabel=f"{label}, {unit}")
    return _svg(figure, f"Contact force against {what}")


def torque(run: Run) -> str:
    """For a load history: torque of the contact on each rotating foundation against its angle, and power against time;
    empty if none rotates."""
    faces = [name[: -len("_torque")] for name in run.rows[0] if name.endswith("_torque")]
    if not faces:
        return ""
    figure, (left, right) = _figure(2)
    for panel, name, against, what, si in (
        (left, "torque", "angle", "torque on the foundation", "N m"),
        (right, "power", None, "power on the foundation", "W"),
    ):
        columns = [np.asarray(_column(run.rows, f"{face}_{name}"), dtype=float) for face in faces]
        curves = [_exact(column, run.accuracy.get(si, 0.0)) for column in columns]
        factor, unit = scale_of(float(np.max(np.abs(np.nan_to_num(curves)))), si)
        for face, curve, colour in zip(faces, curves, (_FIRST, _SECOND, _THIRD, _FOURTH), strict=False):
            along = _column(run.rows, f"{face}_{against}" if against else "time")
            panel.plot(along, curve / factor, "o-", color=colour, markersize=3, label=face)
        panel.set(xlabel="angle, rad" if against else "time, s", ylabel=f"{what}, {unit}")
        if len(faces) > 1:
            _legend(panel)
    return _svg(figure, "Torque of the contact against the angle, and power against time")


def _drive(run: Run) -> tuple[Any, str]:
    """The largest motion in a history at every step, (steps, 3), and its source: a prescribed displacement or the
    foundation."""
    driven_by: list[tuple[Any, str]] = []
    body = run.steps[0].grid("solution")
    if "held" in body.fields and "prescribed" in body.fields:
        held = np.any(body.fields["held"] > 0.0, axis=1)
        others = (step.grid("solution") for step in run.steps)
        table = np.stack([other.fields["prescribed"][nodes_of(body, other)[held]] for other in others])
        driven = np.any(np.ptp(table, axis=0) > 0.0, axis=1)
        if driven.any():
            driven_by.append((table[:, driven].mean(axis=1), "prescribed displacement"))
    given = (run.case or {}).get("contact") or {}
    for motion in (contact.get("motion") for contact in (given if isinstance(given, list) else [given])):
        if not motion:
            continue
        moved = values_in_time(motion, [step.time or 0.0 for step in run.steps])
        driven_by.append((moved, "displacement of the foundation"))
    driven_by = [entry for entry in driven_by if np.any(np.ptp(entry[0], axis=0) > 0.0)]
    return max(driven_by, key=lambda entry: float(np.max(np.ptp(entry[0], axis=0))), default=(None, ""))


def meshes(run: Run) -> str:
    """Totals on the meshes that error bars compare, over those of the run, with their bars; empty without them."""
    bars = (run.summary.get("error") or {}).get("bars", ())
    wanted = ("normal_force", "strain_energy", "greatest_slip", "maximum.displacement")
    shown = [bar for bar in bars if bar["quantity"].endswith(wanted) and bar["value"] and bar["error"] is not None]
    if not shown:
        return ""
    figure, (axis,) = _figure(1)
    unknowns = [mesh["unknowns"] for mesh in run.summary["error"]["meshes"]]
    for bar, (colour, style) in zip(shown, _CURVES, strict=False):
        size, label = bar["value"], bar["quantity"].removeprefix("totals.").replace("_", " ")
        axis.plot(unknowns, [one / size for one in bar["on_meshes"]], style, color=colour, markersize=4, label=label)
        axis.errorbar(unknowns[0], 1.0, abs(bar["error"] / size), color=colour, capsize=4)
    axis.set(xlabel="displacement unknowns", ylabel="over that of this run", xscale="log")
    _legend(axis)
    return _svg(figure, "Totals on several meshes, with error bars")


def sensitivities(run: Run) -> str:
    """What 1 % more of each input does to the forces of the first two contacts, and to the first totals beside these,
    largest on top; empty without them."""
    entries = run.summary.get("sensitivity") or ()
    panels: list[tuple[str, str, dict[str, list[float]], tuple[str, ...]]] = []
    names = ("normal force", "friction force")
    for face in list(entries[0]["totals"])[:2] if entries else ():
        changes = {
            one["input"]: [0.01 * one["totals"][face][name.replace(" ", "_")] for name in names] for one in entries
        }
        panels.append((face, "N", changes, names))
    for words, unit, found in islice(other_totals(run.summary), _PANELS):
        lengths = {given: [change[0] if len(change) == 1 else math.hypot(*change)] for given, change in found.items()}
        panels.append((words, unit, lengths, ("",)))
    if not panels:
        return ""
    figure, axes = _figure(len(panels))
    for axis, (words, unit, changes, labels) in zip(axes, panels, strict=True):
        shown = sorted(changes, key=lambda name: np.hypot.reduce(changes[name]))[-_INPUTS:]
        factor, prefixed = scale_of(max(np.abs(changes[name]).max() for name in shown), unit)
        height = 0.72 / len(labels)
        for k, (label, colour) in enumerate(zip(labels, (_FIRST, _SECOND), strict=False)):
            places = np.arange(len(shown)) + height * (0.5 * (len(labels) - 1) - k)
            axis.barh(places, [changes[name][k] / factor for name in shown], height, color=colour, label=label)
        axis.set_yticks(range(len(shown)), shown)
        of, quoted, name = words.partition(" '")
        axis.set(xlabel=f"{of}\n'{name}, {prefixed}" if quoted else f"{words}, {prefixed}")
        if len(labels) > 1:
            axis.legend(loc="lower right", frameon=False, fontsize=8)  # where bars are short
    return _svg(figure, "What 1 % more of each input does")


_PANELS: Final = 4
"""Totals beside forces in it."""

_INPUTS: Final = 8
"""Inputs in a chart."""


def effort(run: Run) -> str:
    """For a load history: steps of the solver and residual per load step."""
    figure, (left, right) = _figure(2)
    number = _column(run.rows, "step")
    left.bar(number, _column(run.rows, "path_following"), color=_FIRST, width=0.7)
    left.set(xlabel="load step", ylabel="steps of the solver")
    _logarithmic(right, number, _column(run.rows, "residual"), "o", _FIRST, 4.0)
    right.set(xlabel="load step", ylabel="residual at the end of the step")
    _decades(right, "residual 0 in every step")
    _whole(left.xaxis, left.yaxis, right.xaxis)
    return _svg(figure, "Path-following steps and residuals by load step")


_ACROSS: Final = 64
"""Characters of a legend that are as wide as its panel."""


def _legend(axis: Any) -> None:
    """Place the legend above the axes, if there is a line with a label."""
    labels = axis.get_legend_handles_labels()[1]
    if not labels:
        return
    shape = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": _columns(labels), "borderaxespad": 0.2}
    axis.legend(frameon=False, labelcolor=_INK, fontsize=8.5, columnspacing=1.2, **shape)


def _columns(labels: Sequence[str]) -> int:
    return max(1, min(4, _ACROSS // (max(len(label) for label in labels) + 6)))


def _logarithmic(axis: Any, x: Any, y: Any, style: str, colour: str, size: float, label: str = "") -> None:
    """A line on a logarithmic axis, without the values that are not positive; none if no value is."""
    if np.any(y > 0.0):
        axis.semilogy(x, np.where(y > 0.0, y, np.nan), style, color=colour, markersize=size, label=label)
        axis.yaxis.set_minor_locator(NullLocator())


def _decades(axis: Any, empty: str) -> None:
    """A logarithmic axis between powers of ten, so that it has labelled ticks; without a line a text in its place."""
    if axis.get_yscale() != "log":
        _say(axis, empty)
        return
    low, high = axis.get_ylim()
    axis.set_ylim(10.0 ** np.floor(np.log10(low)), 10.0 ** np.ceil(np.log10(high)))


def _say(axis: Any, text: str) -> None:
    """A text in place of lines."""
    axis.text(0.5, 0.5, text, transform=axis.transAxes, ha="center", va="center", color=_INK)
    axis.set_yticks([])


def _whole(*axes: Any) -> None:
    """Ticks at integers only."""
    for axis in axes:
        axis.get_major_locator().set_params(integer=True)


def _column(rows: Rows, name: str, least: float = 0.0) -> Any:
    return _exact(np.array([row.get(name, np.nan) for row in rows]), least)


def _exact(values: Any, least: float) -> Any:
    """Values, of which those up to `least` are rounding errors of the answer and become 0."""
    return np.where(np.abs(values) <= least, 0.0, values)


def _figure(count: int) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    colours = dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), _INK)
    with matplotlib.rc_context({**colours, "font.size": 9.5}):
        figure = Figure(figsize=(4.3 * count, 3.3), facecolor="none", layout="constrained")
        figure.get_layout_engine().set(w_pad=0.1, h_pad=0.1)
        axes = [part.subplots() for part in figure.subfigures(1, count, squeeze=False)[0]]
    for axis in axes:
        axis.set_facecolor("none")
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(alpha=0.25, color=_INK, linewidth=0.6)
        axis.set_axisbelow(True)
    return figure, axes


_CALM: Final = 0.1
"""Least height of an axis over the largest number on it: a change of 0.03 % is not drawn as a collapse."""


def _calm(axis: Any) -> None:
    """Full numbers at the ticks of a linear axis, without offset, which spans at least `_CALM` of them."""
    if axis.get_yscale() == "linear":
        low, high = axis.get_ylim()
        missing = 0.5 * (_CALM * max(abs(low), abs(high)) - (high - low))
        if missing > 0.0:
            axis.set_ylim(low - missing, high + missing)
        with contextlib.suppress(AttributeError):  # of another formatter
            axis.yaxis.get_major_formatter().set_useOffset(False)


def _svg(figure: Any, title: str) -> str:
    """A figure as scalable elements of the page, one for each panel, which narrow screens put below each other; without
    links and background, in the text's colour."""
    for axis in figure.axes:
        _calm(axis)
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": title}):
        file = io.StringIO()
        figure.savefig(file, format="svg", transparent=True)
    drawn = file.getvalue()
    drawn = drawn[drawn.index(">", drawn.index("<svg")) + 1 : drawn.rindex("</svg>")]
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)
    drawn = drawn.replace("xlink:href", "href").replace(_INK, "currentColor")
    width, height = 72.0 * figure.get_size_inches()
    panels, name = len(figure.subfigs), title.replace(" ", "-")
    wide = width / panels
    first = f'<svg role="img" aria-label="{title}" viewBox="0 0 {wide:g} {height:g}"><g id="{name}">{drawn}</g></svg>'
    others = [
        f'<svg aria-hidden="true" viewBox="{k * wide:g} 0 {wide:g} {height:g}"><use href="#{name}"/></svg>'
        for k in range(1, panels)
    ]
    return first + "".join(others)


def subsampled(count: int, most: int) -> IntArray:
    """At most `most` of `count` numbers, evenly spaced."""
    return np.arange(0, count, max(1, -(-count // most)))
