"""Wrong inputs: the tables behind docs/errors.md, which has their messages.

Rewritten by `python tests/wrong_inputs.py`; `mpirun -n 2 python tests/wrong_inputs.py` runs it on two ranks
and compares the messages of the ranks.
"""

import errno
import os
import sys
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
import scipy.sparse
from wrong_input import (
    BLOCK,
    DOCUMENT,
    FROM_FILE,
    STEPS,
    Wrong,
    another_run,
    case,
    comm,
    cut,
    disagreements,
    disk,
    document,
    edit_written_case,
    flatten,
    hinge,
    memory,
    only_faces,
    part,
    ran,
    run,
    turn_cell,
    twenty_nodes,
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
    Wrong("a name of 300 characters", run(f"contact.face='{'x' * 300}'")),
    Wrong("an empty case", run(), case("")),
    Wrong("a misspelt key", run("contact.fricton=0.3")),
    Wrong("a misspelt table", run("clmap=[]")),
    Wrong("words for a number", run("contact.friction='rough'")),
    Wrong("true for a number", run("material.young=true")),
    Wrong("large strains to be ignored", run("small_strain='ignore'")),
    Wrong("two numbers for three", run("traction.0.value=[0,1]")),
    Wrong("--set without a value", run("friction")),
    Wrong("--set in a table that is not there", run("traction.7.face='top'")),
    Wrong("an unknown method", run("solver.linear_solver='lu'")),
    Wrong("too loose a tolerance", run("solver.tolerance=1e-3")),
    Wrong("A to be formed, K not to be factorised", run("solver={linear_solver='iterative', compliance='explicit'}")),
    Wrong("dense Newton systems on two ranks", run("solver.newton='dense'"), alone=None, message=DENSE),
    Wrong("condensed Newton systems of a body that contact alone holds", run("clamp=[]", "solver.newton='condensed'")),
)

BY_RATE = "{static=0.3, kinetic=0.2, decay_speed=0.1}"
STEPPED = "history={times=[1, 2]}"
SOFT, ONE_STEP = "{face='top', stiffness=1e-6}", "history={times=[1]}"
SLOWER = "{static=0.1, kinetic=0.1, decay_speed=0.1}"
TURNING = "contact.rotation={point=[0,0,0], axis=[0,1,0], angle=[[0,0],[1,1]]}"

MATERIALS_AND_LOADS = (
    Wrong("Poisson's ratio 0.5", run("material.poisson=0.5")),
    Wrong("Poisson's ratio 0.4999999", run("material.poisson=0.4999999", command="check-case")),
    Wrong("no stiffness", run("material.young=0")),
    Wrong("negative friction", run("contact.friction=-0.3")),
    Wrong("friction by slip rate without its speed", run("contact.friction={static=0.3, kinetic=0.2}")),
    Wrong("a decay speed of zero", run("contact.friction={static=0.3, kinetic=0.2, decay_speed=0}")),
    Wrong("a misspelt key of friction by slip rate", run(f"contact.friction={BY_RATE.replace('kinetic', 'dynamic')}")),
    Wrong("two tables of friction by slip rate", run(f"contact.friction=[{BY_RATE}, {SLOWER}]")),
    Wrong("two coefficients in friction by slip rate", run(f"contact.friction={BY_RATE.replace('0.3', '[0.3, 0.1]')}")),
    Wrong("friction by slip rate with a direction", run(f"contact.friction={BY_RATE}", "contact.direction=[1,0,0]")),
    Wrong("friction that becomes negative", run("contact.friction_amplitude=[[0,1],[1,-1]]")),
    Wrong("both friction laws", run("contact.slip_stress=1e6")),
    Wrong("a load of NaN", run("traction.0.value=[0,0,nan]")),
    Wrong("an infinite displacement", run("clamp.0.value=[inf,0,0]")),
    Wrong("a spring of no stiffness", run("spring=[{face='top', stiffness=0}]")),
    Wrong("springs too soft in comparison with rounding errors", run("clamp=[]", f"spring=[{SOFT}]")),
    Wrong("an amplitude whose times do not increase", run(ONE_STEP, "clamp.0.amplitude=[[0,0],[1,1],[1,2]]")),
    Wrong("an amplitude without a history", run("traction.0.amplitude=[[0,0],[1,1]]")),
    Wrong("a foundation that moves without a history", run("contact.motion=[[0,0,0,0],[1,0,0,1e-3]]")),
    Wrong("a foundation that rotates without a history", run(TURNING)),
    Wrong("a foundation that rotates about no axis", run(ONE_STEP, TURNING.replace("[0,1,0]", "[0,0,0]"))),
    Wrong("a rotation whose times do not increase", run(ONE_STEP, TURNING.replace("]]", "],[1,2]]"))),
    Wrong(
        "a foundation that rotates through the body",
        run(STEPPED, TURNING.replace("[0,0],[1,1]", "[1,0], [2,2]"), command="check-case"),
    ),
    Wrong("a thousand million load steps", run("history={end=1.0, steps=1000000000}")),
    Wrong("friction that is next to nothing", run("contact.friction=1e-300")),
    Wrong("a history without times", run("history={halvings=3}")),
    Wrong("a history that goes back", run("history={times=[1,0.5]}")),
)

LARGE, RUBBER = "solver.kinematics='large'", "material={law='neo-hookean', young=1e6, poisson=0.3}"
RIVLIN = "material={law='mooney-rivlin', c1=1e5, bulk=1e8}"

LARGE_MOTIONS = (
    Wrong("a hyperelastic material with small strains", run(RUBBER)),
    Wrong("large motions without load steps", run(RUBBER, LARGE)),
    Wrong("a law that is not known", run("material.law='yeoh'")),
    Wrong("a law without one of its constants", run(RIVLIN, LARGE, *STEPS)),
    Wrong("a constant of another law", run("material.law='neo-hookean'", "material.c1=1e5", LARGE, *STEPS)),
    Wrong("a negative modulus", run("material.law='neo-hookean'", "material.young=-1e6", LARGE, *STEPS)),
    Wrong("a temperature in large motions", run(RUBBER, LARGE, *STEPS, "temperature.value=20.0")),
    Wrong("a gap in large motions", run(RUBBER, LARGE, *STEPS, "contact.gap=1e-3")),
    Wrong(
        "friction by place in large motions",
        run(RUBBER, LARGE, *STEPS, "contact.region=[{box=[[0,0,0],[1,1,1]], friction=0.1}]"),
    ),
)

BALL = "{shape='sphere', centre=[1.5,0.5,-9], radius=9}"
HERE = "box=[[0,0,0],[1,1,1]]"

CONTACT = (
    Wrong("a contact face that is fully clamped", run("contact.face='left'")),
    Wrong("a foundation turned away", run("contact.foundation={point=[0,0,0], normal=[0,0,-1]}")),
    Wrong(
        "a foundation that moves to the other side",
        run(STEPPED, f"contact.foundation={BALL}", "contact.motion=[[1,0,0,0], [2,0,0,20]]", command="check-case"),
    ),
    Wrong("a plane without a direction", run("contact.foundation={point=[0,0,0], normal=[0,0,0]}")),
    Wrong("a sphere of radius 0", run("contact.foundation={shape='sphere', centre=[0,0,-1], radius=0}")),
    Wrong("a sphere without a centre", run("contact.foundation={shape='sphere', radius=1}")),
    Wrong("a region without nodes", run("contact.region=[{box=[[5,5,5],[6,6,6]], friction=0.1}]")),
    Wrong("a region whose corners are exchanged", run("contact.region=[{box=[[1,1,1],[0,0,0]], friction=0.1}]")),
    Wrong("a negative cohesion", run("contact.cohesion=-1e6")),
    Wrong("cohesion beside slip_stress", run("contact={face='bottom', slip_stress=1e6, cohesion=1e6}")),
    Wrong("a region with cohesion where the face has none", run(f"contact.region=[{{{HERE}, cohesion=1e6}}]")),
    Wrong("two coefficients of friction without a direction", run("contact.friction=[0.3, 0.1]")),
    Wrong("three coefficients of friction", run("contact.friction=[0.3, 0.2, 0.1]", "contact.direction=[1,0,0]")),
    Wrong("friction in one direction only", run("contact.friction=[0.3, 0]", "contact.direction=[1,0,0]")),
    Wrong("a direction of friction along the normal", run("contact.friction=[0.3, 0.1]", "contact.direction=[0,0,1]")),
    Wrong(
        "a curved contact face without a foundation",
        run("contact.face='both'"),
        part(lambda file: file.faces.update(both=np.vstack([file.faces["bottom"], file.faces["right"]]))),
    ),
)

VALUES = (
    Wrong("text for a list of numbers", run("history.times='1,2'")),
    Wrong("a number for a list of numbers", run("history.times=2.0")),
    Wrong("lists in a list of numbers", run("history.times=[[1,2]]")),
    Wrong("one number for three", run("mesh.box=1.0")),
    Wrong("an empty list for three numbers", run("mesh.cells=[]")),
    Wrong("a number with a fraction for a whole number", run("mesh.cells=[3.5,1,1]")),
    Wrong("text for a number", run("mesh.box=['3',1,1]")),
    Wrong("true for a component of a vector", run("traction.0.value=[true,0,0]")),
    Wrong("a table for a vector", run("traction.0.value={x=1.0}")),
    Wrong("one row in place of rows", run("traction.0.amplitude=[0,1]")),
    Wrong("a number for a table in time", run("contact.motion=1e-3")),
    Wrong("rows that are too short", run("contact.motion=[[0,0,0],[1,0,0]]")),
    Wrong("an angle in place of the rows of a load curve", run(TURNING.replace("[[0,0],[1,1]]", "{table=0.1}"))),
    Wrong("a vector for directions of a material", run("material.directions=[1,0]")),
    Wrong("text for a list of tables", run("traction='1,2'")),
    Wrong("a number for text", run("contact.face=3")),
    Wrong("a number for true or false", run("output.picture=7")),
    Wrong("a list for one number", run("contact.foundation={shape='sphere', centre=[0,0,0], radius=[1.0]}")),
    Wrong("a tolerance of 0", run("solver.tolerance=0")),
    Wrong("lengths in two units", run("mesh.box=[3e6,1e-6,1]")),
    Wrong("a thickness in another unit", run("mesh.box=[3.0,1.0,1e-9]")),
)

PLY = ("material.young=[1.3e11, 1.1e10, 9e9]", "material.poisson=[0.28, 0.3, 0.4]")

NOWHERE = "[['-y', 'x', 0], ['y', '0 - x', 0]]"

SHEAR = "material.shear=[5e9, 4.5e9, 3.5e9]"

WARM = "heat=[{face='top', temperature=20.0}]"
WARMED = (WARM, "reference_temperature=20.0", "material.expansion=1e-5", "material.conductivity=50.0")
HEATED = ("material.expansion=1.2e-5", "temperature.reference=20.0")

MATERIALS = (
    Wrong("three Young's moduli without shear moduli", run(*PLY)),
    Wrong("one Young's modulus with shear moduli", run(SHEAR)),
    Wrong("two Young's moduli", run("material.young=[1e9, 2e9]")),
    Wrong("Poisson's ratios with a negative strain energy", run(*PLY, SHEAR, "material.poisson=[0.28, 0.3, 1.3]")),
    Wrong("parallel directions", run(*PLY, SHEAR, "material.directions=[[1, 0, 1], [2, 0, 2]]")),
    Wrong("directions without a value in a cell", run(*PLY, SHEAR, f"material.directions={NOWHERE}")),
    Wrong("directions of an isotropic material", run("material.directions=[[1, 0, 0], [0, 1, 0]]")),
    Wrong("a temperature without thermal expansion", run("temperature.value=80.0")),
    Wrong("a temperature without a value", run(*HEATED)),
    Wrong("a file of temperatures without the name of a field", run(*HEATED, "temperature.file='heat.vtu'")),
    Wrong("a file of temperatures that does not exist", run(*HEATED, "temperature={file='heat.vtu', field='T'}")),
    Wrong(
        "an amplitude of the temperature without a history",
        run(*HEATED, "temperature.value=80.0", "temperature.amplitude=[[0, 0], [1, 1]]"),
    ),
    Wrong("heat without a reference temperature", run(WARM)),
    Wrong("heat without a conductivity", run(WARM, "reference_temperature=20.0", "material.expansion=1e-5")),
    Wrong("heat and a temperature", run(WARM, *HEATED, "temperature.value=80.0")),
    Wrong("heat of two kinds on a face", run("heat=[{face='top', temperature=20.0, flux=1e3}]")),
    Wrong("a film without the temperature beyond", run("heat=[{face='top', film=100.0}]")),
    Wrong("conduction through a contact without heat", run("contact.thermal={conductance=1e3, temperature=20.0}")),
    Wrong(
        "conduction to a foundation without a temperature",
        run(*WARMED, "contact.thermal={conductance=1e3}"),
    ),
    Wrong("heat on a face that is not there", run(*WARMED, "heat.0.face='roof'")),
)


def corner(file):
    """Two sides at right angles as one face."""
    file.faces["corner"] = np.concatenate([file.faces["left"], file.faces["front"]])


CLAMPED = "clamp=[{face='left'},{face='right',components='x'}]"
ROTATED = "{face='right', point=[0,0,0], axis=[0,0,1], angle=0.1"

SUPPORTS = (
    Wrong("a clamp along components and a direction", run("clamp=[{face='left', components='x', direction=[1,1,0]}]")),
    Wrong("a clamp along no direction", run("clamp=[{face='left', direction=[0,0,0]}]")),
    Wrong("a clamp along no component", run("clamp=[{face='left', components='normals'}]")),
    Wrong("a plane of symmetry that is curved", run("clamp=[]", "symmetry=[{face='corner'}]"), part(corner)),
    Wrong("a guide around a corner", run("clamp=[{face='corner', components='normal'}]"), part(corner)),
    Wrong(
        "a contact face that is nearly held",
        run(CLAMPED, "contact.foundation={point=[0,0,0], normal=[1,0,0.005]}"),
    ),
    Wrong(
        "a support that pushes a contact face into its foundation",
        run("prescribed_displacement=[{face='left', value=[0,0,-1e-3]}]"),
    ),
    Wrong("a rotation about no axis", run(f"prescribed_rotation=[{ROTATED}}}]".replace("[0,0,1]", "[0,0,0]"))),
    Wrong("a rotation in time without a history", run(f"prescribed_rotation=[{ROTATED}, amplitude=[[0,0],[1,1]]}}]")),
)


def curve(value):
    return run(STEPPED, f"traction.0.amplitude={value}")


LOADS = (
    Wrong("a name in an expression that is not known", run('traction.0.value=[0, 0, "-1e6*(1 + r/2)"]')),
    Wrong("a power as in other languages", run('traction.0.value=[0, 0, "-1e6*x^2"]')),
    Wrong("time in an expression of place", run('body_force=["1e3*t", 0, 0]')),
    Wrong("code in place of an expression", run("contact.friction=\"__import__('os').getpid()\"")),
    Wrong("an expression without a value at a node", run('traction.0.value=[0, 0, "sqrt(x - 1)"]')),
    Wrong("an expression of negative friction", run('contact.friction="0.5 - x"')),
    Wrong("a pressure on a face that is not there", run("pressure=[{face='lid', value=1e6}]")),
    Wrong("a pressure with a direction", run("pressure=[{face='top', value=[0, 0, -1e6]}]")),
    Wrong("a total force of one number", run("total_force=[{face='top', force=5.0}]")),
    Wrong("gravity without a density", run("gravity=[0, 0, -9.81]")),
    Wrong("a density of zero", run("material.density=0", "gravity=[0, 0, -9.81]")),
    Wrong(
        "gravity in time without a history",
        run("material.density=7850.0", "gravity=[0,0,-9.81]", "gravity_amplitude=[[0,0],[1,1]]"),
    ),
    Wrong("the name of a CSV file without a table", curve("'curve.csv'")),
    Wrong("a CSV file that does not exist", curve("{file='curve.csv'}")),
    Wrong("words in a CSV file", curve("{file='curve.csv'}"), case("time, factor\n0, 0\n1, full\n", "curve.csv")),
    Wrong("decimal commas in a CSV file", curve("{file='curve.csv'}"), case("time;factor\n0,0;0,5\n", "curve.csv")),
    Wrong("two columns for a motion", run(STEPPED, "contact.motion={file='curve.csv'}"), case("0, 0\n", "curve.csv")),
    Wrong("a table and a file for one curve", curve("{table=[[0,0],[2,1]], file='curve.csv'}")),
    Wrong("a repeated curve with a jump", curve("{table=[[0,0],[1,1]], after='repeat'}")),
    Wrong("a curve that ends before the history", curve("{table=[[0,0],[1,1]], after='error'}")),
    Wrong("something else after a curve", curve("{table=[[0,0],[1,1]], after='zero'}")),
)

NODES = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(np.ndindex(2, 2, 2), start=1))

NONE = np.empty((0, 4), dtype=int)

CUBE = "*ELEMENT, TYPE=C3D8\n1, 1, 5, 7, 3, 2, 6, 8, 4\n"

SHELL = "*ELEMENT, TYPE=S4\n1, 1, 2, 4, 3\n"


def of(kind, *changes):
    """A run on a mesh file of this kind."""
    return run(f"mesh={{file='part.{kind}'}}", *changes)


MESHES = (
    Wrong("a box of negative length", run("mesh.box=[3,-1,1]")),
    Wrong("a box of no size", run("mesh.box=[1e-200,1,1]")),
    Wrong("a pipe for a mesh", run("mesh={file='part.msh'}"), lambda: os.mkfifo("part.msh")),
    Wrong("no cells", run("mesh.cells=[3,0,1]")),
    Wrong("an unknown face of a box", run("contact.face='botom'")),
    Wrong("no mesh file", run(), case(FROM_FILE)),
    Wrong("a mesh file cut short", run(), part(after=lambda text: text[:-300])),
    Wrong("a text in place of a mesh", run(), part(after=lambda _: b"Dear Sir,\n")),
    Wrong("an empty mesh file", run(), part(after=lambda _: b"")),
    Wrong("a mesh of an old format", run(), part(after=lambda text: text.replace(b"2.2 0 8", b"1.0 0 8"))),
    Wrong("a mesh of an unknown kind", run("mesh={file='part.stl'}")),
    Wrong("a mesh without the named face", run("contact.face='sole'"), part()),
    Wrong("cells inside out", run(), part(turn_cell)),
    Wrong("cells without volume", run(), part(flatten)),
    Wrong("a mesh in 2D", run(), part(only_faces)),
    Wrong("20-node hexahedra", run(), twenty_nodes),
    Wrong("first order of a second-order mesh", run("mesh.degree=1"), part(lambda file: file.second_order())),
    Wrong("a third order", run("mesh.degree=3")),
    Wrong("parts that share an edge alone", run(), part(hinge)),
    Wrong("a face inside the body", run("contact.face='seam'"), part(lambda f: f.faces.update(seam=f.interface))),
    Wrong("a contact face without area", run("contact.face='nothing'"), part(lambda f: f.faces.update(nothing=NONE))),
    Wrong("a unit of no length", run("mesh.scale=0"), part()),
    Wrong("a box with a scale", run("mesh.scale=1e-3")),
    Wrong("a material for cells that are not there", run("material=[{cells='wood', young=1e10, poisson=0.3}]"), part()),
    Wrong("cells without a material", run("material=[{cells='soft', young=1e10, poisson=0.3}]"), part()),
    Wrong("no XDMF file", of("xdmf")),
    Wrong("an XDMF file that is none", of("xdmf"), case("Dear Sir,", "part.xdmf"), library="is not XDMF"),
    Wrong("an Abaqus file without solid elements", of("inp"), case(NODES + SHELL, "part.inp")),
    Wrong("an Abaqus file with two parts", of("inp"), case("*PART, NAME=plate\n*PART, NAME=punch\n", "part.inp")),
    Wrong("an Abaqus file that generates nodes", of("inp"), case(NODES + "*NGEN\n1, 8, 1\n", "part.inp")),
    Wrong(
        "a node set that covers no whole facet",
        of("inp", "contact.face='edge'", "clamp.0.face='end'", "traction=[]"),
        case(NODES + CUBE + "*NSET, NSET=end\n1, 2, 3, 4\n*NSET, NSET=edge\n5, 6\n", "part.inp"),
    ),
    Wrong("numbers for a format with names", run("mesh={file='part.inp', names={sole=1}}")),
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

BODIES = """
contact = { face = "upper:bottom", against = "lower:top", friction = 0.3 }
[[body]]
name = "lower"
box = [1.0, 1.0, 1.0]
cells = [1, 1, 1]
material = { young = 2e11, poisson = 0.3 }
[[body]]
name = "upper"
box = [1.0, 1.0, 1.0]
cells = [1, 1, 1]
translate = [0.0, 0.0, 1.0]
material = { young = 2e11, poisson = 0.3 }
[[clamp]]
face = "lower:bottom"
[[clamp]]
face = "upper:top"
"""

THIRD = """[[body]]
name = "lid"
box = [1.0, 1.0, 1.0]
cells = [1, 1, 1]
translate = [0.0, 0.0, 5.0]
material = { young = 1e9, poisson = 0.3 }
"""

two = case(BODIES)

LOWER = "body.0={name='lower', file='part.msh', material="


def from_file():
    """A body of a file beside one of a box."""
    part()()
    two()


FAR = "distance=1e-3"
APART, ASIDE = (f"body.1.translate=[{place}]" for place in ("0, 0, 1.001", "5, 5, 5"))
PAIRS = f"auto_contact={{{FAR}, friction=0.3, pair=[{{of=OF, friction=0.5}}]}}"
LEFT_OUT = f"{{{FAR}, friction=0.3, pair=[{{of=['*', '*'], leave_out=true}}]}}"
TOUCHING = BODIES.splitlines()[1]
EXPORT = ("export", "case.toml", "out.hdf5", "--set")

SECTION = "face='upper:bottom', against='lower:top', force=1.0"
GLUED = "face='upper:bottom', against='lower:top'"
STILL = "translation={x=0, y=0, z=0}, rotation={x=0, y=0, z=0}"
SEVERAL = (
    Wrong("a misspelt body", run("contact.against='lowr:top'"), two),
    Wrong("a face without its body", run("clamp=[{face='bottom'}]"), two),
    Wrong("a body without its face", run("clamp=[{face='lower:'}]"), two),
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
    Wrong("two bodies of one name", run("body.1.name='lower'"), two),
    Wrong("a body's name with a colon", run("body.1.name='up:per'"), two),
    Wrong("a mesh beside bodies", run("mesh={box=[1,1,1], cells=[1,1,1]}"), two),
    Wrong("a material beside bodies", run("material={young=1e9, poisson=0.3}"), two),
    Wrong("a body without a material", run("body.1={name='upper', box=[1,1,1], cells=[1,1,1]}"), two),
    Wrong("a rotated body without an axis", run("body.1.rotate={angle=0.1}"), two),
    Wrong("a foundation beside against", run("contact.foundation={point=[0,0,1], normal=[0,0,1]}"), two),
    Wrong("a face against itself", run("contact.against='upper:bottom'"), two),
    Wrong("the slave of a rigid foundation", run("contact={face='upper:bottom', friction=0.3, slave=true}"), two),
    Wrong("pairs to be found in the table of one", run("contact.auto={distance=1e-3, friction=0.3}"), two),
    Wrong("a negative distance of the pairs to be found", run("auto_contact={distance=-1e-3, friction=0.3}"), two),
    Wrong("no friction of the pairs to be found", run("auto_contact={distance=1e-3}"), two),
    Wrong(
        "two coefficients of friction of the pairs to be found",
        run(f"auto_contact={{{FAR}, friction=[0.3, 0.1]}}"),
        two,
    ),
    Wrong("no faces within the distance", run(APART, "auto_contact={distance=1e-6, friction=0.3}"), two),
    Wrong("bodies that do not face each other at all", run(ASIDE, f"auto_contact={{{FAR}, friction=0.3}}"), two),
    Wrong("friction of a pair that is not found", run(PAIRS.replace("OF", "['upper', 'lowr']")), two),
    Wrong("one body for a pair", run(PAIRS.replace("OF", "'upper'")), two),
    Wrong("contact that is left out everywhere", run("auto_contact=" + LEFT_OUT), case(BODIES.replace(TOUCHING, ""))),
    Wrong("contacts of a case that names them all", ("contacts", "case.toml"), two),
    Wrong("one body in single brackets", run("body={name='lower'}"), two),
    Wrong("export of a body that contact alone holds", (*EXPORT, "clamp=[{face='lower:bottom'}]"), two, alone=True),
    Wrong("a tie of a misspelt face", run("tie=[{face='upper:botom', against='lower:top'}]"), two),
    Wrong("a tie of a face to itself", run("tie=[{face='upper:bottom', against='upper:bottom'}]"), two),
    Wrong("a tie of faces that do not face each other", run("tie=[{face='upper:top', against='lower:top'}]"), two),
    Wrong("contact and a tie of the same faces", run("tie=[{" + GLUED + "}]"), two),
    Wrong(
        "a sector of the wrong angle",
        run("cyclic_symmetry=[{face='upper:left', against='upper:front', axis=[0,0,1], sectors=3}]"),
        two,
    ),
    Wrong(
        "a sector without their number",
        run("cyclic_symmetry=[{face='upper:left', against='upper:front', axis=[0,0,1]}]"),
        two,
    ),
    Wrong("a bolt without a force", run("pretension=[{face='upper:bottom', against='lower:top'}]"), two),
    Wrong("a bolt without its other side", run("pretension=[{face='upper:bottom', force=1.0}]"), two),
    Wrong("a bolt that is locked, without load steps", run("pretension=[{" + SECTION + ", lock=1.0}]"), two),
    Wrong("a bolt locked in a load step", run("pretension=[{" + SECTION + ", lock=1.0}]", "history.times=[2]"), two),
    Wrong("a bolt and a tie on the same faces", run("pretension=[{" + SECTION + "}]", "tie=[{" + GLUED + "}]"), two),
    Wrong("a cut of a box", run("body.0.cut=['middle']"), two),
    Wrong("a cut on the boundary", run("mesh.cut=['bottom']"), part()),
    Wrong("a rigid face that cannot move", run("rigid_face=[{face='upper:top', " + STILL + "}]"), two),
    Wrong(
        "a face that stays plane and is prescribed along itself",
        run("rigid_face=[{face='upper:top', along='free', translation={x=0.0}}]"),
        two,
    ),
    Wrong(
        "a spring along a face whose nodes are free along it",
        run("rigid_face=[{face='upper:top', along='free', translation_stiffness=[1e6, 0.0, 1e6]}]"),
        two,
    ),
    Wrong(
        "a spring of a rigid face with two numbers",
        run("rigid_face=[{face='upper:top', rotation_stiffness=[1e6, 0.0]}]"),
        two,
    ),
    Wrong(
        "a component of a rigid face with a wrong name", run("rigid_face=[{face='upper:top', rotation={t=1.0}}]"), two
    ),
    Wrong("a tie without its other face", run("tie=[{face='upper:bottom'}]"), two),
    Wrong("a body that nothing holds or touches", run(), case(BODIES.replace("[[clamp]]", THIRD + "[[clamp]]", 1))),
    Wrong("a probe where two bodies touch", run("probe=[{name='heel', point=[0.5,0.5,1]}]"), two),
    Wrong("a probe in none of the bodies", run("probe=[{name='heel', point=[0.5,0.5,3]}]"), two),
    Wrong("a probe in an unknown body", run("probe=[{name='heel', point=[0.5,0.5,1], body='uper'}]"), two),
)

GAPS = (
    Wrong("a gap that is no length", run("contact.gap=[0,0,1e-3]")),
    Wrong("an interference under that name", run("contact.interference=1e-5")),
    Wrong("an interference in millimetres", run("contact.gap=-20")),
    Wrong("a gap of a file that is not there", run('contact.gap={file="worn.vtu", field="depth"}')),
    Wrong("a file of gaps without a field", run('contact.gap={file="worn.vtu"}')),
    Wrong("a gap that is not finite somewhere", run('contact.gap="1e-3/(3 - x)"')),
    Wrong("an amplitude of a gap, without load steps", run("contact.gap=-1e-6", "contact.gap_amplitude=[[0,0],[1,1]]")),
    Wrong("an amplitude without a gap", run("contact.gap_amplitude=[[0,0],[1,1]]")),
)

PROBES = (
    Wrong("a probe outside the body", run("probe=[{name='heel', point=[1.5,0.5,-2]}]")),
    Wrong("two probes of one name", run("probe=[{name='heel', point=[0,0,0]}, {name='heel', point=[1,0,0]}]")),
    Wrong("a probe without a point", run("probe=[{name='heel'}]")),
    Wrong("a probe in the plane", run("probe=[{name='heel', point=[0,0]}]")),
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
    Wrong("a directory that belongs to another run", run(), another_run, library="cannot be seen from "),
    Wrong(
        "resume with a step cut short",
        ("resume", "results"),
        ran(*STEPS, then=cut("results/steps/0002/solution.h5")),
        library="solution.h5: ",
    ),
    Wrong("a history where another one is", run(*STEPS), ran(*STEPS)),
    Wrong("another case where there are results", run("contact.friction=0.4"), ran()),
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

TABLE = {
    "Case files": CASE_FILES,
    "Values": VALUES,
    "Materials, loads, history": MATERIALS_AND_LOADS,
    "Orthotropic materials, temperature": MATERIALS,
    "Large motions": LARGE_MOTIONS,
    "Supports": SUPPORTS,
    "Loads, expressions, load curves": LOADS,
    "Meshes": MESHES,
    "Several bodies": SEVERAL,
    "Contact": [*CONTACT, *GAPS],
    "Probes": PROBES,
    "Rigid bodies": RIGID,
    "Machine": RESOURCES,
    "Commands": COMMANDS,
}
ALL = [wrong for rows in TABLE.values() for wrong in rows]

if __name__ == "__main__":
    if comm.size == 1:
        DOCUMENT.write_text(document(TABLE, {}), encoding="utf-8")
    else:
        found = disagreements(ALL)
        if comm.rank == 0:
            print("\n".join(found) or f"messages are the same on {comm.size} ranks")
        sys.exit(bool(found))
