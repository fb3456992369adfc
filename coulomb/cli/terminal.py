"""Output of a run on the terminal, on rank 0."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console

from ..arrays import FloatArray
from ..case.case import Case
from ..case.contact import ContactTable
from ..contact_fields import named_faces, normal_forces
from ..fem.bodies import Member
from ..fem.contact import FoundPair
from ..fem.geometry import tangent_lengths
from ..fem.meshes import corner_geometry
from ..io.accuracy import accuracy, rounded
from ..io.run_directory import PICTURE
from ..linalg.reductions import Reductions
from ..model.input_echo import contacts_of, loads_of, supports_of, ties_of
from ..model.problem import ContactProblem
from ..model.solution import Solution
from ..pictures.report.units import (
    NARROW,
    bars_in_words,
    compared_in_words,
    friction_in_words,
    scale_of,
    share_of_tolerance,
)
from ..process import animated
from ..solvers.results import Progress
from .console import bad_input, errors


def introduce(console: Console, case: Path, problem: ContactProblem) -> None:
    unknowns = problem.unknowns
    surface, over = problem.surface, Reductions(problem.comm)
    law = law_in_words(problem.law.numbers(surface.area, tangent_lengths(surface.frames), over))
    console.out(
        f"{case}: {unknowns['displacement']} displacement and {unknowns['contact']} contact unknowns, {law}, "
        f"{problem.comm.size} {'rank' if problem.comm.size == 1 else 'ranks'}\n"
        + "\n".join([body_in_words(problem), *problem.body.chosen])
    )


def law_in_words(numbers: dict[str, Any]) -> str:
    """The law of friction with its coefficients, from its numbers: Mohr-Coulomb friction 0.3, cohesion 2e+06 Pa."""
    return friction_in_words(
        numbers, lambda given, unit: f"{' to '.join(f'{value:g}' for value in given)} {unit}".strip()
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
        return f"body{name} {' x '.join(map(metres, lengths))}; {cells} {kind}, {nodes} nodes"

    return "\n".join(map(line, problem.elasticity.members))


def metres(length: float) -> str:
    """A length in a suitable unit: 3 m, 40 mm, 2.5 km."""
    factor, unit = scale_of(length, "m")
    return f"{length / factor:.4g} {unit.replace('µ', 'u')}"


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
            f"{load.what}{'' if history is None else f', largest at {load.time:g} s'}: force {_vector(load.force)} N, "
            f"moment about the origin {_vector(load.moment)} N m"
            for load in loads
        ],
    )
    heat = problem.body.heat
    _print(console, "heat", [] if heat is None else [load.title for load in heat.conduction.loads])
    _print(console, "support", [f"{one['kind']} on {one['face']!r}: {one['holds']}" for one in supports_of(problem)])
    _print(console, "found", [found_in_words(*one) for one in settings.found], len(settings.found))
    _print(console, "contact", [contact_in_words(one) for one in contacts_of(problem)])
    ties = ties_of(problem)
    words = [
        f"{one['kind']} of {one['face']!r} to {one['against']!r}: {one['nodes']} nodes, {one['area']:.4g} m^2"
        if one["area"]
        else f"{one['kind']} {one['face']!r}: {one['nodes']} nodes"
        for one in ties
    ]
    _print(console, "tied", words)


def found_in_words(table: ContactTable, pair: FoundPair) -> str:
    """A contact that auto_contact has found, with its area and gap."""
    low, high = pair.gap
    return (
        f"{table.face!r} against {table.against!r}: {pair.area:.3g} m^2 face each other, "
        f"gap {_range({'min': low, 'max': high})}"
    )


def contact_in_words(one: dict[str, Any]) -> str:
    """A contact pair from `contacts_of`."""
    gap, given = _range(one["gap"]), ""
    if any(one["given_gap"].values()):
        times = " times its amplitude" if "gap amplitude" in one["moves"] else ""
        given = f", of which given {_range(one['given_gap'])}{times}"
    moves = f", moves by {one['moves']}" if one["moves"] else ""
    return f"{one['face']!r}: {one['nodes']} nodes, {law_in_words(one)}, gap {gap}{given}; {one['foundation']}{moves}"


def _range(values: dict[str, float]) -> str:
    """In metres, one number if all are the same."""
    low, high = values["min"], values["max"]
    return metres(low) if high - low <= 1e-9 * max(abs(low), abs(high)) else f"{metres(low)} to {metres(high)}"


def _print(console: Console, what: str, lines: Sequence[str], most: int = _LINES) -> None:
    for line in lines[:most]:
        console.out(f"{what:<8} {line}")
    if len(lines) > most:
        console.out(f"{what:<8} and {len(lines) - most} more, in summary.json")


def _vector(values: FloatArray) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"


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
    iterations, nodes, least = contents["iterations"], contents["nodes"], accuracy(contents, tolerance)["N"]
    outer = f"{iterations['outer']} Tresca problems, " if iterations["outer"] else ""
    rate = contents["contraction"]
    contraction = f", contraction {rate:.2g}" if rate is not None and np.isfinite(rate) else ""
    seconds = ", ".join(f"{name} {value:.2f}" for name, value in contents["seconds"].items() if name != "total")
    each = [f"{body['name']} ({_forces(body['contact_force'], least)})" for body in contents.get("bodies", ())]
    pressing = [f"{name} {_forces([face['normal_force']], least)}" for name, face in named_faces(contents["faces"])]
    on_body = f"normal force in N of {', '.join(pressing)}"
    if each:
        on_body = f"contact force in N on {', '.join(each)}; {on_body}"
    elif (force := contents.get("force_on_body")) is not None:  # not of components of one mesh in several pairs
        on_body = f"force on the body ({_forces(force['vector'], least)}) N; {on_body}"
        if "normal" in force:
            normal, tangential = _forces([force["normal"]], least), _forces(force["tangential"], least)
            on_body = f"force on the body: normal {normal} N, tangential ({tangential}) N"
    lines = (
        f"{contents['status']} ({contents['method']['solver']}): residual {contents['residual']:.1e}, {outer}"
        f"{iterations['path_following']} path-following steps, {iterations['products']} products{contraction}",
        on_body,
        f"contact nodes {nodes['contact']}: open {nodes['open']}, stick {nodes['stick']}, slip {nodes['slip']}; "
        f"largest pressure {contents['maximum']['contact_pressure']:.6g} Pa",
        str(solution.certificate),
        f"seconds: {seconds}; {total:.2f} in all",
    )
    for number, line in enumerate(lines):
        if number == 3:
            show_error_bars(console, contents, tolerance)
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
    plain = str.maketrans(f"{NARROW}−µ⁻⁰¹²³⁴⁵⁶⁷⁸⁹", " -u-0123456789") | str.maketrans({"±": "+-"})
    rows = [
        (name, shown.replace("m²", "m^2").replace("×10", "e").translate(plain))
        for name, shown, _ in bars_in_words(contents)
    ]
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


def forces_in_a_step(row: dict[str, Any], least: float) -> str:
    """The contact forces of a load step in words, from its line of history.csv: of several faces or pairs those of
    each, since their sum has a meaning on one body only.  Magnitudes up to `least` newtons are printed as 0."""
    on_body = rounded((row[f"force_{axis}"] for axis in "xyz" if f"force_{axis}" in row), least)
    force = f", force ({', '.join(f'{component:.6g}' for component in on_body)}) N" if on_body else ""
    pressing = normal_forces(row)
    values = rounded(pressing.values(), least)
    each = [f"{name} {value:.6g} N".lstrip() for name, value in zip(pressing, values, strict=True)]
    begin, end = "bolt_", "_force"
    bolts = {name[len(begin) : -len(end)]: row[name] for name in row if name.startswith(begin) and name.endswith(end)}
    screwed = "".join(f"; bolt {face} {value:.6g} N" for face, value in bolts.items())
    return f"normal {', '.join(each)}{force}{screwed}"


def _forces(values: Sequence[float], least: float) -> str:
    return ", ".join(f"{value:.9g}" for value in rounded(values, least))


def report_history(
    console: Console, history: dict[str, Any], taken: int, seconds: float, target: Path, kept: str, tolerance: float
) -> None:
    """Print the last lines of a load history: figures of all its steps, labelled as such.

    `history` is the entry of this name in its summary.  This run has `taken` steps in some seconds; the others existed
    before (`coulomb resume`); `kept` is the directory of earlier results.  Slip and energies are printed as 0 up to the
    tolerance of the solver.
    """
    done, largest = history["iterations"], history["maximum"]
    least = tolerance * max(map(abs, history["energy"].values()))
    energy = dict(zip(history["energy"], rounded(history["energy"].values(), least), strict=True))
    pressure, slip, residual = largest["contact_pressure"], largest["slip_in_a_step"], history["residual"]
    (slid,) = rounded([slip["value"]], accuracy({}, tolerance, history)["m"])
    before = f", {history['steps'] - taken} were there before" if taken < history["steps"] else ""
    lines = (
        f"all {history['steps']} steps: largest pressure {pressure['value']:.6g} Pa (step {pressure['step']}), "
        f"largest slip in one step {slid:.6g} m (step {slip['step']}); "
        f"{done['path_following']} path-following steps, {done['products']} products, "
        f"largest residual {_figure(residual['value'])} (step {residual['step']})",
        f"energy in J since the start: loads {energy['loads']:.6g}, prescribed displacements "
        f"{energy['prescribed']:.6g}, foundation {energy['foundation']:.6g}; elastic {energy['elastic']:.6g}, friction "
        f"{energy['dissipated']:.6g}, time-stepping error {energy['imbalance']:.2g}",
        f"{taken} steps in this run{before}, {seconds:.2f} seconds; results in {target}{os.sep}{_before(kept)}",
        _steps_that_count(history),
    )
    warn(*history["remarks"])
    refuse(history["violations"])
    for line in lines:
        console.out(line)


def _steps_that_count(history: dict[str, Any]) -> str:
    certified, outside = history["certified_steps"], history["outside"]
    many = f"all {certified}" if certified == history["steps"] else f"{certified} of {history['steps']}"
    beyond = f", {outside['steps']} outside the theory" if outside is not None else ""
    return f"{many} load steps certified{beyond}"


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
