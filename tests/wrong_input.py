"""A wrong input: its definition, and the directories, files and faults it needs."""

import contextlib
import io
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
from conftest import SMALL_CASE as BLOCK
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.cli import app as cli
from coulomb.cli import console

comm = MPI.COMM_WORLD

FROM_FILE = BLOCK.replace("box = [3.0, 1.0, 1.0]\ncells = [3, 1, 1]", 'file = "part.msh"')
TOP = "[{face='top', value=[0,0,-1e-4], amplitude=[[0,0],[1,1]]}]"
STEPS = ("--set", f"clamp={TOP}", "--set", "traction=[]", "--set", "history={times=[0.5,1]}")


@dataclass(frozen=True)
class Wrong:
    """One wrong input.

    Attributes:
        what: In words.
        arguments: Of coulomb, in a directory where case.toml is BLOCK.
        message: Regular expression of what is said on standard error.
        prepare: What else is in that directory.
        patch: What is simulated.
        code: The exit code.
        alone: Whether the command runs on one rank only; False for both, None where it takes two ranks.
        library: Text of a library, which depends on its version, follows from here on.
    """

    what: str
    arguments: tuple[str, ...]
    message: str
    prepare: Callable[[], None] = lambda: None
    patch: Callable[[], contextlib.AbstractContextManager] = contextlib.nullcontext
    code: int = 2
    alone: bool | None = False
    library: str = ""


def run(*changes, case="case.toml"):
    return ("run", case, *(word for change in changes for word in ("--set", change)))


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
        case(BLOCK)()
        with said():
            cli.app([*run(*changes), "--quiet"], standalone_mode=False)
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
        mock.patch.object(
            console.errors, "_file", heard
        ),  # `file` cannot be taken back: it would stay what it was then
    ):
        yield heard
