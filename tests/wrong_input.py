"""A wrong input: its definition, what it needs of files and faults, and its message (data/wrong_inputs.json)."""

import contextlib
import fcntl
import io
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
from case_texts import body
from conftest import SMALL_CASE as BLOCK
from conftest import command_line
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.cli import console

comm = MPI.COMM_WORLD
FILE = Path(__file__).parent / "data" / "wrong_inputs.json"
MESSAGES = json.loads(FILE.read_text(encoding="utf-8"))
"""By the wrong input in words: its message, its exit code if not 2; and where a case is changed by `--set` alone, the
changes, the command if it is not `run`, the case if it is not BLOCK."""

FROM_FILE = BLOCK.replace("box = [3.0, 1.0, 1.0]\ncells = [3, 1, 1]", 'file = "part.msh"')
TOP = "[{face='top', value=[0,0,-1e-4], amplitude=[[0,0],[1,1]]}]"
BODIES = """
contact = { face = "upper:bottom", against = "lower:top", friction = 0.3 }
clamp = [{ face = "lower:bottom" }, { face = "upper:top" }]
"""
UNIT = (1.0, 1.0, 1.0), (1, 1, 1)
BODIES += body("lower", *UNIT) + body("upper", *UNIT, (0.0, 0.0, 1.0))
STEPS = (f"clamp={TOP}", "traction=[]", "history={times=[0.5,1]}")


@dataclass(frozen=True)
class Wrong:
    """One wrong input.

    Attributes:
        what: In words.
        arguments: Of coulomb, in a directory where case.toml is BLOCK.
        prepare: What else is in that directory.
        patch: What is simulated.
        alone: Whether the command runs on one rank only; False for both, None where it takes two ranks.
        library: Text of a library, which depends on its version, follows from here on.
        message: Part of the message, where the file has none.
    """

    what: str
    arguments: tuple[str, ...]
    prepare: Callable[[], None] = lambda: None
    patch: Callable[[], contextlib.AbstractContextManager] = contextlib.nullcontext
    alone: bool | None = False
    library: str = ""
    message: str = ""


def run(*changes, case="case.toml", command="run"):
    return (command, case, *(word for change in changes for word in ("--set", change)))


def case(text, name="case.toml"):
    return lambda: Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())


two = case(BODIES)


def recorded(what):
    """A wrong input that is in the file as a whole."""
    of = MESSAGES[what]
    return Wrong(what, run(*of["set"], command=of.get("command", "run")), two if "case" in of else lambda: None)


def part(spoil=lambda file: None, after=lambda text: text, **options):
    """A mesh file part.msh, changed before or after it is written, and a case that reads it."""

    def prepare():
        file = BoxFile(**options)
        spoil(file)
        path = file.write(Path("part.msh"))
        path.write_bytes(after(path.read_bytes()))
        case(FROM_FILE)()

    return prepare


def turn_cell(file):
    file.cells[0, [0, 1]] = file.cells[0, [1, 0]]


def flatten(file):
    file.points[:, 2] = 0.0


def hinge(file):
    """Gives the cells of one half nodes of their own, except along one edge."""
    stiff, again = file.cell_groups["stiff"], np.arange(len(file.points)) + len(file.points)
    edge = np.flatnonzero(file.points[:, 2] == 0.0)
    again[edge] = edge
    file.cells[stiff] = again[file.cells[stiff]]
    file.points = np.vstack([file.points, file.points])
    file.faces = {}


def only_faces(file):
    file.cell_groups = {}


def ran(*changes, then=lambda: None):
    """An earlier run, in results."""

    def prepare():
        with said() as heard:
            code = command_line()([*run(*changes), "--quiet"], standalone_mode=False)
        assert not code, heard.getvalue()
        if comm.rank == 0:
            then()

    return prepare


def edit_written_case():
    path = Path("results/case.json")
    written = json.loads(path.read_text())
    written["mesh"]["cells"] = [4, 1, 1]
    path.write_text(json.dumps(written))


@contextlib.contextmanager
def another_run():
    """A run that holds the directory of the results."""
    if comm.rank == 0:
        Path("results").mkdir()
    with Path("results/run.lock").open("w") if comm.rank == 0 else contextlib.nullcontext() as file:
        if file is not None:
            fcntl.flock(file, fcntl.LOCK_EX)
            print("process 7 on elsewhere, since 2026-01-01 12:00:00 (coulomb run)", file=file, flush=True)
        yield


def cut(path):
    return lambda: Path(path).write_bytes(Path(path).read_bytes()[:2000])


def without_field():
    with h5py.File("results/contact.h5", "r+") as file:
        del file["Function/face"]


def memory(free):
    return lambda: mock.patch("coulomb.model.memory.free_memory", lambda: free)


def disk(free):
    return lambda: mock.patch("coulomb.io.output.shutil.disk_usage", lambda _: shutil._ntuple_diskusage(0, 0, free))


@contextlib.contextmanager
def said():
    """The standard error of this rank."""
    heard = io.StringIO()
    with (
        mock.patch.object(console.errors, "quiet", False),
        mock.patch.object(console.console, "quiet", True),
        mock.patch.object(console.errors, "_file", heard),  # `file` cannot be taken back: it would stay what it was
    ):
        yield heard


def answer(wrong, directory):
    """Exit code of a wrong input in an empty directory, and this rank's message; collective."""
    home = Path.cwd()
    os.chdir(directory)
    try:
        if comm.rank == 0:
            case(BLOCK)()
        comm.barrier()
        collective = getattr(wrong.prepare, "__qualname__", "").startswith("ran.")
        if collective or comm.rank == 0:
            wrong.prepare()
        comm.barrier()
        with said() as heard, wrong.patch():
            try:
                command_line()(list(wrong.arguments))
                code = 0
            except SystemExit as end:
                code = end.code or 0
        comm.barrier()
    finally:
        os.chdir(home)
    text = heard.getvalue().strip().replace(f"{directory}/", "").replace(str(directory), ".")
    return code, text


def shown(wrong, code, text):
    """What the file has of it, without the text of libraries."""
    start = text.find(wrong.library) if wrong.library else -1
    text = text if start < 0 else text[: start + len(wrong.library)].rstrip() + " ..."
    return {"message": text} if code == 2 else {"code": code, "message": text}


def known(what):
    return {key: value for key, value in MESSAGES[what].items() if key in ("code", "message")}


def rewrite(inputs):
    """Write the file anew, with the messages as they are now; on one rank."""
    for wrong in inputs:
        if wrong.alone is not None:
            with tempfile.TemporaryDirectory() as directory:
                of = MESSAGES.setdefault(wrong.what, {})
                of.pop("code", None)
                of.update(shown(wrong, *answer(wrong, directory)))
    FILE.write_text(json.dumps(MESSAGES, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def disagreements(inputs):
    """Wrong inputs whose message is not that of the file, or not the same on all ranks; collective.

    Of those that rank 0 finds when it reads the case, the first twenty stand for all.
    """

    def without_numbers(of):
        return {**of, "message": re.sub(r"\d+", "#", of["message"])}

    faults, read = [], 0
    for wrong in inputs:
        if wrong.alone:
            continue
        if wrong.what in MESSAGES and MESSAGES[wrong.what]["message"].startswith("error: case.toml: "):
            read += 1
            if read > 20:
                continue
        directory = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
        answers = comm.allgather(answer(wrong, directory))
        if comm.rank == 0:
            shutil.rmtree(directory)
        if len(set(answers)) > 1:
            faults.append(f"{wrong.what}: the ranks do not agree: {answers}")
        code, text = answers[0]
        if wrong.message:
            expected = code == 2 and wrong.message in text
        else:
            expected = without_numbers(shown(wrong, code, text)) == without_numbers(known(wrong.what))
        if not expected:
            faults.append(f"{wrong.what}: exit code {code}, {text!r}")
    return faults
