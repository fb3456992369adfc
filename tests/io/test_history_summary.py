"""Figures in the summary of a load history: sums and largest values of all its steps, and its runs."""

import copy
import csv
import json
import platform
import re
import shutil
from datetime import datetime

import pytest
from conftest import ROOT, run_coulomb

from coulomb.io.history_files import added, whole
from coulomb.model import provenance
from coulomb.units import plain, quantity
from coulomb.version import __version__

HISTORY = ROOT / "demos" / "history.toml"
SMALL = ("--set", "mesh.cells=[4,4,2]", "--set", "history={end=4.0, steps=4}", "--set", "output.picture=false")


def summaries(directory):
    files = sorted((directory / "steps").glob("*/summary.json"))
    return [json.loads(file.read_text()) for file in files]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    directory = tmp_path_factory.mktemp("history")
    said = run_coulomb("run", HISTORY, *SMALL, "--output", directory)
    return directory, said.stdout


def test_sums_and_largest_values_are_of_all_steps(done):
    directory, _ = done
    contents, steps = json.loads((directory / "summary.json").read_text()), summaries(directory)
    history = contents["history"]
    assert contents["steps"] == history["steps"] == history["certified_steps"] == len(steps) == 4
    assert contents["last"] == steps[-1]
    for name in ("path_following", "products", "krylov"):
        assert history["iterations"][name] == sum(step["iterations"][name] for step in steps)
    assert history["iterations"]["products"] > 2 * steps[-1]["iterations"]["products"]
    for name in ("solve", "output", "certificate", "stiffness"):
        assert history["seconds"][name] == pytest.approx(sum(step["seconds"].get(name, 0.0) for step in steps))
    assert steps[0]["seconds"]["stiffness"] > 0.0 and "stiffness" not in steps[1]["seconds"]
    for name in ("contact_pressure", "displacement", "penetration"):
        values = [step["maximum"][name] for step in steps]
        found = history["maximum"][name]
        assert found["value"] == max(values) and values[found["step"] - 1] == max(values)
        assert found["time"] == pytest.approx(found["step"])
    assert history["maximum"]["slip_in_a_step"]["value"] == max(step["totals"]["greatest_slip"] for step in steps)
    for name, check in history["certificate"].items():
        if isinstance(check, dict):
            assert check["value"] == max(step["certificate"][name]["value"] for step in steps), name
    assert history["residual"]["value"] == max(step["residual"] for step in steps)


def test_energy_of_the_history_is_the_sum_over_its_steps(done):
    """The energy dissipated in all steps, not in the last one; steps by themselves count with the forces at their
    ends, where friction differs a little."""
    directory, said = done
    contents, steps = json.loads((directory / "summary.json").read_text()), summaries(directory)
    at_ends = [step["totals"]["dissipated_energy"] for step in steps]
    dissipated = steps[-1]["accumulated"]["dissipated_energy"]
    assert contents["history"]["energy"]["dissipated"] == pytest.approx(dissipated)
    assert dissipated == pytest.approx(sum(at_ends), rel=0.05) and dissipated > 1.5 * at_ends[-1]
    rows = list(csv.DictReader((directory / "history.csv").open()))
    assert float(rows[-1]["energy_dissipated"]) == pytest.approx(dissipated)
    assert f"friction {plain(quantity(dissipated, 'J'))}, time-stepping error" in said


def test_terminal_labels_its_figures(done):
    directory, said = done
    history = json.loads((directory / "summary.json").read_text())["history"]
    pressure, slip = history["maximum"]["contact_pressure"], history["maximum"]["slip_in_a_step"]
    assert f"all 4 steps: largest pressure {plain(quantity(pressure['value'], 'Pa'))} (step {pressure['step']})" in said
    assert f"largest slip in one step {plain(quantity(slip['value'], 'm'))} (step {slip['step']})" in said
    assert f"{history['iterations']['products']} products" in said and "energy since the start: " in said
    assert "4 steps in this run, " in said and re.search(r"step   2  2 s  +'top' x ", said)


def test_a_history_that_was_resumed_has_the_same_figures_and_both_runs(done, tmp_path):
    directory, _ = done
    shutil.copytree(directory, tmp_path, dirs_exist_ok=True)
    for number in (3, 4):  # as after a kill in the third step
        for file in (tmp_path / "steps" / f"{number:04d}").iterdir():
            file.unlink()
    said = run_coulomb("resume", tmp_path)
    before, after = (json.loads((folder / "summary.json").read_text())["history"] for folder in (directory, tmp_path))
    for name in ("steps", "certified_steps"):
        assert after[name] == before[name], name
    # What the Krylov iterations of the steps before have found of A is not in the files: products may differ.
    for name in ("outer", "path_following"):
        assert after["iterations"][name] == before["iterations"][name], name
    assert after["energy"]["dissipated"] == pytest.approx(before["energy"]["dissipated"], rel=1e-9)
    pressures = [history["maximum"]["contact_pressure"]["value"] for history in (before, after)]
    assert pressures[0] == pytest.approx(pressures[1], rel=1e-9)
    assert [(run["first_step"], run["last_step"]) for run in after["runs"]] == [(1, 2), (3, 4)]
    assert after["runs"][1]["command"] == f"coulomb resume {tmp_path}"
    assert "2 steps in this run, 2 were there before, " in said.stdout


def test_a_run_records_host_date_and_command(done):
    directory, _ = done
    (run,) = json.loads((directory / "summary.json").read_text())["history"]["runs"]
    assert run["hosts"] == [platform.node()] and run["ranks"] == 1 and run["coulomb"] == __version__
    assert run["command"].startswith(f"coulomb run {HISTORY} --set 'mesh.cells=[4,4,2]'")
    started, ended = (datetime.fromisoformat(run[name]) for name in ("started", "ended"))
    assert started.tzinfo is not None and 0.0 < (ended - started).total_seconds() < 600.0
    step = summaries(directory)[0]
    assert step["run"]["started"] == run["started"] and datetime.fromisoformat(step["run"]["ended"]) <= ended
    seconds = json.loads((directory / "summary.json").read_text())["history"]["seconds"]
    assert sum(seconds.values()) <= (ended - started).total_seconds() + 0.01


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["/usr/bin/coulomb", "run", "a case.toml"], "coulomb run 'a case.toml'"),
        (["/usr/lib/python3/coulomb/__main__.py", "run", "c.toml"], "coulomb run c.toml"),
        (["demos/block.py"], "python demos/block.py"),
        ([""], "python"),
        (["-c", "x"], "-c"),
    ],
)
def test_recorded_command_can_be_typed(monkeypatch, arguments, shown):
    monkeypatch.setattr("sys.argv", arguments)
    assert provenance.command() == shown


def altered(step, number, passed=True, value=1e-8, gradient=0.0, memory=5):
    """The summary of a step with other figures."""
    step = copy.deepcopy(step)
    step["step"] |= {"number": number, "time": float(number), "halvings": 1}
    step["certificate"]["adhesion"] |= {"value": value, "passed": passed}
    step["certificate"]["passed"] = passed
    step["small_strain"]["gradient"] = gradient
    step["seconds"] = {"solve": 1.0}
    return step | {"residual": value, "peak_memory_bytes": memory}


def test_a_failed_step_fails_the_history(done):
    """A failed step, a warning and a missing value of an earlier step are not hidden by a last step that passed."""
    step = summaries(done[0])[0]
    failed = altered(step, 2, passed=False, value=3e-5, gradient=0.2, memory=9)
    contents = whole([altered(step, 1), failed, altered(step, 3)])
    assert contents["certificate"]["passed"] is False and contents["certified_steps"] == 2 and contents["halvings"] == 3
    assert contents["certificate"]["adhesion"]["step"] == 2 and not contents["certificate"]["adhesion"]["passed"]
    assert contents["peak_memory_bytes"] == 9 and contents["seconds"]["solve"] == 3.0
    assert len(contents["warnings"]) == 1 and "0.2" in contents["warnings"][0]
    nothing = added(contents, altered(step, 4, passed=False, value=None))
    assert nothing["certificate"]["adhesion"]["step"] == 4 and nothing["residual"]["value"] is None
    assert added(nothing, altered(step, 5, value=1e9))["residual"]["step"] == 4  # null counts as the largest
