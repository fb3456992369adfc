"""`coulomb resume` continues with the computed case and refuses any other."""

import functools
import json
import os
import shutil

import pytest
from conftest import run_coulomb
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.case.case import read_case
from coulomb.case.record import case_record, refuse_another_case, write_case, written_case
from coulomb.cli import run_case
from coulomb.io.history_files import HistoryFiles
from coulomb.model.load_history import LoadHistory

comm = MPI.COMM_WORLD

CASE = """\
body_force = [0.0, 0.0, 0.0]
mesh = { file = "part.msh" }
material = { young = 2e11, poisson = 0.3 }
clamp = [{ face = "top", value = [0.0, 0.0, -1e-4], amplitude = [[0, 0], [1, 1]] }]
contact = { face = "bottom", friction = 0.3 }
history = { times = [0.5, 1.0] }
output = { picture = false }
"""


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """A history of two steps, stopped after the first."""
    home = tmp_path_factory.mktemp("stopped")
    BoxFile().write(home / "part.msh")
    (home / "case.toml").write_text(CASE)
    case = read_case(home / "case.toml")
    keep = functools.partial(write_case, case, home / "out", comm)
    files = HistoryFiles(home / "out", case=case_record(case, comm), when_begun=keep)
    case.load_history().run(case.problem(comm), files, on_step=lambda _: True)
    assert len(files.rows) == 1
    return home


@pytest.fixture
def copy(stopped, tmp_path):
    """A copy of it, with the mesh file."""
    shutil.copytree(stopped, tmp_path / "copy")
    return tmp_path / "copy"


def edit(home, **tables):
    path = home / "out" / "case.json"
    case = json.loads(path.read_text())
    case["mesh"]["file"] = str(home / "part.msh")
    for table, keys in tables.items():
        if isinstance(keys, dict):
            case.setdefault(table, {}).update(keys)
        else:
            case[table] = keys
    path.write_text(json.dumps(case))


def refused(home):
    case = written_case(home / "out")
    with pytest.raises(ValueError) as fault:
        refuse_another_case(case, home / "out", 1, comm)
    return str(fault.value)


@pytest.mark.parametrize(
    ("tables", "named"),
    [
        ({"contact": {"friction": 0.5}}, "contact.friction is 0.5, was 0.3;"),
        ({"contact": {"motion": [[0, 0, 0, 0], [1, 1, 0, 0]]}}, "contact.motion is [[0.0, 0.0, 0.0, 0.0], [1.0, 1.0"),
        ({"material": {"young": 1e11}}, "material.young is 100000000000.0, was 200000000000.0;"),
        ({"clamp": [{"face": "top"}]}, "clamp.0.value.2 is 0.0, was -0.0001; clamp.0.amplitude is not given, was [[0"),
        ({"history": {"times": [0.5, 1.5]}}, "history.times.1 is 1.5, was 1.0;"),
        ({"history": {"times": [0.5]}}, "history.times is [0.5], was [0.5, 1.0];"),
        ({"body_force": [0, 0, 1]}, "body_force.2 is 1.0, was 0.0;"),
        ({"mesh": {"scale": 2.0}}, "mesh.scale is 2.0, was 1.0;"),
        ({"spring": [{"face": "left", "stiffness": 1.0}]}, "spring is "),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_an_edited_case_is_refused_by_name(copy, tables, named):
    edit(copy, **tables)
    said = refused(copy)
    assert "the case is no longer the one that its 1 load steps were computed from: " in said and named in said
    assert "undo the changes (case.json), or run the changed case in another directory" in said


def test_an_edited_mesh_is_refused(copy):
    edit(copy)
    other = BoxFile()
    other.points *= [1.0, 1.0, 1.01]
    other.write(copy / "part.msh")
    assert "computed from: the contents of mesh.file; " in refused(copy)


def test_changes_that_keep_the_problem_are_accepted(copy):
    """Another path of the same mesh and of the results, another method, a case with all defaults written out."""
    solver = {"method": "interior-point"}
    edit(copy, output={"report": True}, solver=solver, history={"halvings": 3}, contact={"region": []})
    data = refuse_another_case(written_case(copy / "out"), copy / "out", 1, comm)
    assert sorted(data) == ["history.halvings is 3, was 6", 'solver.method is "interior-point", was "auto"']


def test_steps_without_a_recorded_case_are_refused(copy):
    step = copy / "out" / "steps" / "0001" / "summary.json"
    data = json.loads(step.read_text())
    del data["step"]["case"]
    step.write_text(json.dumps(data))
    edit(copy)
    assert "has no record of the case it was computed from" in refused(copy)


def test_the_command(copy):
    edit(copy, contact={"friction": 0.5})
    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    done = run_coulomb("resume", copy / "out", code=2)
    assert "contact.friction is 0.5, was 0.3" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()} == before
    edit(copy, contact={"friction": 0.3}, solver={"tolerance": 1e-9})
    done = run_coulomb("resume", copy / "out")
    assert done.stderr.splitlines()[0] == "warning: from step 2 on solver.tolerance is 1e-09, was 1e-08"


def halve(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize("name", ["contact.h5", "solution.xdmf", "summary.json"])
def test_from_the_last_whole_step(copy, name):
    """A truncated file stops it with what to do; that is done, and the history is completed."""
    edit(copy)
    out = copy / "out"
    run_coulomb("resume", out)
    halve(out / "steps/0002" / name)
    done = run_coulomb("resume", out, code=2)
    assert len(done.stderr.splitlines()) == 1
    offer = "the last whole load step is 1: to continue from there, move steps/0002 out of "
    assert f"{name}: " in done.stderr and f"{offer}{out}, then: coulomb resume {out}" in done.stderr
    shutil.move(out / "steps/0002", copy)
    run_coulomb("resume", out)
    assert (out / "steps/0002/summary.json").is_file()
    run_coulomb("check", out)
    halve(out / "steps/0001" / "summary.json")
    assert f"no load step before is whole: move {out / 'steps'} away" in run_coulomb("resume", out, code=2).stderr


def test_runs_from_python_have_no_case(tmp_path, stopped):
    case = read_case(stopped / "case.toml")
    LoadHistory([0.5]).run(case.problem(comm), HistoryFiles(tmp_path / "out"))
    data = json.loads((tmp_path / "out" / "steps" / "0001" / "summary.json").read_text())
    assert "case" not in data["step"]


def test_the_digest_of_an_xdmf_mesh_covers_its_data(tmp_path):
    from coulomb.case.record import _digest

    (tmp_path / "part.xdmf").write_text('<Xdmf><DataItem Format="HDF">part.h5:/Mesh/x</DataItem></Xdmf>')
    (tmp_path / "part.h5").write_bytes(b"one")
    first = _digest(tmp_path / "part.xdmf")
    (tmp_path / "part.h5").write_bytes(b"two")
    assert _digest(tmp_path / "part.xdmf") != first


def test_of_a_finished_history_nothing_is_drawn_again(copy, monkeypatch):
    """The report is written where it is older than the results."""
    edit(copy, output={"report": True, "picture": False})
    report, summary = copy / "out" / "report.html", copy / "out" / "summary.json"
    monkeypatch.setattr(run_case, "write_report", lambda *_: report.write_text("drawn") * "")
    report.write_text("of the first step")
    run_coulomb("resume", copy / "out")
    assert report.read_text() == "drawn"
    report.write_text("up to date")
    run_coulomb("resume", copy / "out")
    assert report.read_text() == "up to date"
    os.utime(report, ns=(0, summary.stat().st_mtime_ns - 1))
    run_coulomb("resume", copy / "out")
    assert report.read_text() == "drawn"
