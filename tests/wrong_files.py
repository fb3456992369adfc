"""Wrong mesh files, and machines without room: rows of the table of wrong_inputs.py."""

import errno
import os
from unittest import mock

import numpy as np
from wrong_input import (
    FROM_FILE,
    Wrong,
    case,
    comm,
    disk,
    flatten,
    hinge,
    memory,
    only_faces,
    part,
    run,
    turn_cell,
    twenty_nodes,
)

NODES = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(np.ndindex(2, 2, 2), start=1))
CUBE = "*ELEMENT, TYPE=C3D8\n1, 1, 5, 7, 3, 2, 6, 8, 4\n"

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
    Wrong(
        "a mesh of an unknown kind",
        run("mesh={file='part.stl'}"),
        r"file must end in one of \.msh \(gmsh\), .* \.mesh \(Medit\)",
    ),
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
        "20-node hexahedra",
        run(),
        r"has 20-node hexahedra, but coulomb computes with .*SecondOrderIncomplete = 0",
        twenty_nodes,
    ),
    Wrong(
        "first order of a second-order mesh",
        run("mesh.degree=1"),
        r"mesh\.degree = 1, but part\.msh has second-order cells: leave degree out, or export first-order cells",
        part(lambda file: file.second_order()),
    ),
    Wrong("a third order", run("mesh.degree=3"), r"mesh\.degree = 3: should be 1 or 2"),
    Wrong("parts that share an edge alone", run(), r"have edges or corners in common .* share no facet", part(hinge)),
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
    Wrong(
        "an Abaqus file without solid elements",
        run("mesh={file='part.inp'}"),
        r"part\.inp: has no tetrahedra or hexahedra; it has 1 surface elements, but no solid ones",
        case(NODES + "*ELEMENT, TYPE=S4\n1, 1, 2, 4, 3\n", "part.inp"),
    ),
    Wrong(
        "an Abaqus file with two parts",
        run("mesh={file='part.inp'}"),
        r"part\.inp: has 2 parts \(plate, punch\); export one body",
        case("*PART, NAME=plate\n*PART, NAME=punch\n", "part.inp"),
    ),
    Wrong(
        "an Abaqus file that generates nodes",
        run("mesh={file='part.inp'}"),
        r"part\.inp: \*NGEN: coulomb does not read it: write the mesh with its nodes",
        case(NODES + "*NGEN\n1, 8, 1\n", "part.inp"),
    ),
    Wrong(
        "a node set that covers no whole facet",
        run("mesh={file='part.inp'}", "contact.face='edge'", "clamp.0.face='end'", "traction=[]"),
        r"contact: node set 'edge' of part\.inp has 2 of 2 nodes that are no corners of boundary facets within",
        case(NODES + CUBE + "*NSET, NSET=end\n1, 2, 3, 4\n*NSET, NSET=edge\n5, 6\n", "part.inp"),
    ),
    Wrong(
        "numbers for a format with names",
        run("mesh={file='part.inp', names={sole=1}}"),
        r"mesh = .*: names does not go with a \.inp mesh",
    ),
    Wrong(
        "a MED file that is none",
        run("mesh={file='part.med'}"),
        r"part\.med: is not a MED file: it is not HDF5, or cut short",
        case("Dear Sir,", "part.med"),
    ),
    Wrong(
        "an Exodus file that is none",
        run("mesh={file='part.e'}"),
        r"part\.e: is not an Exodus file, or damaged",
        case("Dear Sir,", "part.e"),
        library="or damaged",
    ),
    Wrong(
        "a VTU file that is none",
        run("mesh={file='part.vtu'}"),
        r"part\.vtu: cannot be read as vtu",
        case("Dear Sir,", "part.vtu"),
        library="cannot be read as vtu",
    ),
    Wrong(
        "a Nastran file with elements in large fields",
        run("mesh={file='part.bdf'}"),
        r"part\.bdf: has elements in large fields .* export small fields or free format",
        case("BEGIN BULK\nCHEXA*  1\nENDDATA\n", "part.bdf"),
    ),
)

RESOURCES = (
    Wrong(
        "too little memory for the method asked for",
        run("mesh.cells=[24,8,8]", "solver={linear_solver='direct', compliance='matrix-free'}"),
        r"too little memory: 5832 displacement and 648 contact unknowns \(K factorised, A matrix-free\) need about "
        r"0\.\d+ GB, and 0\.\d+ GB are free; take .*solver\.linear_solver = \"iterative\".* GB\), a coarser mesh",
        patch=memory(1.6e8 if comm.size == 1 else 3.0e8),
    ),
    Wrong(
        "a mesh beyond any memory",
        run("mesh.cells=[3000,1000,1000]"),
        r"a mesh of 3000 x 1000 x 1000 cells has 9021\d{6} displacement unknowns, which need at least 2074\d GB, and "
        r"16 GB are free; take fewer cells",
        patch=memory(1.6e10),
    ),
    Wrong(
        "more unknowns than PETSc has numbers for",
        (*run("mesh.cells=[100000,100000,100000]"), "--force"),
        r"too many unknowns: a mesh of 100000 x 100000 x 100000 cells .* PETSc reach \d+; take fewer cells",
        library="this PETSc counts",
    ),
    Wrong(
        "a disk without room for the results",
        run(),
        r"output results: no space left: the results take about 0\.\d+ MB, and 0\.001 MB are free; --force",
        patch=disk(1000),
    ),
    Wrong(
        "a disk that fills up while results are written",
        run(),
        r"results: cannot be written: No space left on device",
        patch=lambda: mock.patch(
            "coulomb.fem.meshes.xdmf_writing.HDF5Target.close", lambda _: os.strerror(errno.ENOSPC)
        ),
        code=1,
    ),
    Wrong(
        "no permission to write the results",
        run(),
        r"output results: cannot be written: no permission to write in .*; choose another \(--output\)",
        patch=lambda: mock.patch("os.access", lambda _, mode: not mode & os.W_OK),
    ),
    Wrong(
        "results in /proc",
        (*run(), "--output", "/proc/results", "--force"),
        r"output /proc/results: cannot be written: /proc is a view of the system and keeps no files; choose another",
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
