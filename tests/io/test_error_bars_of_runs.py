"""Error bars of runs and of load histories, in words and files."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from check_runs import read_grid
from conftest import SMALL_CASE, run_coulomb, with_report
from report_pages import words_of
from rich.console import Console
from shared_problems import pressed_block

from coulomb.cli.terminal import show_error_bars
from coulomb.io.error_bars import error_of
from coulomb.io.other_meshes import NoErrorBars

CASE = SMALL_CASE.replace("[3.0, 1.0, 1.0]\ncells = [3, 1, 1]", "[1.0, 1.0, 0.5]\ncells = [4, 4, 2]")
CASE = CASE.replace("-1e7]", "-1e7]\nAMPLITUDE") + "error = true\n"


def test_a_run_says_writes_and_checks_its_error_bars(tmp_path):
    case, results = tmp_path / "case.toml", tmp_path / "results"
    case.write_text(CASE.replace("AMPLITUDE", ""))
    done = run_coulomb("run", case, "--output", results)
    assert "error bars of the mesh, from meshes of" in done.stdout
    assert "normal force  " in done.stdout and " +- " in done.stdout
    assert re.search(r"^  stress, energy norm +\+- [0-9.]+ %$", done.stdout, re.MULTILINE)
    report = words_of(with_report(results))
    assert "How far from the continuum" in report
    assert re.search(r"tolerance, 1×10⁻⁸, leaves at most 0\.0\d+ % of an error bar, that of [a-z ]+;", report)
    assert "the solver's tolerance" not in done.stdout
    summary = json.loads((results / "summary.json").read_text())
    assert [one["order"] for one in summary["error"]["meshes"]] == [1, 1, 1]
    bars = {bar["quantity"]: bar for bar in summary["error"]["bars"]}
    squared = np.sum(read_grid(results / "solution.xdmf").fields["stress_error"] ** 2) * 0.5 / 32 / 2e11
    norm = np.sqrt(2.0 * bars["strain_energy"]["value"])
    assert summary["error"]["relative_stress_error"] == pytest.approx(np.sqrt(squared) / norm, rel=1e-6)
    assert bars["totals.normal_force"]["value"] == summary["totals"]["normal_force"]
    run_coulomb("check", results)
    bars["totals.normal_force"]["value"] *= 1.001
    (results / "summary.json").write_text(json.dumps(summary))
    checked = run_coulomb("check", results, code=1)
    assert "error.totals.normal_force" in checked.stdout
    bars["totals.normal_force"]["value"] /= 1.001
    bars["totals.normal_force"]["parts"]["algebraic"] += 0.1 * bars["totals.normal_force"]["error"]
    (results / "summary.json").write_text(json.dumps(summary))
    checked = run_coulomb("check", results, code=1)
    assert "error bar.totals.normal_force" in checked.stdout


def test_a_tolerance_that_leaves_more_than_a_hundredth_of_a_bar_is_said(capsys):
    for tolerance, said in ((1e-2, True), (1e-8, False)):
        bars = error_of(pressed_block(2).solve(tolerance), tolerance=tolerance).entry()
        show_error_bars(Console(width=200), {"error": bars}, tolerance)
        words = r"the solver's tolerance 0.01 leaves up to [0-9.]+ % of the error bar of .*: give a smaller one"
        shown = capsys.readouterr().out
        assert bool(re.search(words, shown)) == ("the solver's tolerance" in shown) == said


def test_every_load_step_has_error_bars(tmp_path):
    case, results = tmp_path / "case.toml", tmp_path / "results"
    case.write_text(
        CASE.replace("AMPLITUDE", "amplitude = [[0.0, 0.0], [2.0, 1.0]]") + "[history]\ntimes = [1.0, 2.0]\n"
    )
    done = run_coulomb("run", case, "--output", results)
    assert done.stdout.count("error bars of the mesh") == 1
    forces = []
    for step in (1, 2):
        summary = json.loads((results / "steps" / f"{step:04d}" / "summary.json").read_text())
        bars = {bar["quantity"]: bar for bar in summary["error"]["bars"]}
        forces.append(bars["totals.normal_force"])
    assert forces[0]["value"] < forces[1]["value"] and 0.0 < forces[0]["error"] < forces[1]["error"]
    run_coulomb("check", results)


def test_a_comparison_that_does_not_fit_is_refused_and_the_answer_kept(tmp_path, monkeypatch):
    """Second order has eight times the unknowns: it must not end a run that has its answer."""
    alone = pressed_block(2).on(replace(pressed_block(2).made_of, coarser=None)).solve()
    monkeypatch.setattr("coulomb.io.other_meshes.least_room", lambda comm: 1e8)
    with pytest.raises(NoErrorBars, match=r"needs about [0-9.]+ GB of memory, and 0.1 GB are free"):
        alone.error()
