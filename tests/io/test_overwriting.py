"""`coulomb run` into a directory with results: nothing is destroyed unless the user asks for it, nor by a kill."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import typer
from conftest import SMALL_CASE, run_coulomb, solved_block
from coulomb.cli.setting_aside import in_place_of
from coulomb.io.lock import locked
from coulomb.io.replacing import aside_in, commit, finish
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.io import output, replacing
from coulomb.io.recheck.directory import check

OTHER = ("--set", "contact.friction=0.4")
HISTORY = (
    "--set",
    "traction=[{face='top',value=[0,0,-1e7],amplitude=[[0,0],[1,1]]}]",
    "--set",
    "history={times=[0.5,1]}",
)
FILES = {"case.json", "contact.h5", "contact.xdmf", "history.csv", "solution.h5", "solution.xdmf", "summary.json"}


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(SMALL_CASE)


def run(*options, ranks=None, code=0, to="out", process=False):
    done = run_coulomb("run", "case.toml", "--output", to, "--quiet", *options, ranks=ranks, process=process)
    assert done.returncode == code, done.stderr
    return done.stderr


def everything(folder="out"):
    return {
        path.relative_to(folder): os.readlink(path) if path.is_symlink() else path.read_bytes()
        for path in sorted(Path(folder).rglob("*"))
        if path.is_symlink() or path.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The results of the small case, and of its history."""
    home = tmp_path_factory.mktemp("made")
    (home / "case.toml").write_text(SMALL_CASE)
    for name, options in (("single", ()), ("history", HISTORY)):
        done = run_coulomb("run", home / "case.toml", "--output", home / name, *options)
        assert done.returncode == 0, done.stderr
    return home


def there(made, name):
    shutil.copytree(made / name, "out")
    return everything()


def friction():
    return json.loads(Path("out/summary.json").read_text())["friction"]


def test_the_same_case_is_run_again_and_again(made):
    """Also with another method of solution, which gives the same answer."""
    there(made, "single")
    Path("out/notes.txt").write_text("mine")
    assert run("--set", "solver.method=successive-tresca") == ""
    assert json.loads(Path("out/summary.json").read_text())["method"]["solver"].startswith("successive")
    assert set(map(str, everything())) == FILES | {"notes.txt"} and check("out").passed


@pytest.mark.parametrize("ranks", [None, 2])
def test_another_case_is_refused_and_overwritten_on_request(made, ranks):
    before = there(made, "single")
    said = run(*OTHER, ranks=ranks, code=2)
    assert said.count("out holds the results of another case (contact.friction is 0.4, was 0.3)") == 1
    assert "--overwrite" in said and "--output" in said and everything() == before
    Path("out/notes.txt").write_text("mine")
    assert run(*OTHER, "--overwrite", ranks=ranks) == ""
    assert friction() == 0.4 and check("out").passed
    assert set(map(str, everything())) == FILES | {"notes.txt"}


@pytest.mark.parametrize(("there_is", "options"), [("history", ()), ("single", HISTORY), ("history", HISTORY)])
def test_histories_and_single_runs(made, there_is, options):
    before = there(made, there_is)
    said = run(*options, code=2)
    assert "--overwrite" in said and everything() == before
    assert ("coulomb resume out" in said) == (there_is == "history" and bool(options))
    run(*options, "--overwrite")
    assert check("out").passed and not aside_in(Path("out"))
    names = set(map(str, everything()))
    assert (
        names == FILES
        if not options
        else {name for name in names if "/" not in name}
        == FILES
        - {
            "contact.h5",
            "solution.h5",
        }
    )


def test_results_from_python(made):
    there(made, "single")
    Path("out/case.json").unlink()
    assert "run from Python" in run(code=2)
    run("--overwrite")
    assert check("out").passed


def test_a_changed_mesh_file_is_another_case():
    BoxFile().write(Path("part.msh"))
    mesh = SMALL_CASE.replace("box = [3.0, 1.0, 1.0]\ncells = [3, 1, 1]", 'file = "part.msh"')
    Path("case.toml").write_text(mesh)
    run()
    assert run() == ""  # the same again
    with Path("part.msh").open("a") as file:
        file.write("\n$Comments\nchanged\n$EndComments\n")
    assert "the contents of mesh.file" in run(code=2)


@pytest.mark.parametrize("name", ["history.csv", "picture.png", "solution.h5", "steps/data.txt"])
def test_files_of_the_user_are_never_replaced(name):
    """Even with names of our format, in a directory without results: not even if that is asked for."""
    path = Path("out", name)
    path.parent.mkdir(parents=True)
    path.write_text("a;b\n1;2\n")
    for options in ((), ("--overwrite",)):
        assert "is not known to be a result of coulomb" in run(*options, code=2)
    assert everything() == {Path(name): b"a;b\n1;2\n"}


def test_files_of_the_user_among_load_steps(made):
    there(made, "history")
    Path("out/steps/0001/notes.txt").write_text("mine")
    before = everything()
    assert "notes.txt is not a result of coulomb" in run("--overwrite", code=2)
    assert everything() == before


def test_write_protected_results(made):
    before = there(made, "single")
    Path("out/solution.h5").chmod(0o444)
    for options in ((), ("--overwrite",), (*OTHER, "--overwrite")):
        assert "out/solution.h5 is write-protected" in run(*options, code=2)
    assert everything() == before


def test_links_are_replaced_not_what_they_point_to(made):
    there(made, "history")
    shutil.move("out/steps", "elsewhere")
    Path("out/steps").symlink_to("../elsewhere")
    Path("kept.csv").write_bytes(Path("out/history.csv").read_bytes())
    Path("out/history.csv").unlink()
    Path("out/history.csv").symlink_to("../kept.csv")
    kept, elsewhere = Path("kept.csv").read_bytes(), everything("elsewhere")
    run(*OTHER, "--overwrite")
    assert check("out").passed and not any(path.is_symlink() for path in Path("out").iterdir())
    assert Path("kept.csv").read_bytes() == kept and everything("elsewhere") == elsewhere


def test_a_linked_directory(made):
    there(made, "single")
    shutil.move("out", "place")
    Path("out").symlink_to("place")
    run(*OTHER, "--overwrite")
    assert Path("out").is_symlink() and friction() == 0.4


def test_a_directory_in_use_is_refused(made):
    before = there(made, "single")
    with locked("out", MPI.COMM_SELF):
        assert "in use by" in run(*OTHER, "--overwrite", code=2, process=True)
    assert everything() == before


class KilledError(BaseException):
    """A kill."""


CHANGES = ("rename", "replace", "unlink", "rmdir")


@pytest.mark.parametrize("there_is", ["single", "history"])
def test_a_kill_at_any_moment_of_the_move(made, there_is, monkeypatch):
    """Before each change on disk in turn: with a summary the results are whole; the next run finishes the move."""
    there(made, there_is)
    old = everything()
    new = {Path(name): name.encode() for name in FILES} | {Path("summary.json"): b'{"new": 1}'}
    finished, kills = False, 0
    while not finished:
        shutil.rmtree("out")
        there(made, there_is)
        partial = Path("out/.partial-1")
        partial.mkdir()
        for name, text in new.items():
            (partial / name).write_bytes(text)
        left = kills
        with monkeypatch.context() as patch:
            for owner, name in ((os, "rename"), (os, "replace"), (Path, "unlink"), (Path, "rmdir")):
                real = getattr(owner, name)

                def change(*args, real=real, **options):
                    nonlocal left
                    left -= 1
                    if left < 0:
                        raise KilledError
                    return real(*args, **options)

                patch.setattr(owner, name, change)
            try:
                commit(partial, Path("out"))
                finished = True
            except KilledError:
                kills += 1
        found = everything()
        visible = {path: text for path, text in found.items() if not path.parts[0].startswith(".")}
        if Path("summary.json") in visible and visible[Path("summary.json")] == new[Path("summary.json")]:
            assert visible == new
        elif Path("summary.json") in visible:
            assert all(visible[path] == old.get(path) for path in visible)  # none of the new ones
        assert (
            any(
                all(found.get(place / path) == text for path, text in new.items())
                for place in (Path(), *(p.relative_to("out") for p in Path("out").glob(".*-1")))
            )
            or {**visible, **{p.relative_to(p.parts[0]): t for p, t in found.items() if p.parts[0][0] == "."}} == new
        )
        if list(Path("out").glob(".complete-*")):
            finish(Path("out"))
            assert everything() == new
        elif not finished:
            assert {path: text for path, text in everything().items() if path.parts[0] != ".partial-1"} == old
    assert everything() == new and kills >= 10


def test_the_next_run_finishes_a_move(made):
    there(made, "single")
    Path("out/.complete-x").mkdir()
    for name in ("summary.json", "solution.h5"):
        shutil.move(f"out/{name}", f"out/.complete-x/{name}")
    with locked("out", MPI.COMM_SELF):
        assert set(map(str, everything())) == FILES | {"run.lock"}
    assert check("out").passed


def test_a_full_disk_keeps_the_old_results(made, monkeypatch):
    solution, before = solved_block(2), there(made, "single")

    def full(*_):
        raise OSError(28, "No space left on device")

    for function in ("_write_fields", "write_grids", "write_json"):
        with monkeypatch.context() as patch:
            patch.setattr(output, function, full)
            with pytest.raises(OSError, match="No space"):
                output.write(solution, "out", overwrite=True)
        assert everything() == before


def test_python_refuses_to_write_into_a_history(made):
    before = there(made, "history")
    with pytest.raises(ValueError, match="holds a load history of 2 steps"):
        solved_block(2).write("out")
    assert everything() == before


SLOW = ("--set", "mesh.cells=[12,6,6]", "--set", "history={end=1, steps=20}", *HISTORY[:2])


def test_a_killed_history_keeps_the_old_results(made):
    """The old ones wait beside the new steps; they are removed when `coulomb resume` completes the history."""
    before = there(made, "single")
    command = [sys.executable, "-m", "coulomb", "run", "case.toml", "--output", "out", "--overwrite", *SLOW]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while not Path("out/steps/0002/summary.json").exists():
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    kept = {path: text for path, text in everything("out/replaced-1").items() if path.name != "REPLACED.txt"}
    assert kept == before and check("out/replaced-1").passed
    done = run_coulomb("resume", "out")
    assert done.returncode == 0, done.stderr
    assert check("out").passed and not Path("out/replaced-1").exists()


@pytest.mark.parametrize("there_is", ["single", "history"])
def test_a_history_that_ends_before_its_first_step(made, there_is):
    before = there(made, there_is)
    with pytest.raises(typer.Exit), in_place_of(Path("out"), True, False, MPI.COMM_SELF):
        assert not (FILES - {"REPLACED.txt"}).intersection(map(str, everything()))
        Path("out/case.json").write_text("{}")
        raise typer.Exit(130)
    assert everything() == before


def test_files_that_cannot_be_set_aside_stay(made, monkeypatch):
    before, real = there(made, "single"), os.rename

    def refuse(one, other):
        if Path(one).name == "solution.h5":
            raise OSError(5, "Input/output error")
        real(one, other)

    monkeypatch.setattr(replacing.os, "rename", refuse)
    with pytest.raises(typer.Exit), in_place_of(Path("out"), True, False, MPI.COMM_SELF):
        pass
    assert everything() == before


def test_results_set_aside_are_removed_only_on_request(made):
    """A later run without --overwrite leaves them; foreign files in them are left in any case."""
    there(made, "history")
    replacing.set_aside(Path("out"))
    run(*HISTORY)
    assert Path("out/replaced-1/summary.json").exists()
    Path("out/replaced-1/steps/0001/notes.txt").write_text("mine")
    run(*HISTORY, "--overwrite")
    assert everything("out/replaced-1") == {Path("steps/0001/notes.txt"): b"mine"}
    assert np.all([step.passed for step in check("out").steps])
