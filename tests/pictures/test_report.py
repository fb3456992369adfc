"""The report of a run: its contents, their labels, and that it is self-contained."""

import csv
import json
import platform
import re
import shutil
import subprocess
import sys
import tomllib
import warnings
from dataclasses import replace
from datetime import datetime

import markupsafe
import numpy as np
import pytest
from conftest import ROOT, run_coulomb, solved_block
from matplotlib.axes import Axes
from report_pages import data_of, numbers, page_of, page_without_pictures, words_of

import coulomb
from coulomb.case.values import field
from coulomb.cli.terminal import _steps_that_count
from coulomb.io import output
from coulomb.io.history_files import whole
from coulomb.pictures.report import charts, results
from coulomb.pictures.report.fields import named
from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.problem import case_as_text, in_time, supports, values_in_time
from coulomb.pictures.report.words import contact_in_words, in_few, tie_in_words
from coulomb.units import number, quantity, scale_of, vector
from coulomb.version import __version__

APART = """
mesh = { box = [1, 1, 1], cells = [2, 2, 2] }
material = { young = 1e9, poisson = 0.3 }
clamp = [{ face = "top" }]
contact = { face = "bottom", friction = 0.3, foundation = { point = [0, 0, -0.1], normal = [0, 0, 1] } }
[output]
picture = false
"""
"""A block 0.1 m above its foundation."""


def test_page_needs_nothing_else(block, failed, history):
    for directory in (block, failed, history):
        text = page_of(directory)
        assert "://" not in text  # no address of anything, not even of a namespace
        assert not re.findall(r'(?:src|href|action)="(?!data:|#)[^"]*"', text) and "@import" not in text
        assert "default-src 'none'" in text  # the browser would not load it either
        (run,) = read_run(directory).made
        rest = text.replace(str(markupsafe.escape(run["command"])), "")
        assert len(rest) < len(text)  # the command is shown as typed; nothing else names places of this machine
        assert str(directory.parent) not in rest and str(ROOT) not in rest
        assert 50_000 < len(text) < 3_000_000


def test_page_shows_the_problem(block):
    words, contents = words_of(block), json.loads((block / "summary.json").read_text())
    conditions = sum(isinstance(check, dict) for check in contents["certificate"].values())
    assert f"Certified All {conditions} conditions hold" in words and "NOT CERTIFIED" not in words
    for part in (
        "3 m × 1 m × 1 m",
        "192 hexahedra, 325 nodes",
        "cells = [12, 4, 4]",
        "Young's modulus 211.9 GPa, Poisson's ratio 0.277",
        "traction on top (0, 30, −120) MN",
        'face = "top" value = [0.0, 1e+07, -4e+07]',
        "Coulomb friction 0.3",
        f"normal force {contents['force_on_body']['normal'] / 1e6:.6g} MN",
        f"largest pressure {contents['maximum']['contact_pressure'] / 1e6:.4g} MPa",
        f"products by A {contents['iterations']['products']}",
        f"PETSc {contents['versions']['PETSc']}",
        "clamps prescribed displacements held 0 1×10⁻⁶ ✓ ok",
    ):
        assert part in words, part
    assert page_of(block).count("<figure>") == 8 and page_of(block).count("data:image/png") == 8
    assert "von Mises stress" in words.partition("tension is positive")[2] and "stress xy" in words


def test_a_run_that_failed_is_red(failed):
    text, words = page_of(failed), words_of(failed)
    contents = json.loads((failed / "summary.json").read_text())
    assert '<header class="failed">' in text and "<title>block: NOT CERTIFIED</title>" in text
    assert "are not a solution" in words and "Solver: max iterations" in words
    assert "Successive Tresca ended with a residual of" in words  # the message of the solver
    bad = [name for name, check in contents["certificate"].items() if isinstance(check, dict) and not check["passed"]]
    conditions = sum(isinstance(check, dict) for check in contents["certificate"].values())
    assert f"{len(bad)} of {conditions} conditions fail" in words and words.count("✗ failed") == len(bad) > 3
    assert "Tresca problems 3" in words


def test_page_of_a_history(history):
    text, words = page_of(history), words_of(history)
    assert "6 load steps to time 6 s" in words and "All 6 steps" in words
    assert "x = 2 mm, factor 0 at 1 s, 1 at 2 s, −1 at 4 s, 1 at 6 s" in words
    assert text.count('<svg role="img"') == 6  # force, hysteresis, surface, reactions, effort, convergence
    summary = json.loads((history / "summary.json").read_text())["last"]
    for part in summary["reactions"]:
        said = f"{part['kind'].replace('_', ' ')} on {part['face']} {vector(part['force'], 'N', 5)}"
        assert said.replace("\u202f", " ") in words
    assert f"left over, relative to the largest force {number(summary['balance'], 2)}" in words
    assert words.count("passed") == 6
    data = data_of(history)
    assert [step["label"] for step in data["steps"]] == [f"time {t}\u202fs" for t in range(1, 7)]
    row = (history / "history.csv").read_text().splitlines()[3].split(",")
    largest = float(row[(history / "history.csv").read_text().splitlines()[0].split(",").index("greatest_pressure")])
    shown = numbers(data["steps"][2]["values"]["pressure"]) * data["fields"][0]["factor"]
    assert shown.max() == pytest.approx(largest, rel=1e-6)


def between(words, start, end):
    return words.split(start, 1)[1].split(end, 1)[0]


def test_figures_of_a_history_are_labelled(history):
    """Sums and largest values are of all steps, those of the last step are labelled; the two differ."""
    words = words_of(history)
    steps = [json.loads(file.read_text()) for file in sorted((history / "steps").glob("*/summary.json"))]
    last = steps[-1]

    def largest(of):
        values = [of(step) for step in steps]
        return max(values), values.index(max(values)) + 1

    pressure, at_pressure = largest(lambda step: step["maximum"]["contact_pressure"])
    slip, at_slip = largest(lambda step: step["totals"]["greatest_slip"])
    moved, at_moved = largest(lambda step: step["maximum"]["displacement"])
    dissipated = last["accumulated"]["dissipated_energy"]
    assert slip > last["totals"]["greatest_slip"]
    assert dissipated > 1.5 * last["totals"]["dissipated_energy"]
    tiles = between(words, "below, at step", "What was solved")
    for part in (
        "steps certified 6 of 6",
        f"largest pressure, step {at_pressure} {quantity(pressure, 'Pa')}",
        f"largest slip in one step, step {at_slip} {quantity(slip, 'm')}",
        f"dissipated, all steps {quantity(dissipated, 'J')}",
        f"normal force at the end {quantity(last['force_on_body']['normal'], 'N')}",
    ):
        assert part.replace("\u202f", " ") in tiles, part
    in_all = between(words, "In all 6 steps", "At the end, time 6 s")
    for part in (
        f"largest displacement {quantity(moved, 'm', 5)} (step {at_moved}, time {at_moved} s)",
        f"largest slip in one step {quantity(slip, 'm', 5)} (step {at_slip}, time {at_slip} s)",
        f"energy dissipated by friction {quantity(dissipated, 'J')}",
    ):
        assert part.replace("\u202f", " ") in in_all, part
    at_end = between(words, "At the end, time 6 s", "How it was made")
    for name, entry, unit in (
        ("largest slip in the last step", "greatest_slip", "m"),
        ("energy dissipated by friction in the last step", "dissipated_energy", "J"),
    ):
        assert f"{name} {quantity(last['totals'][entry], unit)}".replace("\u202f", " ") in at_end
    products = sum(step["iterations"]["products"] for step in steps)
    assert f"products by A in all 6 steps {products} " in words


def test_times_of_a_history_add_up_to_its_run(history):
    rows = dict(results.seconds(read_run(history)))
    parts = [
        float(text.split("\u202f")[0]) * {"s": 1.0, "ms": 1e-3, "µs": 1e-6}[text.split("\u202f")[1]]
        for text in rows.values()
    ]
    assert sum(parts[:-1]) == pytest.approx(parts[-1], rel=0.02) and list(rows)[-2:] == ["everything else", "in all"]
    (run,) = read_run(history).made
    took = datetime.fromisoformat(run["ended"]) - datetime.fromisoformat(run["started"])
    assert parts[-1] == pytest.approx(took.total_seconds(), rel=0.01)
    assert "Times, all steps" in words_of(history)


def test_a_page_shows_date_host_and_command(block, history):
    for directory in (block, history):
        words, (run,) = words_of(directory), read_run(directory).made
        started = datetime.fromisoformat(run["started"])
        shown = results.in_date(run["started"])
        assert shown.startswith(f"{started:%Y-%m-%d %H:%M:%S} UTC")
        assert f"{shown} on {platform.node()}, coulomb {__version__}" in words
        assert f"host {platform.node()}" in words and f"command {run['command']}" in words
    assert results.in_date("2026-01-31T12:00:00.123+05:30") == "2026-01-31 12:00:00 UTC+05:30"
    assert results.in_date("2026-01-31T12:00:00.123+00:00") == "2026-01-31 12:00:00 UTC"


def test_a_step_before_the_last_that_failed_is_named(history, tmp_path):
    """The certificate of a history is that of its worst step."""
    shutil.copytree(history, tmp_path / "h")
    contents = json.loads((tmp_path / "h" / "summary.json").read_text())
    steps = [json.loads(file.read_text()) for file in sorted((history / "steps").glob("*/summary.json"))]
    steps[2]["certificate"]["penetration"] |= {"value": 3e-5, "passed": False}
    steps[2]["certificate"]["passed"] = False
    contents["history"], contents["certificate"]["passed"] = whole(steps), False
    (tmp_path / "h" / "summary.json").write_text(json.dumps(contents))
    table = (tmp_path / "h" / "history.csv").read_text().splitlines()
    table[3] = table[3].replace("True", "False")
    (tmp_path / "h" / "history.csv").write_text("\n".join(table))
    run = read_run(tmp_path / "h")
    assert results.in_words(run).endswith(
        "conditions fail, at 1 of 6 steps (3). The worst is the penetration, which is 30 times its limit at step 3."
    )
    shown = {row["name"]: row for row in results.checks(run)}
    assert shown["penetration"]["step"] == "3" and not shown["penetration"]["passed"]


def test_forces_that_are_unresolved_are_not_green(history, tmp_path):
    """In the page, the history's table of conditions, and the last line of the run."""
    shutil.copytree(history, tmp_path / "h")
    contents = json.loads((tmp_path / "h" / "summary.json").read_text())
    steps = [json.loads(file.read_text()) for file in sorted((history / "steps").glob("*/summary.json"))]
    assert all(step["certificate"]["resolution"]["resolved"] for step in steps)
    steps[2]["certificate"]["resolution"] |= {"value": 5.3e-5, "resolved": False}
    contents["history"] = whole(steps)
    (tmp_path / "h" / "summary.json").write_text(json.dumps(contents))
    run = read_run(tmp_path / "h")
    assert results.in_words(run).endswith("Contact forces are known to 5.3×10⁻⁵ of the largest only.")
    assert not results.resolved(run) and results.resolved(read_run(history))
    text = page_without_pictures(tmp_path / "h")
    assert '<header class="unresolved">' in text and "Certified, forces unresolved" in text
    assert text.count('<tr class="doubtful">') == 1
    assert _steps_that_count(contents["history"]).endswith("contact forces of step 3 known to 5.3e-05 only")


def test_zones_of_the_first_step_are_drawn(history, monkeypatch):
    """The width of a step is its duration; the first one begins at the start of the history."""
    drawn = []
    monkeypatch.setattr(
        Axes, "stackplot", lambda axis, *given, **options: drawn.append((axis.plot([], label="x"), *given))
    )
    charts.surface(read_run(history))
    _, ends, counts = drawn[0]
    assert list(ends) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0] and all(count[0] == count[1] for count in counts)


def test_force_is_drawn_against_what_moves_most(history):
    run = read_run(history)
    assert "against prescribed displacement" in charts.force_displacement(run)
    moved = replace(run, case={"contact": {"motion": [[0.0, 0.0, 0.0, 0.0], [6.0, 0.1, 0.0, 0.0]]}})
    assert "against displacement of the foundation" in charts.force_displacement(moved)
    still = replace(run, steps=run.steps[-1:], rows=run.rows[-1:])
    assert charts.force_displacement(still) == ""


def test_an_unfinished_history_is_labelled(history, tmp_path):
    shutil.copytree(history, tmp_path / "h")
    contents = json.loads((tmp_path / "h" / "summary.json").read_text())
    contents["last"]["step"]["pending"] = [8.0, 7.0]
    (tmp_path / "h" / "summary.json").write_text(json.dumps(contents))
    (tmp_path / "h" / "report.html").write_text(page_without_pictures(tmp_path / "h"))
    assert "NOT CERTIFIED" in words_of(tmp_path / "h")
    assert "stopped at time 6 s, before its end at 8 s" in words_of(tmp_path / "h")


@pytest.mark.parametrize("history", ["", "[history]\ntimes = [1, 2]\n"], ids=["single", "history"])
@pytest.mark.parametrize("method", ["auto", "successive-tresca"])
def test_charts_where_nothing_touches(tmp_path, history, method):
    """Residuals, forces and energies are 0: the charts state it, and no logarithm of 0 is drawn."""
    (tmp_path / "case.toml").write_text(APART + history)
    done = run_coulomb("run", "case.toml", "--output", "out", "--set", f"solver.method={method}", cwd=tmp_path)
    run = read_run(tmp_path / "out")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drawn = [charts.convergence(run)]
        if history:
            drawn += [draw(run) for draw in (charts.forces, charts.surface, charts.effort)]
    said = [re.findall(r"<!-- (.*?) -->", chart) for chart in drawn]
    rows = list(csv.DictReader(next((tmp_path / "out").rglob("iterations.csv")).open()))
    assert not rows or all(float(row["residual"]) == 0.0 for row in rows)
    assert ("residual 0 in every step" in said[0]) == (drawn[0] != "")
    if history:
        assert "all energies are 0" in said[1] and "residual 0 in every step" in said[3]
    assert "could not" not in done.stderr and "<html" in page_without_pictures(tmp_path / "out", charts=True)


def test_a_run_from_python_has_no_case(tmp_path):
    output.write(solved_block(6), tmp_path)
    (tmp_path / "case.json").write_text("{}")  # of an earlier run: not of this one
    (tmp_path / "report.html").write_text("")
    output.write(solved_block(6), tmp_path)
    assert not (tmp_path / "case.json").exists() and not (tmp_path / "report.html").exists()
    (tmp_path / "report.html").write_text(page_without_pictures(tmp_path))
    assert "traction on top (0, 30, −120) MN" in words_of(tmp_path) and "clamp on left x, y, z" in words_of(tmp_path)


def test_report_of_no_run_exits_2(tmp_path):
    done = run_coulomb("report", tmp_path, code=2)
    assert "holds no run: there is no summary.json" in done.stderr
    assert "Traceback" not in done.stderr
    (tmp_path / "summary.json").write_text("{}")
    done = run_coulomb("plot", tmp_path, "--save", tmp_path / "x.png", code=2)
    assert "not a summary of coulomb's" in done.stderr


def test_drawing_does_not_start_mpi(block, tmp_path):
    """Neither DOLFINx nor MPI is imported."""
    command = [sys.executable, "-X", "importtime", "-m", "coulomb.pictures.report"]
    command += ["plot", json.dumps([str(block), "pressure", None, None, str(tmp_path / "x.png"), None])]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True)
    assert " coulomb.pictures.report.scene" in done.stderr and "pyvista" in done.stderr
    for name in ("dolfinx", "mpi4py", "petsc4py", "coulomb.model.problem"):
        assert not re.search(rf"\| +{name}\b", done.stderr), name


# --- formatted numbers ------------------------------------------------------------------------------------------------


def test_few_names():
    names = ["a" * 30, "b" * 30, "c", "d"]
    assert in_few(names) == f"{names[0]}, {names[1]}, c and 1 more"
    assert in_few(names, room=50) == f"{names[0]} and 3 more" and in_few(names[2:], room=50) == "c, d"


def test_quantities():
    assert quantity(1.5125e8, "Pa") == "151.2\u202fMPa" and quantity(2.5e-5, "m") == "25\u202fµm"
    assert quantity(-1234.5, "N") == "−1.234\u202fkN" and quantity(0.0, "J") == "0\u202fJ"
    assert quantity(None, "m") == "–" and quantity(float("nan")) == "–"
    assert quantity(999_960.0, "Pa") == "1\u202fMPa"  # not 1000 kPa
    assert quantity(0.0231, "m²") == "231\u202fcm²" and quantity(7200.0, "s") == "7200\u202fs"
    assert number(3.2e-15, 2) == "3.2×10⁻¹⁵" and number(980.3, 2) == "980" and number(-0.5) == "−0.5"
    assert vector([1e7, -2e-3, -4e7], "Pa") == "(10, 0, −40)\u202fMPa"
    assert scale_of(0.3, "") == (1.0, "")


def test_named_fields():
    assert named("slip").component is None and named("slip_y").component == 1
    assert named("slip_y").limits(np.array([-2.0, 1.0])) == (-2.0, 2.0)  # zero is in the middle of the colour scale
    assert named("pressure").limits(np.array([1.0, 3.0])) == (0.0, 3.0)
    assert named("friction_use").limits(np.array([0.2, 0.4])) == (0.0, 1.0)
    with pytest.raises(ValueError, match="did you mean gap"):
        named("gapp")


def test_the_case_as_text(block):
    """All that was given, without the places of this machine."""
    case = {
        "body_force": ["10*x", 0.0, 0.0],
        "mesh": {"file": "/home/me/part.msh", "scale": 1e-3},
        "traction": [{"face": "top", "value": [0.0, 0.0, "-1e6*x"], "amplitude": [[0, 0], [2, 1]]}],
        "rigid_face": [{"face": "hub", "translation": {"x": None, "y": 1e-3}}],
    }
    text = case_as_text(replace(read_run(block), case=case))
    assert "part.msh" in text and "/home" not in text
    case["mesh"]["file"], case["rigid_face"][0]["translation"] = "part.msh", {"y": 1e-3}
    assert tomllib.loads(text) == case
    assert case_as_text(replace(read_run(block), case=None)) == ""


def test_supports_in_words():
    """As they were understood, with their factors in time and their ends."""
    mesh, steel, contact = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), coulomb.Material(2e11, 0.3), coulomb.Contact
    held = [
        coulomb.Clamp("left", end=2.0),
        coulomb.PrescribedDisplacement("right", (1e-3, 0.0, 0.0), "x", amplitude=[(0.0, 0.0), (1.0, 1.0)]),
        coulomb.PrescribedDisplacement("top", (0.0, 2e-3, 0.0), "y", amplitude=np.sin),
        coulomb.PrescribedDisplacement("top", field((0.0, 0.0, "-1e-3*x")), "z"),
        coulomb.PrescribedRotation(
            "back", (0, 0, 0), (0, 1, 0), 0.1, coulomb.LoadCurve([0, 1, 2], [0, 1, 0], "repeat")
        ),
    ]
    problem = coulomb.ContactProblem(
        mesh, steel, held, contact("bottom", 0.3), springs=[coulomb.Spring("front", (0.0, 1e9, 0.0))]
    )
    entries = json.loads(json.dumps(problem.elasticity.support_entries()))
    said = [(name, text.replace("\u202f", " ")) for name, text in supports({"understood": {"supports": entries}})]
    assert said == [
        ("clamp on left", "x, y, z, until 2 s"),
        ("prescribed displacement on right", "x = 1 mm, factor 0 at 0 s, 1 at 1 s"),
        ("prescribed displacement on top", "y = 2 mm, times a function of time"),
        ("prescribed displacement on top", "z: (0, 0, -1e-3*x) m"),
        (
            "prescribed rotation on back",
            "rotation 0.1 rad about (0, 1, 0) through (0, 0, 0) m, factor 0 at 0 s, 1 at 1 s, 0 at 2 s, repeated",
        ),
        ("spring on front", "stiffness (0, 1e+09, 0) N/m^3"),
    ]


def test_ties_and_contacts_in_words():
    tie = {"kind": "tie", "face": "a:top", "against": "b:bottom", "nodes": 9, "area": 2e-4, "apart": 1e-6}
    assert tie_in_words(tie) == ("tie of 'a:top' to 'b:bottom'", "9 nodes, 2\u202fcm², up to 1\u202fµm apart")
    assert tie_in_words({"kind": "rigid face", "face": "hub", "nodes": 1, "area": 0.0}) == (
        "rigid face 'hub'",
        "1 node",
    )
    ends = {"min": 0.0, "max": 1e-3}
    given = {"gap": ends, "given_gap": ends, "moves": "translation and gap amplitude", "foundation": "the face 'b:top'"}
    law = {"law": "coulomb", "friction": 0.3}
    said = contact_in_words({"nodes": 4, **law, **given}).replace("\u202f", " ")
    assert said == (
        "4 nodes, Coulomb friction 0.3, gap 0 m to 1 mm, of which given 0 m to 1 mm times its amplitude; "
        "the face 'b:top', moves by translation and gap amplitude"
    )
    assert contact_in_words({"nodes": 0, **law, **given}) == "no contact points now; the face 'b:top'"


def test_load_curves_in_words_and_numbers():
    curve = {"table": [[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]], "after": "repeat"}
    assert in_time(curve).replace("\u202f", " ") == ", factor 0 at 0 s, 2 at 1 s, 0 at 2 s, repeated"
    assert in_time([[k, 0.5] for k in range(20)]).endswith(", …")
    assert in_time(None) == ""
    assert values_in_time(curve, [0.5, 2.5, 3.5])[:, 0] == pytest.approx([1.0, 1.0, 1.0])
    assert values_in_time([[0, 0, 0, 0], [1, 1, 2, 3]], [0.5, 2.0]) == pytest.approx(
        np.array([[0.5, 1, 1.5], [1, 2, 3]])
    )
