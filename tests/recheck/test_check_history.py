"""`coulomb check` of a load history: every step against the written step before, and the summary of all steps."""

import csv
import shutil
from dataclasses import replace

import pytest
from check_runs import BALL, TRESCA_STEPS, UNASKED, change, copied, edit, field, made, run_case
from conftest import indentation, run_coulomb
from mpi4py import MPI

import coulomb
from coulomb.case.case import read_case
from coulomb.io.atomic_output import locked
from coulomb.io.history_files import HistoryFiles
from coulomb.model.load_history import LoadHistory
from coulomb.recheck import check

RUNS = {"hexahedra, Coulomb": BALL, "tetrahedra, Tresca": TRESCA_STEPS}


def failing(found):
    return [step.number for step in found.steps if not step.passed]


@pytest.mark.parametrize("text", RUNS.values(), ids=RUNS)
def test_a_history_agrees(text):
    said = []
    found = check(made(text), say=said.append)
    assert found.passed and found.recorded, found
    assert len(found.steps) == 3 and said == [step.of_step for step in found.steps]
    assert all("certificate passed, files agree" in line for line in said)
    assert "3 of 3 load steps passed" in found.ending and "taken as written" not in found.ending


@pytest.mark.parametrize("text", RUNS.values(), ids=RUNS)
def test_a_problem_in_place_of_a_case(text, tmp_path):
    folder = copied(text, tmp_path / "run")
    (folder / "case.json").unlink()
    found = check(folder, read_case(made(text).with_suffix(".toml")).problem(MPI.COMM_SELF))
    assert found.passed and "alone" not in found.ending, found


def test_work_of_a_clamp_at_rest(tmp_path):
    """Reactions of 1e9 N at a clamp at rest: their work is 0 up to rounding in each step."""
    problem, history = indentation()
    history.run(problem, HistoryFiles(tmp_path))
    assert check(tmp_path).passed


def test_one_step_of_a_history(tmp_path):
    """Each step against the one before, with the case of the history."""
    folder = copied(BALL, tmp_path / "run")
    for number in (1, 2, 3):
        found = check(folder / "steps" / f"{number:04d}")
        assert found.passed and not any("taken as written" in line for line in found.trusted), found
    change(folder / "steps" / "0002" / "contact.h5", "slip_origin", lambda origin: origin * (1.0 + 1e-6))
    assert any("slip_origin" in fault for fault in check(folder / "steps" / "0002").faults)


class WithoutSlipOrigin(LoadHistory):
    """A fault: every step measures slip from the undeformed position."""

    def _posed(self, problem, state, time):
        return super()._posed(problem, replace(state, displacement=0.0 * state.displacement), time)


class WithoutMotionOfOrigin(LoadHistory):
    """A fault: the slip origin does not move with the foundation."""

    def _posed(self, problem, state, time):
        return problem.at(time, replace(state, time=time))


class WithFirstFoundation(LoadHistory):
    """A fault: foundation, gaps and motion are those of the first step in all steps."""

    def _posed(self, problem, state, time):
        posed = super()._posed(problem, state, time)
        if state.number == 0:
            return posed
        first = problem.at(self.times[0])
        return posed.in_state(
            replace(posed.state, foundation_motions=first.state.foundation_motions, surface=first.surface)
        )


class WithFirstLoad(LoadHistory):
    """A fault: the load is that of the first step in all steps."""

    def _posed(self, problem, state, time):
        posed = super()._posed(problem, state, time)
        loading = replace(posed.loading, load=problem.elasticity.at(self.times[0]).load)
        return posed.in_state(replace(posed.state, loading=loading))


@pytest.mark.parametrize(
    ("text", "faulty", "steps"),
    [
        (BALL, WithoutSlipOrigin, [2, 3]),
        (BALL, WithoutMotionOfOrigin, [1, 2, 3]),
        (BALL, WithFirstFoundation, [2, 3]),
        (TRESCA_STEPS, WithFirstLoad, [2, 3]),
    ],
)
def test_faults_in_the_history_are_detected(text, faulty, steps, monkeypatch, tmp_path):
    monkeypatch.setattr(coulomb, "LoadHistory", faulty)
    folder = run_case(text + UNASKED, tmp_path / "run")
    monkeypatch.undo()
    found = check(folder)
    assert failing(found) == steps
    if faulty in (WithoutSlipOrigin, WithoutMotionOfOrigin):
        assert all(any("slip_origin" in fault for fault in found.steps[k - 1].faults) for k in steps)
        # slip is measured from the step before, not from the record of the step
        assert all("certificate FAILED" in found.steps[k - 1].details for k in steps)


STEP = "steps/0002/summary.json"


def scale(entry, *path):
    for key in path[:-1]:
        entry = entry[key]
    entry[path[-1]] *= 1.0 + 1e-6


def test_number_and_time_of_a_step(tmp_path):
    folder = copied(BALL, tmp_path / "run")
    edit(folder / STEP, lambda s: s["step"].update(time=2.0000001))
    assert 2 in failing(check(folder))
    for changed in ({"number": 3}, {"time": 1.0}):
        edit(folder / STEP, lambda s, changed=changed: s["step"].update(changed))
        with pytest.raises(ValueError, match=r"0002/summary.json: is of step \d to . s, but the step before, 1, ends"):
            check(folder)


def test_missing_steps(tmp_path):
    folder = copied(BALL, tmp_path / "run")
    edit(folder / "steps/0001/summary.json", lambda s: s["step"].update(pending=[3.0]))
    assert any("leaves out [2.0]" in fault for fault in check(folder).faults)
    edit(folder / "steps/0001/summary.json", lambda s: s["step"].update(pending=[2.0, 3.0]))
    assert any("do not increase" in fault for fault in check(folder).faults)


def test_an_unfinished_history_is_reported(tmp_path):
    """As after an interruption: the existing steps pass, and the missing ones are reported."""
    folder = copied(BALL, tmp_path / "run")
    for number, pending in ((1, [4.0, 3.0, 2.0]), (2, [4.0, 3.0]), (3, [4.0])):
        edit(folder / f"steps/{number:04d}/summary.json", lambda s, left=pending: s["step"].update(pending=left))
    edit(folder / "case.json", lambda c: c["history"].update(times=[1, 2, 3, 4]))
    edit(folder / "summary.json", lambda s: s["last"]["step"].update(pending=[4.0]))
    (folder / "steps" / "0004").mkdir()
    found = check(folder)
    assert found.passed, found
    assert "not finished: 1 load steps are still to be taken" in found.ending
    assert "0004: is incomplete and was not checked" in found.ending


OF_ALL = {
    "steps": lambda s: s.update(steps=2),
    "time": lambda s: s.update(time=2.0),
    "certificate.passed": lambda s: s["certificate"].update(passed=False),
    "last.totals.force[2]": lambda s: scale(s, "last", "totals", "force", 2),
    "history.energy.dissipated": lambda s: scale(s, "history", "energy", "dissipated"),
    "history.maximum.contact_pressure.value": lambda s: scale(s, "history", "maximum", "contact_pressure", "value"),
    "history.certified_steps": lambda s: s["history"].update(certified_steps=2),
}


def test_the_summary_of_all_steps(tmp_path):
    """All are changed at once; each is named."""
    folder = copied(BALL, tmp_path / "run")
    for spoil in OF_ALL.values():
        edit(folder / "summary.json", spoil)
    found = check(folder)
    assert not failing(found) and not found.passed
    assert sorted(fault.split(":")[0] for fault in found.faults) == sorted(f"summary.json.{name}" for name in OF_ALL)


def test_every_figure_of_history_csv(tmp_path):
    folder = copied(BALL, tmp_path / "run")
    with (folder / "history.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in rows[1]:
        value = rows[1][name]
        rows[1][name] = "False" if value == "True" else repr(float(value) * (1.0 + 1e-6) + (float(value) == 0.0))
    with (folder / "history.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    faults = check(folder).faults
    assert all(any(f"line 2.{name}:" in fault for fault in faults) for name in rows[1])


def test_lines_and_series(tmp_path):
    folder = copied(BALL, tmp_path / "run")
    text = (folder / "history.csv").read_text().splitlines()
    (folder / "history.csv").write_text("\n".join(text[:-1]) + "\n")
    series = (folder / "contact.xdmf").read_text()
    (folder / "contact.xdmf").write_text(series.replace('Time Value="2.0"', 'Time Value="2.5"'))
    (folder / "solution.xdmf").write_text((folder / "solution.xdmf").read_text().replace("steps/0003/", "steps/0002/"))
    faults = check(folder).faults
    assert [fault.split(":")[0] for fault in faults] == ["history.csv", "solution.xdmf", "contact.xdmf"]


def test_beside_a_run(tmp_path):
    """The files of all steps go on while these are checked."""
    folder = copied(BALL, tmp_path / "run")
    (folder / "history.csv").write_text("")
    with locked(folder, None):
        found = check(folder)
    assert found.passed and "a run is at work: summary.json, history.csv and the series" in found.ending
    assert not check(folder).passed


OTHER_CASES = {
    "motion": (lambda c: c["contact"]["motion"][2].__setitem__(1, 2.000002e-3), [2, 3]),
    "motion before": (lambda c: c["contact"]["motion"][0].__setitem__(1, 1e-6), [1, 2, 3]),  # energies add up
    "no motion": (lambda c: c["contact"].pop("motion"), [1, 2, 3]),
    "amplitude of a load": (lambda c: c["traction"][0]["amplitude"][0].__setitem__(1, 1.001), [1, 2, 3]),
    "amplitude of a clamp": (lambda c: c["clamp"][0]["amplitude"][2].__setitem__(1, 1.001), [1, 2, 3]),
    "friction": (lambda c: c["contact"].update(friction=0.4000004), [1, 2, 3]),
}


@pytest.mark.parametrize(("other", "steps"), OTHER_CASES.values(), ids=OTHER_CASES)
def test_another_case(other, steps, tmp_path):
    folder = copied(BALL, tmp_path / "run")
    edit(folder / "case.json", other)
    assert failing(check(folder)) == steps


def test_steps_of_two_histories(tmp_path):
    """Every step is right by itself; the third does not start from the second."""
    folder = copied(BALL, tmp_path / "run")
    other = run_case(BALL.replace("times = [1, 2, 3]", "times = [0.5, 1, 3]"), tmp_path / "other")
    shutil.rmtree(folder / "steps" / "0003")
    shutil.copytree(other / "steps" / "0003", folder / "steps" / "0003")
    assert field(folder / "steps/0003/contact.h5", "slip").any()
    found = check(folder)
    assert failing(found) == [3] and any("slip_origin" in fault for fault in found.steps[2].faults)


def test_the_command(tmp_path):
    folder = copied(BALL, tmp_path / "run")
    done = run_coulomb("check", folder)
    assert done.stderr == ""
    assert [line[:8] for line in done.stdout.splitlines()[:3]] == ["step   1", "step   2", "step   3"]
    change(folder / "steps" / "0002" / "solution.h5", "displacement", lambda u: u * (1.0 + 1e-4))
    done = run_coulomb("check", folder, code=1)
    lines = done.stdout.splitlines()
    assert [line for line in lines if line.startswith("step")][1].endswith("FAILED")
    assert any(line.startswith("  equilibrium") and "FAILED" in line for line in lines)
    assert any(line.strip().startswith("contact.xdmf: slip") for line in lines)
    assert lines[-1] == "1 of 3 load steps passed"  # the third starts from the written state of the second


DAMAGED = {
    "a step is missing": (lambda d: shutil.rmtree(d / "steps/0002"), "0002: is incomplete or missing"),
    "no steps": (lambda d: [shutil.rmtree(p) for p in (d / "steps").iterdir()], "steps: holds no load step"),
    "no summary": (lambda d: (d / "summary.json").unlink(), "summary.json: cannot be read"),
    "no history.csv": (lambda d: (d / "history.csv").unlink(), "history.csv: cannot be read"),
    "binary history.csv": (lambda d: (d / "history.csv").write_bytes(b"\xff\xfe\x00"), "history.csv: cannot be read"),
    "case cut": (lambda d: (d / "case.json").write_text("{"), "case.json"),
    "no record": (lambda d: edit(d / STEP, lambda s: s.pop("step")), "step has no number and time"),
    "no pending": (lambda d: edit(d / STEP, lambda s: s["step"].pop("pending")), "no list of pending times"),
    "text for a time": (lambda d: edit(d / STEP, lambda s: s["step"].update(time="x")), "step has no number and time"),
    "no row": (lambda d: edit(d / STEP, lambda s: s["step"].pop("row")), "is incomplete, or written by another ver"),
}


@pytest.mark.parametrize(("spoil", "message"), DAMAGED.values(), ids=DAMAGED)
def test_incomplete_results_are_refused(spoil, message, tmp_path):
    folder = copied(BALL, tmp_path / "run")
    spoil(folder)
    with pytest.raises(ValueError) as caught:
        check(folder)
    assert message in str(caught.value) and "\n" not in str(caught.value)
