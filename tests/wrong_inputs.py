"""Wrong inputs that need files, directories or faults of their own, beside those in data/wrong_inputs.json, which has
the messages of all.

`python tests/wrong_inputs.py` writes the messages anew; `mpirun -n 2 python tests/wrong_inputs.py` compares those of
the ranks.
"""

import errno
import os
import sys
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
import scipy.sparse
from case_texts import body
from wrong_input import (
    BLOCK,
    BODIES,
    FROM_FILE,
    MESSAGES,
    STEPS,
    UNIT,
    Wrong,
    another_run,
    case,
    comm,
    cut,
    disagreements,
    disk,
    edit_written_case,
    flatten,
    hinge,
    memory,
    only_faces,
    part,
    ran,
    recorded,
    rewrite,
    run,
    turn_cell,
    two,
    without_field,
)

from coulomb.io.fclib import FCLIBProblem, write_fclib

DENSE = 'solver.newton = "dense" works on one rank'

CASE_FILES = (
    Wrong("a case that does not exist", run(case="none.toml")),
    Wrong("a directory in place of the case", run(case=".")),
    Wrong("a case cut short", run(), case("[mesh"), library="is not TOML: "),
    Wrong("a case that is no text", run(), case(b"\xfc\xff"), library="UTF-8: "),
    Wrong("a case in UTF-16", run(), case(BLOCK.encode("utf-16"))),
    Wrong("a pipe for a case", run(case="pipe"), lambda: os.mkfifo("pipe")),
    Wrong("single brackets", run(), case(BLOCK.replace("[[clamp]]", "[clamp]"))),
    Wrong("a value for a table", run(), case('mesh = "part.msh"\n' + BLOCK[BLOCK.index("[material]") :])),
    Wrong("a key below a table that belongs above all", run(), case(BLOCK + "body_force = [0, 0, 1]\n")),
    Wrong("lists in lists without end", run(), case(BLOCK + "a = " + 10_000 * "[")),
    Wrong("an empty case", run(), case("")),
    Wrong("dense Newton systems on two ranks", run("solver.newton='dense'"), alone=None, message=DENSE),
)

CONTACT = (
    Wrong(
        "a curved contact face without a foundation",
        run("contact.face='both'"),
        part(lambda file: file.faces.update(both=np.vstack([file.faces["bottom"], file.faces["right"]]))),
    ),
)


def corner(file):
    """Two sides at right angles as one face."""
    file.faces["corner"] = np.concatenate([file.faces["left"], file.faces["front"]])


SUPPORTS = (
    Wrong(
        "a temperature at nodes of no number in a mesh file",
        run(
            "material.expansion=1.2e-5",
            "temperature.reference=20.0",
            "temperature.value=20.0",
            "temperature.at=[{nodes=[123456], value=80.0}]",
        ),
        part(),
    ),
    Wrong("a plane of symmetry that is curved", run("clamp=[]", "symmetry=[{face='corner'}]"), part(corner)),
    Wrong("a guide around a corner", run("clamp=[{face='corner', components='normal'}]"), part(corner)),
)

STEPPED = "history={times=[1, 2]}"
CURVE = run(STEPPED, "traction.0.amplitude={file='curve.csv'}")

LOADS = (
    Wrong("words in a CSV file", CURVE, case("time, factor\n0, 0\n1, full\n", "curve.csv")),
    Wrong("decimal commas in a CSV file", CURVE, case("time;factor\n0,0;0,5\n", "curve.csv")),
    Wrong("two columns for a motion", run(STEPPED, "contact.motion={file='curve.csv'}"), case("0, 0\n", "curve.csv")),
)

NODES = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(np.ndindex(2, 2, 2), start=1))

NONE = np.empty((0, 4), dtype=int)

CUBE = "*ELEMENT, TYPE=C3D8\n1, 1, 5, 7, 3, 2, 6, 8, 4\n"

SHELL = "*ELEMENT, TYPE=S4\n1, 1, 2, 4, 3\n"


def of(kind, *changes):
    """A run on a mesh file of this kind."""
    return run(f"mesh={{file='part.{kind}'}}", *changes)


MESHES = (
    Wrong("a pipe for a mesh", run("mesh={file='part.msh'}"), lambda: os.mkfifo("part.msh")),
    Wrong("no mesh file", run(), case(FROM_FILE)),
    Wrong("a mesh file cut short", run(), part(after=lambda text: text[:-300])),
    Wrong("a text in place of a mesh", run(), part(after=lambda _: b"Dear Sir,\n")),
    Wrong("an empty mesh file", run(), part(after=lambda _: b"")),
    Wrong("a mesh of an old format", run(), part(after=lambda text: text.replace(b"2.2 0 8", b"1.0 0 8"))),
    Wrong("a mesh without the named face", run("contact.face='sole'"), part()),
    Wrong("cells inside out", run(), part(turn_cell)),
    Wrong("cells without volume", run(), part(flatten)),
    Wrong("a mesh in 2D", run(), part(only_faces)),
    Wrong("first order of a second-order mesh", run("mesh.degree=1"), part(lambda file: file.second_order())),
    Wrong("parts that share an edge alone", run(), part(hinge)),
    Wrong("a face inside the body", run("contact.face='seam'"), part(lambda f: f.faces.update(seam=f.interface))),
    Wrong("a contact face without area", run("contact.face='nothing'"), part(lambda f: f.faces.update(nothing=NONE))),
    Wrong("a unit of no length", run("mesh.scale=0"), part()),
    Wrong("materials without cells", run("material=[{young=1e10, poisson=0.3}]"), part()),
    Wrong("a material for cells that are not there", run("material=[{cells='wood', young=1e10, poisson=0.3}]"), part()),
    Wrong("cells without a material", run("material=[{cells='soft', young=1e10, poisson=0.3}]"), part()),
    Wrong("an XDMF file that is none", of("xdmf"), case("Dear Sir,", "part.xdmf"), library="is not XDMF"),
    Wrong("an Abaqus file without solid elements", of("inp"), case(NODES + SHELL, "part.inp")),
    Wrong("an Abaqus file with two parts", of("inp"), case("*PART, NAME=plate\n*PART, NAME=punch\n", "part.inp")),
    Wrong("an Abaqus file that generates nodes", of("inp"), case(NODES + "*NGEN\n1, 8, 1\n", "part.inp")),
    Wrong(
        "a node set that covers no whole facet",
        of("inp", "contact.face='edge'", "clamp.0.face='end'", "traction=[]"),
        case(NODES + CUBE + "*NSET, NSET=end\n1, 2, 3, 4\n*NSET, NSET=edge\n5, 6\n", "part.inp"),
    ),
    Wrong("a MED file that is none", of("med"), case("Dear Sir,", "part.med")),
    Wrong("an Exodus file that is none", of("e"), case("Dear Sir,", "part.e"), library="or damaged"),
    Wrong("a VTU file that is none", of("vtu"), case("Dear Sir,", "part.vtu"), library="cannot be read as vtu"),
    Wrong("a Nastran file with elements in large fields", of("bdf"), case("BEGIN BULK\nCHEXA*  1\n", "part.bdf")),
)

HUGE = "[100000,100000,100000]"
CLOSE, FULL = "coulomb.fem.meshes.xdmf_writing.HDF5Target.close", os.strerror(errno.ENOSPC)

RESOURCES = (
    Wrong(
        "too little memory for the method asked for",
        run("mesh.cells=[24,8,8]", "solver={linear_solver='direct', compliance='matrix-free'}"),
        patch=memory(1.6e8 if comm.size == 1 else 3.0e8),
    ),
    Wrong("a mesh beyond any memory", run("mesh.cells=[3000,1000,1000]"), patch=memory(1.6e10)),
    Wrong(
        "more unknowns than PETSc has numbers for", (*run(f"mesh.cells={HUGE}"), "--force"), library="this PETSc counts"
    ),
    Wrong("a disk without room for the results", run(), patch=disk(1000)),
    Wrong("a disk that fills up while results are written", run(), patch=lambda: mock.patch(CLOSE, lambda _: FULL)),
    Wrong(
        "no permission to write the results", run(), patch=lambda: mock.patch("os.access", lambda _, mode: not mode & 2)
    ),
    Wrong("results in /proc", (*run(), "--output", "/proc/results", "--force")),
    Wrong("an output directory with too long a name", (*run(), "--output", "x" * 300)),
    Wrong("a file in place of the output directory", (*run(), "--output", "case.toml")),
    Wrong("a log that cannot be written", (*run(), "--log", ".")),
)

LOWER = "body.0={name='lower', file='part.msh', material="


def from_file():
    """A body of a file beside one of a box."""
    part()()
    two()


LEFT_OUT = "{distance=1e-3, friction=0.3, pair=[{of=['*', '*'], leave_out=true}]}"
TOUCHING = BODIES.splitlines()[1]
EXPORT = ("export", "case.toml", "out.hdf5", "--set")

SEVERAL = (
    Wrong(
        "a misspelt face of a body's file",
        run(LOWER + "{young=1e9, poisson=0.3}}", "contact.against='lower:tpo'"),
        from_file,
    ),
    Wrong(
        "an unknown group of a body's file",
        run(LOWER + "[{cells='sof', young=1e9, poisson=0.3}]}"),
        from_file,
    ),
    Wrong("contact that is left out everywhere", run("auto_contact=" + LEFT_OUT), case(BODIES.replace(TOUCHING, ""))),
    Wrong("contacts of a case that names them all", ("contacts", "case.toml"), two),
    Wrong("export of a body that contact alone holds", (*EXPORT, "clamp=[{face='lower:bottom'}]"), two, alone=True),
    Wrong("a cut on the boundary", run("mesh.cut=['bottom']"), part()),
    Wrong("a body that nothing holds or touches", run(), case(BODIES + body("lid", *UNIT, (0.0, 0.0, 5.0), 1e9))),
)

_CONTACTS = 8


def contacts():
    """A problem of eight contacts that do not influence each other."""
    size = 3 * _CONTACTS
    return FCLIBProblem(scipy.sparse.identity(size, format="csr"), np.ones(size), np.full(_CONTACTS, 0.5), "stack")


def saved(**changes):
    """problem.npz with some arrays changed."""

    def prepare():
        problem = contacts()
        arrays = {"W_data": problem.W.data, "W_indices": problem.W.indices, "W_indptr": problem.W.indptr}
        np.savez("problem.npz", **(arrays | {"q": problem.q, "mu": problem.mu} | changes))

    return prepare


def without_law():
    write_fclib("problem.hdf5", contacts())
    with h5py.File("problem.hdf5", "a") as file:
        del file["fclib_local/vectors/mu"]


def strange():
    with h5py.File("problem.hdf5", "w") as file:
        file["mesh/nodes"] = np.zeros((4, 3))


NPZ, HDF5 = ("fclib", "problem.npz"), ("fclib", "problem.hdf5")

RIGID = (
    Wrong("a problem that does not exist", ("fclib", "none.hdf5"), saved(), alone=True, library="cannot be read"),
    Wrong("a problem in a file of another kind", ("fclib", "case.toml"), saved(), alone=True, library="cannot be read"),
    Wrong("a problem in an HDF5 file of another kind", HDF5, strange, alone=True),
    Wrong("a problem without friction", HDF5, without_law, alone=True, library="is not complete"),
    Wrong("q of the wrong length", NPZ, saved(q=np.ones(3)), alone=True),
    Wrong("NaN in the free velocities", NPZ, saved(q=np.full(3 * _CONTACTS, np.nan)), alone=True),
    Wrong(
        "a contact with negative friction", NPZ, saved(mu=np.array([0.5, -0.2, *[0.5] * (_CONTACTS - 2)])), alone=True
    ),
)

CHECK, FIRST = ("check", "results"), Path("results/steps/0001/summary.json")

COMMANDS = (
    Wrong("resume where nothing has run", ("resume", "results")),
    Wrong("convert to another format", ("convert", "part.msh", "part.vtu"), alone=True),
    Wrong("convert onto a file that exists", ("convert", "part.msh", "part.xdmf"), case("", "part.xdmf"), alone=True),
    Wrong("convert a damaged mesh", ("convert", "part.msh", "part.xdmf"), case("solid cube", "part.msh"), alone=True),
    Wrong("resume with another mesh", ("resume", "results"), ran(*STEPS, then=edit_written_case)),
    Wrong("a directory that belongs to another run", run(), patch=another_run),
    Wrong(
        "resume with a step cut short",
        ("resume", "results"),
        ran(*STEPS, then=cut("results/steps/0002/solution.h5")),
        library="solution.h5: ",
    ),
    Wrong("results that are to be kept", (*run(*STEPS), "--keep"), ran(*STEPS)),
    Wrong("a file of the user in place of results", (*run(), "--output", "."), case("1;2", "history.csv")),
    Wrong("check where nothing has run", ("check", "."), alone=True),
    Wrong(
        "check of results cut short", CHECK, ran(then=cut("results/solution.h5")), alone=True, library="is incomplete: "
    ),
    Wrong("check of a summary that is none", ("check", "."), case("{}", "summary.json"), alone=True),
    Wrong("check of results of another version", CHECK, ran(then=without_field), alone=True),
    Wrong("check of a history without one of its steps", CHECK, ran(*STEPS, then=FIRST.unlink), alone=True),
    Wrong("check on two ranks", ("check", "."), alone=None, message="coulomb check runs on one rank"),
    Wrong("export of Tresca friction", (*EXPORT, "contact={face='bottom',slip_stress=1e6}"), alone=True),
    Wrong(
        "export of orthotropic friction",
        (*EXPORT, "contact={face='bottom', friction=[1,2], direction=[1,0,0]}"),
        alone=True,
    ),
    Wrong("new where a file is", ("new", "block", "case.toml")),
    Wrong("new in a directory that is not there", ("new", "block", "there/a.toml")),
)

PREPARED = (
    *CASE_FILES,
    *SUPPORTS,
    *LOADS,
    *MESHES,
    *SEVERAL,
    *CONTACT,
    *RIGID,
    *RESOURCES,
    *COMMANDS,
)
ALL = (*PREPARED, *(recorded(what) for what in MESSAGES if what not in {wrong.what for wrong in PREPARED}))

if __name__ == "__main__":
    if comm.size == 1:
        rewrite(ALL)
    else:
        found = disagreements(ALL)
        if comm.rank == 0:
            print("\n".join(found) or f"messages are the same on {comm.size} ranks")
        sys.exit(bool(found))
