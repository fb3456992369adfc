"""A wrong input: its definition, the directories, files and faults it needs, and its message beside docs/errors.md."""

import contextlib
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
from conftest import SMALL_CASE as BLOCK
from conftest import command_line
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.cli import console

comm = MPI.COMM_WORLD
DOCUMENT = Path(__file__).parents[1] / "docs" / "errors.md"

FROM_FILE = BLOCK.replace("box = [3.0, 1.0, 1.0]\ncells = [3, 1, 1]", 'file = "part.msh"')
TOP = "[{face='top', value=[0,0,-1e-4], amplitude=[[0,0],[1,1]]}]"
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
        message: Part of the message, where the document has none.
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


def part(spoil=lambda file: None, after=lambda text: text, **options):
    """A mesh file part.msh, changed before or after it is written, and a case that reads it."""

    def prepare():
        file = BoxFile(**options)
        spoil(file)
        path = file.write(Path("part.msh"))
        path.write_bytes(after(path.read_bytes()))
        case(FROM_FILE)()

    return prepare


def twenty_nodes():
    """A mesh file of a 20-node hexahedron, and a case that reads it."""
    numbers = range(1, 21)
    points = "".join(f"{i} {i} {i * i} {i**3}\n" for i in numbers)
    Path("part.msh").write_text(
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n20\n{points}$EndNodes\n"
        f"$Elements\n1\n1 17 2 1 1 {' '.join(map(str, numbers))}\n$EndElements\n"
    )
    case(FROM_FILE)()


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


def another_run():
    Path("results").mkdir()
    holder = "process 7 on elsewhere, since 2026-01-01 12:00:00 (coulomb run)"
    Path("results/run.lock").write_text(f"elsewhere another-boot: {holder}\n")


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
    """Its row in the document, without the text of libraries."""
    start = text.find(wrong.library) if wrong.library else -1
    text = text if start < 0 else text[: start + len(wrong.library)].rstrip() + " ..."
    ends = "" if code in (0, 2) else f" (exit code {code})"
    return f"| {wrong.what}{ends} | {'<br>'.join(text.replace('|', chr(92) + '|').splitlines())} |"


def document(table, answers):
    """The table in Markdown; on one rank.

    Args:
        table: The wrong inputs by section.
        answers: Exit codes and messages by `what`; the others are asked for.
    """
    lines = [
        "# Messages about wrong input",
        "",
        "Written by `python tests/wrong_inputs.py`; `tests/cli/test_errors.py` compares it on one rank and on two. An",
        "error ends with exit code 2 before anything is solved, unless another code is given; after a warning the run",
        "continues. Here the case is `case.toml`, its mesh `part.msh`, its output `results`.",
    ]
    for title, rows in table.items():
        lines += ["", f"## {title}", "", "| input | message |", "|---|---|"]
        for wrong in rows:
            if wrong.alone is not None:
                with tempfile.TemporaryDirectory() as directory:
                    lines.append(shown(wrong, *(answers.get(wrong.what) or answer(wrong, directory))))
    return "\n".join(lines) + "\n"


def disagreements(inputs):
    """Wrong inputs whose message is not that of the document, or not the same on all ranks; collective.

    Of those that rank 0 finds when it reads the case, the first twenty stand for all.
    """
    text = DOCUMENT.read_text(encoding="utf-8")
    faults, rows = [], re.sub(r"\d+", "#", text).splitlines()
    for k, wrong in enumerate(inputs):
        if wrong.alone or (k > 20 and f"| {wrong.what} | error: case.toml: " in text):
            continue
        directory = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
        answers = comm.allgather(answer(wrong, directory))
        if comm.rank == 0:
            shutil.rmtree(directory)
        if len(set(answers)) > 1:
            faults.append(f"{wrong.what}: the ranks do not agree: {answers}")
        code, text = answers[0]
        known = code == 2 and wrong.message in text if wrong.message else False
        if not known and re.sub(r"\d+", "#", shown(wrong, code, text)) not in rows:
            faults.append(f"{wrong.what}: exit code {code}, {text!r}")
    return faults
