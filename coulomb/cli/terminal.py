"""Output of a run on the terminal, on rank 0."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console

from ..arrays import FloatArray
from ..case.case import Case
from ..case.contact import ContactTable, RotationTable
from ..case.curves import rows_of, values_at
from ..case.loads import (
    PointLoadTable,
    PrescribedDisplacementTable,
    PrescribedRotationTable,
    PressureTable,
    TotalForceTable,
    TractionTable,
)
from ..case.ties import PretensionTable
from ..contact_fields import named_faces, normal_forces
from ..fem.bodies import Member
from ..fem.contact import FoundPair
from ..fem.geometry import tangent_lengths
from ..fem.meshes import corner_geometry
from ..io.accuracy import accuracy
from ..io.run_directory import PICTURE
from ..linalg.reductions import Reductions
from ..model.input_echo import contacts_of, loads_of, ties_of
from ..model.problem import ContactProblem
from ..model.solution import Solution
from ..pictures.report.words import (
    bars_in_words,
    compared_in_words,
    contact_in_words,
    friction_in_words,
    in_few,
    lengths_in_words,
    other_totals,
    share_of_tolerance,
    tie_in_words,
)
from ..process import animated
from ..solvers.results import Progress, Status
from ..units import number, plain, quantity, vector
from .console import bad_input, errors


def introduce(console: Console, case: Path, problem: ContactProblem) -> None:
    unknowns = problem.unknowns
    surface, over = problem.surface, Reductions(problem.comm)
    law = plain(friction_in_words(problem.law.numbers(surface.area, tangent_lengths(surface.frames), over)))
    console.out(
        f"{case}: {unknowns['displacement']} displacement and {unknowns['contact']} contact unknowns, {law}, "
        f"{problem.comm.size} {'rank' if problem.comm.size == 1 else 'ranks'}\n"
        + "\n".join([body_in_words(problem), *problem.body.chosen])
    )


def body_in_words(problem: ContactProblem) -> str:
    """Size of every body and its mesh, which shows a forgotten scale; collective."""
    over = Reductions(problem.comm)

    def line(member: Member) -> str:
        body, domain = member.body, member.body.domain
        lengths = [over.max(body.x[:, k]) - over.min(body.x[:, k]) for k in range(3)]
        cells, nodes = domain.topology.index_map(3).size_global, body.numbering.total
        kind = "hexahedra" if corner_geometry(domain).shape[1] == 8 else "tetrahedra"
        if body.degree == 2:
            kind = f"{body.V.dofmap.dof_layout.num_dofs}-node {kind}"
        name = f" {member.name!r}" if member.name else ""
        size = " x ".join(plain(quantity(length, "m")) for length in lengths)
        of = body.mesh.slice
        what = "" if of is None else f"; {of.kind}, forces are for {plain(of.said)}"
        return f"{'body':<8}{name} {size}; {cells} {kind}, {nodes} nodes{what}"

    return "\n".join(map(line, problem.elasticity.members))


def about(seconds: float) -> str:
    """Seconds, minutes or hours, to two digits."""
    size, unit = next((pair for pair in ((1.0, "s"), (60.0, "min")) if seconds < 99.5 * pair[0]), (3600.0, "h"))
    value = seconds / size
    return f"{value:.0f} {unit}" if value >= 9.95 or unit == "s" else f"{value:.1f} {unit}"


# --- the input ----------------------------------------------------------------------------------------------------

_LINES: Final = 5
"""Lines of loads, of supports, and of contact pairs; the summary has all."""


def show_input(console: Console, settings: Case, problem: ContactProblem) -> None:
    """Print a line per load, support and contact pair, as they were understood; collective."""
    history = settings.history
    times = [problem.time] if history is None else [float(time) for time in history.ends]
    with bad_input():
        loads = loads_of(problem, times)
    _print(
        console,
        "load",
        [
            f"{load.what}{'' if history is None else f', largest at {load.time:g} s'}: force "
            + plain(f"{vector(load.force, 'N')}, moment about the origin {vector(load.moment, 'N m')}")
            for load in loads
        ],
    )
    heat = problem.body.heat
    _print(console, "heat", [] if heat is None else [load.title for load in heat.conduction.loads])
    supports = problem.elasticity.support_entries()
    _print(console, "support", [f"{one['kind']} on {one['face']!r}: {one['holds']}" for one in supports])
    _print(console, "found", [found_in_words(*one) for one in settings.found], len(settings.found))
    contacts = [f"{one['face']!r}: {plain(contact_in_words(one))}" for one in contacts_of(problem)]
    _print(console, "contact", contacts)
    _print(console, "tied", [": ".join(map(plain, tie_in_words(one))) for one in ties_of(problem)])


def found_in_words(table: ContactTable, pair: FoundPair) -> str:
    """A contact that auto_contact has found, with its area and gap."""
    low, high = pair.gap
    return (
        f"{table.face!r} against {table.against!r}: {plain(quantity(pair.area, 'm²', 3))} face each other, "
        f"gap {plain(lengths_in_words({'min': low, 'max': high}))}"
    )


def _print(console: Console, what: str, lines: Sequence[str], most: int = _LINES) -> None:
    for line in lines[:most]:
        console.out(f"{what:<8} {line}")
    if len(lines) > most:
        console.out(f"{what:<8} and {len(lines) - most} more, in summary.json")


# --- progress -----------------------------------------------------------------------------------------------------


class Display:
    """Progress: one line that changes on a terminal, elsewhere a line for each Tresca problem (or path-following step)
    but for load steps and other meshes, of which there is that line alone (`changing`)."""

    def __init__(self, console: Console, changing: bool = False):
        self._console, self._changing, self._expected = console, changing, ""
        self._status = console.status("K^-1 and A") if animated() and not console.quiet else None
        self._last: Progress | None = None

    def __enter__(self) -> Display:
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()
        self._line()

    def __call__(self, progress: Progress) -> None:
        if self._status is not None:
            self._status.update(f"{progress}{'  ' if self._expected else ''}{self._expected}")
        if self._last is not None and (progress.outer != self._last.outer or progress.outer == 0):
            self._line()
        self._last = progress

    def expect(self, text: str) -> None:
        """Set a text that follows in the changing line."""
        self._expected = text

    def _line(self) -> None:
        if self._last is not None and self._status is None and not self._changing:
            self._console.out(str(self._last))


def report(
    console: Console,
    solution: Solution,
    contents: dict[str, Any],
    target: Path | None,
    kept: str,
    total: float,
    tolerance: float,
) -> None:
    """Print the last lines of a run; numbers below the accuracy that the tolerance of its solver gives as 0.  `kept` is
    the directory of the results before, if there were any."""
    iterations, nodes, least = contents["iterations"], contents["nodes"], accuracy(contents, tolerance)
    shown, forces = partial(quantity, accuracy=least), partial(vector, unit="N", digits=6, accuracy=least)
    pressure, slip = contents["maximum"]["contact_pressure"], contents["totals"]["greatest_slip"]
    outer = f"{iterations['outer']} Tresca problems, " if iterations["outer"] else ""
    rate = contents["contraction"]
    contraction = f", contraction {rate:.2g}" if rate is not None and np.isfinite(rate) else ""
    seconds = ", ".join(f"{name} {value:.2f}" for name, value in contents["seconds"].items() if name != "total")
    each = [f"{body['name']} {forces(body['contact_force'])}" for body in contents.get("bodies", ())]
    on_body = ", ".join(
        f"{f'{name}: ' if len(contents['faces']) > 1 else ''}normal {shown(face['normal_force'], 'N', 6)}, "
        f"friction {shown(face['friction_force'], 'N', 6)}"
        for name, face in named_faces(contents["faces"])
    )
    if each:
        on_body = f"contact force on {', '.join(each)}; {on_body}"
    elif (vector_of := contents.get("force_on_body")) is not None:  # not of components of one mesh in several pairs
        on_body = f"force on the body {forces(vector_of['vector'])}; {on_body}"
    lines = (
        f"{contents['status']} ({contents['method']['solver']}): residual {contents['residual']:.1e}, {outer}"
        f"{iterations['path_following']} path-following steps, {iterations['products']} products{contraction}",
        plain(on_body),
        f"contact nodes {nodes['contact']}: open {nodes['open']}, stick {nodes['stick']}, slip {nodes['slip']}; "
        + plain(f"largest pressure {shown(pressure, 'Pa')}, largest slip {shown(slip, 'm')}"),
        str(solution.certificate),
        f"seconds: {seconds}; {total:.2f} in all",
    )
    if solution.result.status is Status.NO_EQUILIBRIUM:  # forces, certificate and strains would be those of no answer
        for line in (contents["message"], "certificate FAILED: there is no answer to judge", lines[-1]):
            console.out(line)
    else:
        for number, line in enumerate(lines):
            if number == 3:
                show_error_bars(console, contents, tolerance)
                show_sensitivity(console, contents)
            console.out(line)
        strain = solution.small_strain
        warn(*contents["remarks"], *(strain.mere_warnings if solution.outside else strain.warnings))
        refuse(solution.outside)
    picture = contents.get("picture", "")
    if "could not" in picture:
        errors.out(f"warning: {PICTURE} {picture}")
    if target is not None:
        console.out(f"results in {target}{os.sep}{_before(kept)}")


def _before(kept: str) -> str:
    return f", those before in {kept}{os.sep}" if kept else ""


def show_error_bars(console: Console, contents: dict[str, Any], tolerance: float) -> None:
    """Print totals with their error bars, if the summary has them, and whether the tolerance of the solver leaves more
    than a hundredth of one."""
    rows = [(name, plain(shown)) for name, shown, _ in bars_in_words(contents)]
    if rows:
        console.out(f"error bars of the mesh, from {compared_in_words(contents)}:")
    for name, shown in rows[:_LINES]:
        console.out(f"  {name:<30} {shown}")
    if len(rows) > _LINES:
        console.out(f"  and {len(rows) - _LINES} more, in summary.json")
    share, total = share_of_tolerance(contents) or (0.0, "")
    if share > 0.01:
        part = f"{100.0 * share:.2g} % of the error bar of {total}"
        console.out(f"  the solver's tolerance {tolerance:g} leaves up to {part}: give a smaller one")
    warn(*(contents.get("error") or {}).get("warnings", ()))


_NOTHING: Final = 1e-8
"""Change of a force over the largest, or over the force, that is an error of the derivatives."""


def show_sensitivity(console: Console, contents: dict[str, Any]) -> None:
    """Print what 1 % more of the inputs does to the forces of each contact, if the summary has it: the five that do
    most, and how far that is linear."""
    entries = contents.get("sensitivity") or []
    for place, reason in contents.get("without_bar", {}).items():
        errors.out(f"warning: output.sensitivity: no bar has the tolerance of {place}, without derivatives: {reason}")
    width = max(map(len, ("with the tolerances given", *(entry["input"] for entry in entries))))
    for face in entries[0]["totals"] if entries else ():
        totals = [(entry, entry["totals"][face]) for entry in entries]
        totals.sort(key=lambda row: -np.hypot(row[1]["normal_force"], row[1]["friction_force"]))
        forces = [dict(named_faces(contents["faces"]))[face], *(row for _, row in totals)]
        least = {"N": _NOTHING * max(np.hypot(one["normal_force"], one["friction_force"]) for one in forces)}
        console.out(f"1 % more of an input does to the forces of {face!r} (to first order, and up to where):")
        for one, total in totals[:_LINES]:
            step = "any change" if one["step"] is None else f"up to {plain(number(100.0 * one['step'], 2))} %"
            if one["border"]:
                step += f", {one['border']} contact points on the border of two states"
            console.out(f"  {one['input']:<{width}} {_both(total, 0.01, least)} {step}")
            fallen = one.get("falling", one)["totals"][face]
            if one["border"] or fallen["friction_force"] != total["friction_force"]:
                console.out(f"  {'  1 % less':<{width}} {_both(one['falling']['totals'][face], -0.01, least)}".rstrip())
        if len(totals) > _LINES:
            console.out(f"  and {len(totals) - _LINES} more, in summary.json")
        if bars := contents.get("input_bars"):
            both = (plain(quantity(bars[face][name], "N", 2)) for name in ("normal_force", "friction_force"))
            normal, friction = (f"+- {value}" for value in both)
            console.out(f"  {'with the tolerances given':<{width}} normal {normal:<12} friction {friction}")
    for words, unit, changes in other_totals(contents):
        console.out(f"and to the {words}:")
        for given, change in list(changes.items())[:_LINES]:
            of_one = vector(change, unit) if len(change) > 1 else quantity(change[0], unit)
            console.out(f"  {given:<{width}} {plain(of_one)}")
    if tied := [repr(entry["input"]) for entry in entries if "falling" in entry and not entry["border"]]:
        console.out(f"tied largest values and sizes of 0 change otherwise as {in_few(tied)} falls: see summary.json")
    if condition := contents.get("sensitivity_condition"):
        console.out(f"condition of the equations of these: {condition['number']:.0e}")
    for one in entries:
        if "verified" in one:
            console.out(f"  {one['input']:<{width}} {one['verified']['words']}")


def _both(total: dict[str, float], part: float, least: dict[str, float]) -> str:
    """The change of the normal force and of the friction force of a contact by a part of an input, with its sign."""
    both = (part * total[name] for name in ("normal_force", "friction_force"))
    words = [plain(quantity(value, "N", accuracy=least)) for value in both]
    normal, friction = (word if word[0] in "-0" else f"+{word}" for word in words)
    return f"normal {normal:<12} friction {friction:<12}"


def forces_in_a_step(row: dict[str, Any], least: float) -> str:
    """The contact forces of a load step in words, from its line of history.csv, of the first contacts and bolts;
    magnitudes up to `least` newtons are printed as 0."""

    def force(value: float) -> str:
        return f"{plain(quantity(value, 'N', accuracy={'N': least})):<8}"

    rubbing = normal_forces(row, "friction_force")
    shown = [
        f"{f'{name}: ' if name else ''}normal {force(pressing)} friction {force(rubbing[name])}"
        for name, pressing in normal_forces(row).items()
    ]
    if "force_x" in row:
        of = vector([row[f"force_{axis}"] for axis in "xyz"], "N", accuracy={"N": least})
        shown.append(f"force {plain(of)}")
    begin, end = "bolt_", "_force"
    bolts = {name[len(begin) : -len(end)]: row[name] for name in row if name.startswith(begin) and name.endswith(end)}
    screwed = [f"bolt {face} {force(value)}" for face, value in bolts.items()]
    return "  ".join(in_few(some, sep="  ") for some in (shown, screwed) if some).rstrip()


def changes_in_words(case: Case, before: float, time: float) -> str:
    """What a load step from one time to another changes, with its value at the end: 'top' x 0.25 mm.  The force of a
    bolt is given until it is locked."""
    changed = []
    for key, (table, rows) in case.timed.items():
        lock = table.lock if isinstance(table, PretensionTable) and table.lock is not None else time
        start, end = (values_at(rows, min(at, lock)) for at in (before, time))
        if np.any(start != end):
            changed.append(_driven(key, table, end))
    return in_few(changed, 2)


def _driven(key: str, table: Any, times: FloatArray) -> str:
    """A load, support or motion of a case with its factor, or its translation, `at` a time."""

    def along(value: Any, unit: str, components: str = "xyz") -> str:
        if any(isinstance(one, str) for one in value):
            return f"times {times[0]:.4g}"
        part = [factor * one for factor, one in zip(np.resize(times, 3), value, strict=True)]
        named = [(axis, by) for axis, by, one in zip("xyz", part, value, strict=True) if axis in components and one]
        if len(named) == 1 and components != "normal":
            return f"{named[0][0]} {plain(quantity(named[0][1], unit))}"
        return plain(vector(part, unit))

    match table:
        case PrescribedRotationTable():
            return f"{table.face!r} turned {np.degrees(times[0] * table.angle):.4g} deg"
        case PrescribedDisplacementTable():
            return f"{table.face!r} {along(table.value, 'm', table.components)}"
        case TractionTable():
            return f"traction on {table.face!r} {along(table.value, 'Pa')}"
        case PressureTable() if not isinstance(table.value, str):
            return f"pressure on {table.face!r} {plain(quantity(times[0] * table.value, 'Pa'))}"
        case TotalForceTable():
            return f"force on {table.face!r} {along(table.force, 'N')}"
        case PointLoadTable():
            sizes = (("force", table.force, "N"), ("moment", table.moment, "N m"))
            return " and ".join(
                f"{name} on {table.face!r} {along(size, unit)}" for name, size, unit in sizes if any(size)
            )
        case PretensionTable() if table.force is not None:
            return f"bolt {table.face!r} {plain(quantity(times[0] * table.force, 'N'))}"
        case RotationTable():
            return f"foundation turned {np.degrees(times[0]):.4g} deg"
        case ContactTable() if table.motion and len(times) == 3:
            moving = np.any(np.array(rows_of(table.motion))[:, 1:], axis=0).astype(float)
            return f"foundation of {table.face!r} {along(moving, 'm')}"
    return f"{key.removesuffix('amplitude').strip('._')} times {times[0]:.4g}"


_ENERGIES: Final = {
    "loads": "loads",
    "prescribed": "prescribed displacements",
    "foundation": "foundation",
    "elastic": "elastic",
    "dissipated": "friction",
    "imbalance": "time-stepping error",
}
"""Entries of `energy` in the summary of a history, in words."""


def report_history(
    console: Console, history: dict[str, Any], taken: int, seconds: float, target: Path, kept: str, tolerance: float
) -> None:
    """Print the last lines of a load history: figures of all its steps, labelled as such.

    `history` is the entry of this name in its summary.  This run has `taken` steps in some seconds; the others existed
    before (`coulomb resume`); `kept` is the directory of earlier results.  Slip and energies are printed as 0 up to the
    tolerance of the solver.
    """
    done, largest = history["iterations"], history["maximum"]
    least = {**accuracy({}, tolerance, history), "J": tolerance * max(map(abs, history["energy"].values()))}
    shown = partial(quantity, accuracy=least)
    amounts = [plain(f"{name} {shown(history['energy'][key], 'J')}") for key, name in _ENERGIES.items()]
    pressure, slip, residual = largest["contact_pressure"], largest["slip_in_a_step"], history["residual"]
    before = f", {history['steps'] - taken} were there before" if taken < history["steps"] else ""
    lines = (
        plain(
            f"all {history['steps']} steps: largest pressure {shown(pressure['value'], 'Pa')} "
            f"(step {pressure['step']}), largest slip in one step {shown(slip['value'], 'm')} (step {slip['step']}); "
        )
        + f"{done['path_following']} path-following steps, {done['products']} products, "
        f"largest residual {_figure(residual['value'])} (step {residual['step']})",
        "energy since the start: " + ", ".join(amounts),
        *_error_of_steps(largest),
        f"{taken} steps in this run{before}, {seconds:.2f} seconds; results in {target}{os.sep}{_before(kept)}",
        _steps_that_count(history),
    )
    warn(*history["remarks"])
    refuse(history["violations"])
    for line in lines:
        console.out(line)


def _error_of_steps(largest: dict[str, Any]) -> tuple[str, ...]:
    """The line on the estimated error of friction by the size of the steps, where it was asked for."""
    if "friction_error" not in largest:
        return ()
    size, step = (largest["friction_error"][name] for name in ("value", "step"))
    return (f"friction is known to {size:.1%} of all friction forces, by the size of the load steps (step {step})",)


def _steps_that_count(history: dict[str, Any]) -> str:
    certified, outside = history["certified_steps"], history["outside"]
    many = f"all {certified}" if certified == history["steps"] else f"{certified} of {history['steps']}"
    beyond = f", {outside['steps']} outside the theory" if outside is not None else ""
    known = history["certificate"].get("resolution", {"resolved": True})
    only = "" if known["resolved"] else f", contact forces of step {known['step']} known to {known['value']:.1e} only"
    return f"{many} load steps certified{beyond}{only}"


def _figure(value: float | None) -> str:
    """A residual; None, which files have for nan, as nan."""
    return "nan" if value is None else f"{value:.1e}"


def warn(*texts: str) -> None:
    for text in texts:
        errors.out(f"warning: {text}")


def refuse(outside: Sequence[str]) -> None:
    """Print why an answer does not count although its equations are solved."""
    if outside:
        errors.out(
            f"error: outside the theory: {'; '.join(outside)}; the results are kept and marked; check "
            'units, loads and foundation, or accept it by small_strain = "warn" in the case, or --force'
        )
