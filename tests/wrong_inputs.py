"""Wrong inputs, and what is said of each: the table behind docs/errors.md.

Written anew by `python tests/wrong_inputs.py`; `mpirun -n 2 python tests/wrong_inputs.py` walks through it on two ranks
and compares what every rank says.
"""

import contextlib
import io
import json
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import h5py
import numpy as np
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.cli import app as cli
from coulomb.cli import console

comm = MPI.COMM_WORLD
DOCUMENT = Path(__file__).parents[1] / "docs" / "errors.md"

BLOCK = """\
[mesh]
box = [3.0, 1.0, 1.0]
cells = [3, 1, 1]
[material]
young = 2e11
poisson = 0.3
[[clamp]]
face = "left"
[[traction]]
face = "top"
value = [0.0, 0.0, -1e7]
[contact]
face = "bottom"
friction = 0.3
[output]
picture = false
"""

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
        library: From here on a library speaks, in words that change from version to version.
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
    """A mesh file part.msh, spoilt before or after it is written, and a case that reads it."""

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


def tear(file):
    """The cells of one half get nodes of their own."""
    stiff = file.cell_groups["stiff"]
    file.cells[stiff] += len(file.points)
    file.points = np.vstack([file.points, file.points + [5.0, 0.0, 0.0]])
    file.faces = {}


def only_faces(file):
    file.cell_groups = {}


def ran(*changes, then=lambda: None):
    """A run before, in results."""

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
    told = {
        "pid": 7,
        "host": "elsewhere",
        "started": "boot 1",
        "since": "2026-01-01 12:00:00",
        "command": "coulomb run",
    }
    Path("results/run.lock").write_text(json.dumps(told))


def cut(path):
    return lambda: Path(path).write_bytes(Path(path).read_bytes()[:2000])


def without_field():
    with h5py.File("results/contact.h5", "r+") as file:
        del file["Function/face"]


def without_mumps():
    system = SimpleNamespace(hasExternalPackage=lambda name: name != "mumps")
    return mock.patch("coulomb.linalg.methods.PETSc", SimpleNamespace(Sys=system))


def memory(free):
    return lambda: mock.patch("coulomb.model.estimate.free_memory", lambda: free)


def disk(free):
    return lambda: mock.patch("coulomb.io.output.shutil.disk_usage", lambda _: shutil._ntuple_diskusage(0, 0, free))


class FullDisk:
    """What DOLFINx makes of a disk that is full: here on the last rank alone."""

    def write_mesh(self, _):
        if comm.rank == comm.size - 1:
            raise RuntimeError("Failed to write HDF5 local dataset into hyperslab.")


CASE_FILES = (
    Wrong(
        "a case that does not exist", run(case="none.toml"), r"none\.toml: cannot be read: No such file or directory"
    ),
    Wrong("a directory in place of the case", run(case="."), r"\.: cannot be read: Is a directory"),
    Wrong(
        "a case cut short",
        run(),
        r"case\.toml: is not TOML: .*table declaration",
        case("[mesh"),
        library="is not TOML: ",
    ),
    Wrong(
        "a case that is no text",
        run(),
        r"case\.toml: cannot be read: it is no text in UTF-8: ",
        case(b"\xfc\xff"),
        library="UTF-8: ",
    ),
    Wrong(
        "a case in UTF-16",
        run(),
        r"case\.toml: cannot be read: it is text in UTF-16; save it as UTF-8",
        case(BLOCK.encode("utf-16")),
    ),
    Wrong(
        "a pipe for a case",
        run(case="pipe"),
        r"pipe: cannot be read: it is a pipe: save the contents in a file first",
        lambda: os.mkfifo("pipe"),
    ),
    Wrong(
        "single brackets",
        run(),
        r"clamp: there may be several: write \[\[clamp\]\], with double brackets, in place of \[clamp\]",
        case(BLOCK.replace("[[clamp]]", "[clamp]")),
    ),
    Wrong(
        "a value for a table",
        run(),
        r"mesh = 'part\.msh': is a table: write \[mesh\], and below it its keys, for example file = 'part\.msh'",
        case('mesh = "part.msh"\n' + BLOCK[BLOCK.index("[material]") :]),
    ),
    Wrong(
        "a key below a table that belongs above all",
        run(),
        r"output\.body_force = .*; it belongs at the top of the file, above the first table",
        case(BLOCK + "body_force = [0, 0, 1]\n"),
    ),
    Wrong(
        "lists in lists without end",
        run(),
        r"case\.toml: is not a case: lists or tables are nested too deeply",
        case(BLOCK + "a = " + 10_000 * "["),
    ),
    Wrong(
        "a name of 300 characters",
        run(f"contact.face='{'x' * 300}'"),
        r"contact\.face = 'x+\.\.\.x+': should have at most 200 characters",
    ),
    Wrong("an empty case", run(), r"mesh: is missing\n.*material: is missing\n.*contact: is missing", case("")),
    Wrong(
        "a misspelt key", run("contact.fricton=0.3"), r"contact\.fricton = 0\.3: there is no such key; did you mean fri"
    ),
    Wrong("a misspelt table", run("clmap=[]"), r"clmap = \[\]: there is no such key; did you mean clamp\?"),
    Wrong(
        "words for a number", run("contact.friction='rough'"), r"contact\.friction = 'rough': should be a valid number"
    ),
    Wrong("true for a number", run("material.young=true"), r"material\.young = True: should be a valid number"),
    Wrong(
        "large strains to be ignored",
        run("small_strain='ignore'"),
        r"small_strain = 'ignore': should be 'enforce' or 'warn'",
    ),
    Wrong("two numbers for three", run("traction.0.value=[0,1]"), r"traction\.0\.value.* is missing"),
    Wrong(
        "--set without a value", run("friction"), r"--set friction: must be key\.key=value, for example mesh\.cells="
    ),
    Wrong(
        "--set in a table that is not there",
        run("traction.7.face='top'"),
        r"no such place in the case; lists count from 0",
    ),
    Wrong("an unknown method", run("solver.linear_solver='lu'"), r"'lu': should be 'auto', 'direct' or 'iterative'"),
    Wrong(
        "too loose a tolerance",
        run("solver.tolerance=1e-3"),
        r"solver\.tolerance = 0\.001: should be less than or equal",
    ),
    Wrong(
        "A to be formed, K not to be factorised",
        run("solver={linear_solver='iterative', compliance='explicit'}"),
        r'A can be formed \(solver\.compliance = "explicit".*set solver\.linear_solver = "direct"',
    ),
    Wrong(
        "dense Newton systems on two ranks",
        run("solver.newton='dense'"),
        r'solver\.newton = "dense" works on one rank',
        alone=None,
    ),
)

MATERIALS_AND_LOADS = (
    Wrong("Poisson's ratio 0.5", run("material.poisson=0.5"), r"material\.poisson = 0\.5: should be less than 0\.5"),
    Wrong(
        "Poisson's ratio 0.4999999",
        ("check-case", "case.toml", "--set", "material.poisson=0.4999999"),
        r"warning: material: poisson = 0\.4999999 is near 0\.5: above 0\.49 first-order elements lock",
        code=0,
    ),
    Wrong("no stiffness", run("material.young=0"), r"material\.young = 0: should be greater than 0"),
    Wrong(
        "negative friction", run("contact.friction=-0.3"), r"contact\.friction = -0\.3: should be greater than or equal"
    ),
    Wrong(
        "both friction laws",
        run("contact.slip_stress=1e6"),
        r"give either friction \(Coulomb\) or slip_stress \(Tresca\)",
    ),
    Wrong(
        "a load of NaN", run("traction.0.value=[0,0,nan]"), r"traction\.0\.value\.2 = nan: should be a finite number"
    ),
    Wrong(
        "an infinite displacement",
        run("clamp.0.value=[inf,0,0]"),
        r"clamp\.0\.value\.0 = inf: should be a finite number",
    ),
    Wrong(
        "a spring of no stiffness",
        run("spring=[{face='top', stiffness=0}]"),
        r"spring on 'top': stiffness .* not all 0",
    ),
    Wrong(
        "springs too soft to be told from rounding errors",
        run("clamp=[]", "spring=[{face='top', stiffness=1e-6}]"),
        r"the springs are too soft .* make the springs stiffer, or hold the body by a clamp",
    ),
    Wrong(
        "nothing that holds the body",
        run("clamp=[]"),
        r"the body floats: .* leave it translation along x, .*; hold these",
    ),
    Wrong(
        "an amplitude whose times do not increase",
        run("history={times=[1]}", "clamp.0.amplitude=[[0,0],[1,1],[1,2]]"),
        r"clamp on 'left'.*: the times of the table must increase, but are \[0\.0, 1\.0, 1\.0\]",
    ),
    Wrong(
        "an amplitude without a history",
        run("traction.0.amplitude=[[0,0],[1,1]]"),
        r"depends on time: it needs a \[history\]",
    ),
    Wrong(
        "a foundation that moves without a history",
        run("contact.motion=[[0,0,0,0],[1,0,0,1e-3]]"),
        r"contact\.motion depends on time: it needs a \[history\]",
    ),
    Wrong(
        "a thousand million load steps",
        run("history={end=1.0, steps=1000000000}"),
        r"history\.steps = 1000000000: should be less than or equal to 100000",
    ),
    Wrong(
        "friction that is next to nothing",
        run("contact.friction=1e-300"),
        r"contact\.friction = 1e-300: should be 0, or from 1e-09 to 1000 in size",
    ),
    Wrong("a history without times", run("history={halvings=3}"), r"give either times, .*, or end and steps"),
    Wrong(
        "a history that goes back",
        run("history={times=[1,0.5]}"),
        r"times must increase from start = 0, but are \[1\.0, 0\.5\]",
    ),
)

MESHES = (
    Wrong("a box of negative length", run("mesh.box=[3,-1,1]"), r"mesh\.box\.1 = -1: should be greater than 0"),
    Wrong("a box of no size", run("mesh.box=[1e-200,1,1]"), r"mesh\.box\.0 = 1e-200: should be from 1e-12 to 1e\+12"),
    Wrong(
        "a pipe for a mesh",
        run("mesh={file='part.msh'}"),
        r"part\.msh: cannot be read: it is a pipe: save the contents in a file first",
        lambda: os.mkfifo("part.msh"),
    ),
    Wrong("no cells", run("mesh.cells=[3,0,1]"), r"mesh\.cells\.1 = 0: should be greater than or equal to 1"),
    Wrong(
        "an unknown face of a box",
        run("contact.face='botom'"),
        r"contact\.face = 'botom': should be 'left', .* or 'top'",
    ),
    Wrong("no mesh file", run(), r"part\.msh: cannot be read: No such file or directory", case(FROM_FILE)),
    Wrong("a mesh file cut short", run(), r"part\.msh: .*cut short", part(after=lambda text: text[:-300])),
    Wrong(
        "a text in place of a mesh",
        run(),
        r"part\.msh: is not a MSH file of gmsh's: it does not begin with \$MeshFormat",
        part(after=lambda _: b"Dear Sir,\n"),
    ),
    Wrong("an empty mesh file", run(), r"part\.msh: ", part(after=lambda _: b"")),
    Wrong(
        "a mesh of an old format",
        run(),
        r"is of MSH version 1\.0; save it as 4\.1 or 2\.2",
        part(after=lambda text: text.replace(b"2.2 0 8", b"1.0 0 8")),
    ),
    Wrong("a mesh of an unknown kind", run("mesh={file='part.vtk'}"), r"file must end in \.msh \(gmsh\) or \.xdmf"),
    Wrong(
        "a mesh without the named face",
        run("contact.face='sole'"),
        r"no face 'sole' on this mesh.*; its faces are left",
        part(),
    ),
    Wrong(
        "cells inside out",
        run(),
        r"1 of 16 cells .* changes its sign: it is turned inside out; repair",
        part(turn_cell),
    ),
    Wrong("cells without volume", run(), r"16 of 16 cells .* no volume; repair the mesh", part(flatten)),
    Wrong("a mesh in 2D", run(), r"part\.msh: has no cells in 3D .*mesh the volume \(gmsh -3\)", part(only_faces)),
    Wrong(
        "second-order cells",
        run(),
        r"has 20-node hexahedra, but contact needs first-order cells",
        lambda: (
            case(FROM_FILE)(),
            Path("part.msh").write_text(
                "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n20\n"
                + "".join(f"{i} {i} {i * i} {i**3}\n" for i in range(1, 21))
                + "$EndNodes\n$Elements\n1\n1 17 2 1 1 "
                + " ".join(map(str, range(1, 21)))
                + "\n$EndElements\n"
            ),
        ),
    ),
    Wrong("two bodies", run(), r"its cells make 2 bodies that share no facets \(8, 8 cells\)", part(tear)),
    Wrong(
        "a face inside the body",
        run("contact.face='seam'"),
        r"face group 'seam' of .*part\.msh lies inside the body with 4 of its 4 facets",
        part(lambda file: file.faces.update(seam=file.interface)),
    ),
    Wrong(
        "a contact face without area",
        run("contact.face='nothing'"),
        r"contact: face group 'nothing' of part\.msh is empty",
        part(lambda file: file.faces.update(nothing=np.empty((0, 4), dtype=int))),
    ),
    Wrong("a unit of no length", run("mesh.scale=0"), r"mesh\.scale = 0: should be greater than 0", part()),
    Wrong("a box with a scale", run("mesh.scale=1e-3"), r"scale does not go with a box mesh"),
    Wrong(
        "a material for cells that are not there",
        run("material=[{cells='wood', young=1e10, poisson=0.3}]"),
        r"material: there is no cell group 'wood' on this mesh; its cell groups are soft, stiff",
        part(),
    ),
    Wrong(
        "cells without a material",
        run("material=[{cells='soft', young=1e10, poisson=0.3}]"),
        r"material: 8 of 16 cells are without a material",
        part(),
    ),
    Wrong("no XDMF file", run("mesh={file='part.xdmf'}"), r"part\.xdmf: cannot be read: No such file"),
    Wrong(
        "an XDMF file that is none",
        run("mesh={file='part.xdmf'}"),
        r"part\.xdmf: is not XDMF",
        case("Dear Sir,", "part.xdmf"),
        library="is not XDMF",
    ),
)

CONTACT = (
    Wrong(
        "a contact face that is fully clamped",
        run("contact.face='left'"),
        r"'left' is fully clamped: none of its nodes",
    ),
    Wrong(
        "a contact face dragged by a clamp",
        run("clamp=[{face='left'}, {face='bottom', components='x', value=[1e-3,0,0]}]"),
        r"is dragged along the foundation by a clamp of non-zero value; clamp it in full",
    ),
    Wrong(
        "a contact face held obliquely",
        run(
            "clamp=[{face='left'},{face='right',components='x'}]",
            "contact.foundation={point=[0,0,0], normal=[0.3,0,1]}",
        ),
        r"is held by a clamp obliquely to the foundation's normal",
    ),
    Wrong(
        "a foundation turned away",
        run("contact.foundation={point=[0,0,0], normal=[0,0,-1]}"),
        r"contact face 'bottom' is turned away from the foundation: turn the normal round",
    ),
    Wrong(
        "a foundation that moves to the other side",
        (
            *("check-case", "case.toml", "--set", "history={times=[1, 2]}"),
            *("--set", "contact.foundation={shape='sphere', centre=[1.5,0.5,-9], radius=9}"),
            *("--set", "contact.motion=[[1,0,0,0], [2,0,0,20]]"),
        ),
        r"contact face 'bottom' is turned away from the foundation",
    ),
    Wrong(
        "a plane without a direction",
        run("contact.foundation={point=[0,0,0], normal=[0,0,0]}"),
        r"plane: normal must not be zero",
    ),
    Wrong(
        "a sphere of radius 0",
        run("contact.foundation={shape='sphere', centre=[0,0,-1], radius=0}"),
        r"contact\.foundation\.radius = 0: should be greater than 0",
    ),
    Wrong(
        "a sphere without a centre",
        run("contact.foundation={shape='sphere', radius=1}"),
        r'a foundation of shape "sphere" needs centre',
    ),
    Wrong(
        "a region without nodes",
        run("contact.region=[{box=[[5,5,5],[6,6,6]], friction=0.1}]"),
        r"contact\.region\.0: there is no contact node in its box",
    ),
    Wrong(
        "a region whose corners are exchanged",
        run("contact.region=[{box=[[1,1,1],[0,0,0]], friction=0.1}]"),
        r"box must be \[least corner, greatest corner\]",
    ),
    Wrong(
        "a curved contact face without a foundation",
        run("contact.face='both'"),
        r"contact face 'both' is not plane: say which foundation it may touch",
        part(lambda file: file.faces.update(both=np.vstack([file.faces["bottom"], file.faces["right"]]))),
    ),
)

RESOURCES = (
    Wrong(
        "too little memory for the method asked for",
        run("mesh.cells=[24,8,8]", "solver={linear_solver='direct', compliance='explicit'}"),
        r"too little memory: 5832 displacement and 648 contact unknowns \(K factorised, A formed\) need about 0\.\d+ GB"
        r", and 0\.\d+ GB are free; take .*solver\.linear_solver = \"iterative\".* GB\), a coarser mesh, .*--force",
        patch=memory(1.7e8 if comm.size == 1 else 3.2e8),
    ),
    Wrong(
        "a mesh beyond any memory",
        run("mesh.cells=[3000,1000,1000]"),
        r"a mesh of 3000 x 1000 x 1000 cells has 9021\d{6} displacement unknowns, which need at least 22553 GB, and "
        r"16 GB are free; take fewer cells",
        patch=memory(1.6e10),
    ),
    Wrong(
        "more unknowns than PETSc has numbers for",
        (*run("mesh.cells=[100000,100000,100000]"), "--force"),
        r"too many unknowns: a mesh of 100000 x 100000 x 100000 cells .* PETSc counts to \d+; take fewer cells",
        library="this PETSc counts",
    ),
    Wrong(
        "a factorisation without MUMPS",
        run("solver={linear_solver='direct', compliance='matrix-free'}"),
        r"this PETSc was built without MUMPS, which factorises K on several ranks and where A is not formed: leave .* "
        r'at "auto", which then is multigrid',
        patch=without_mumps,
    ),
    Wrong(
        "a disk without room for the results",
        run(),
        r"output results: no space left: the results take about 0\.0\d+ MB, and 0\.001 MB are free; --force",
        patch=disk(1000),
    ),
    Wrong(
        "a disk that fills up while results are written",
        run(),
        r"results: cannot be written: Failed to write HDF5 local dataset into hyperslab; is the disk full\?",
        patch=lambda: mock.patch("coulomb.fem.compat.xdmf_writer", lambda *_: FullDisk()),
        code=1,
    ),
    Wrong(
        "no permission to write the results",
        run(),
        r"output results: cannot be written: no permission to write in .*; choose another \(--output\)",
        patch=lambda: mock.patch("os.access", lambda _, mode: not mode & os.W_OK),
    ),
    Wrong(
        "an output directory with too long a name",
        (*run(), "--output", "x" * 300),
        r"output x+: cannot be written: File name too long; choose another",
    ),
    Wrong(
        "a file in place of the output directory",
        (*run(), "--output", "case.toml"),
        r"output case\.toml: cannot be written: .*case\.toml is no directory",
    ),
    Wrong("a log that cannot be written", (*run(), "--log", "."), r"--log \.: cannot be written: Is a directory"),
)

COMMANDS = (
    Wrong(
        "resume where nothing has run", ("resume", "results"), r"results: no case to resume: case\.json cannot be read"
    ),
    Wrong(
        "resume with another mesh",
        ("resume", "results"),
        r"results: the case is no longer the one that its 2 load steps were computed from: mesh\.cells\.0 is 4, was 3; "
        r"put that back \(case\.json\), or run the changed case in another directory",
        ran(*STEPS[1::2], then=edit_written_case),
    ),
    Wrong(
        "a directory that belongs to another run",
        run(),
        r"results is in use by process 7 on elsewhere, since .* \(coulomb run\), which cannot be seen from .*; if that "
        r"run is known to have ended, remove results/run\.lock",
        another_run,
        library="cannot be seen from ",
    ),
    Wrong(
        "resume with a step cut short",
        ("resume", "results"),
        r"results/steps/0002/solution\.h5: ",
        ran(*STEPS[1::2], then=cut("results/steps/0002/solution.h5")),
        library="solution.h5: ",
    ),
    Wrong(
        "a history where another one is",
        run(*STEPS[1::2]),
        r"results already holds 2 load steps: continue with `coulomb resume results`, remove it",
        ran(*STEPS[1::2]),
    ),
    Wrong("check where nothing has run", ("check", "."), r"summary\.json: cannot be read: No such file", alone=True),
    Wrong(
        "check of results cut short",
        ("check", "results"),
        r"results: is not whole: ",
        ran(then=cut("results/solution.h5")),
        alone=True,
        library="is not whole: ",
    ),
    Wrong(
        "check of a summary that is none",
        ("check", "."),
        r"summary\.json: has no 'law'",
        case("{}", "summary.json"),
        alone=True,
    ),
    Wrong(
        "check of results of another version",
        ("check", "results"),
        r"contact\.h5: has no field 'face': not whole, or written by another version of coulomb: run the case again",
        ran(then=without_field),
        alone=True,
    ),
    Wrong(
        "check of a history without one of its steps",
        ("check", "results"),
        r"0001: is not whole or missing, but there is a step 0002",
        ran(*STEPS[1::2], then=lambda: Path("results/steps/0001/summary.json").unlink()),
        alone=True,
    ),
    Wrong("check on two ranks", ("check", "."), r"coulomb check runs on one rank", alone=None),
    Wrong(
        "fclib without a file",
        ("fclib", "none.hdf5"),
        r"none\.hdf5: cannot be read",
        alone=True,
        library="cannot be read",
    ),
    Wrong(
        "export of Tresca friction",
        ("export", "case.toml", "out.hdf5", "--set", "contact={face='bottom',slip_stress=1e6}"),
        r"FCLIB's problems have Coulomb friction; this case has a slip stress",
        alone=True,
    ),
    Wrong("new where a file is", ("new", "block", "case.toml"), r"case\.toml: exists already; --force replaces it"),
    Wrong(
        "new in a directory that is not there",
        ("new", "block", "there/a.toml"),
        r"there/a\.toml: cannot be written: No such",
    ),
)

TABLE = {
    "Case files": CASE_FILES,
    "Materials, loads, history": MATERIALS_AND_LOADS,
    "Meshes": MESHES,
    "Contact": CONTACT,
    "Machine": RESOURCES,
    "Commands": COMMANDS,
}
ALL = [wrong for rows in TABLE.values() for wrong in rows]


@contextlib.contextmanager
def said():
    """What is said on standard error, by this rank."""
    heard = io.StringIO()
    with (
        mock.patch.object(console.errors, "quiet", False),
        mock.patch.object(console.console, "quiet", True),
        mock.patch.object(
            console.errors, "_file", heard
        ),  # `file` cannot be taken back: it would stay what it was then
    ):
        yield heard


def answer(wrong, directory):
    """Exit code of a wrong input in an empty directory, and what this rank says; collective."""
    home = Path.cwd()
    os.chdir(directory)
    try:
        if comm.rank == 0:
            case(BLOCK)()
        collective = getattr(wrong.prepare, "__qualname__", "").startswith("ran.")
        if collective or comm.rank == 0:
            wrong.prepare()
        comm.barrier()
        with said() as heard, wrong.patch():
            try:
                cli.app(list(wrong.arguments))
                code = 0
            except SystemExit as end:
                code = end.code or 0
        comm.barrier()
    finally:
        os.chdir(home)
    text = heard.getvalue().strip().replace(f"{directory}/", "").replace(str(directory), ".")
    return code, text


def shown(wrong, text):
    """As the document has it: what libraries say is left to them."""
    start = text.find(wrong.library) if wrong.library else -1
    return text if start < 0 else text[: start + len(wrong.library)].rstrip() + " ..."


def document():
    """The table in Markdown; on one rank."""
    lines = [
        "# What is said of wrong input",
        "",
        "Written by `python tests/wrong_inputs.py`; `tests/test_errors.py` compares, on one rank and on two. An error",
        "ends with exit code 2 before anything is solved, where no other is named; a warning lets the run go on. Here",
        "the case is `case.toml`, its mesh `part.msh`, its output `results`.",
    ]
    for title, rows in TABLE.items():
        lines += ["", f"## {title}", "", "| input | what is said |", "|---|---|"]
        for wrong in rows:
            if wrong.alone is None:
                continue
            with tempfile.TemporaryDirectory() as directory:
                code, text = answer(wrong, directory)
            ends = "" if code in (0, 2) else f" (exit code {code})"
            told = "<br>".join(shown(wrong, text).replace("|", r"\|").splitlines())
            lines.append(f"| {wrong.what}{ends} | {told} |")
    return "\n".join(lines) + "\n"


def walk():
    """Every input on all ranks; the faults found, the same on every rank."""
    faults = []
    for wrong in ALL:
        if wrong.alone:
            continue
        directory = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
        answers = comm.allgather(answer(wrong, directory))
        if comm.rank == 0:
            shutil.rmtree(directory)
        if len(set(answers)) > 1:
            faults.append(f"{wrong.what}: the ranks do not agree: {answers}")
        code, text = answers[0]
        if code != wrong.code or not re.search(wrong.message, text):
            faults.append(f"{wrong.what}: exit code {code}, {text!r}")
    return faults


if __name__ == "__main__":
    if comm.size == 1:
        DOCUMENT.write_text(document(), encoding="utf-8")
    else:
        found = walk()
        if comm.rank == 0:
            print(
                "\n".join(found)
                or f"{len([w for w in ALL if not w.alone])} wrong inputs, the same on {comm.size} ranks"
            )
        sys.exit(bool(found))
