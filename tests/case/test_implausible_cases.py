"""Implausible case files and common mistakes: refused at once, with the probable intention."""

import os
import re
import socket
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import SMALL_CASE as BLOCK
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb.case.case import Case, read_case
from coulomb.case.files import LARGEST
from coulomb.case.record import write_case, written_case
from coulomb.cli.preparation import refuse_too_many_cells
from coulomb.fem.meshes.meshes import read_mesh, read_xdmf
from coulomb.io.fclib import read_fclib


def said(text, *changes, name="case.toml"):
    """The message about a case; empty if it is right."""
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    try:
        assert isinstance(read_case(name, changes), Case)
    except ValueError as fault:
        return str(fault)
    return ""


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


LONG = "x" * 300
ABSURD = {
    "history={end=1e-300, steps=2}": r"history\.end = 1e-300: should be from 1e-30 to 1e\+30",
    "history={end=1.0, steps=2, halvings=1000000000}": r"halvings = 1000000000: should be less than or equal to 30",
    "contact={face='bottom', slip_stress=1e-300}": r"contact\.slip_stress = 1e-300: should be 0, or from 1e-30",
    "contact.region=[{box=[[0,0,0],[1e200,1,1]], friction=0.1}]": r"region\.0\.box\.1\.0 = 1e\+200: should be 0, or",
    "contact.foundation={shape='sphere', centre=[0,0,-1], radius=1e-200}": r"radius = 1e-200: should be from 1e-12",
    "contact.motion=[]": r"contact\.motion = \[\]: should have at least 1 item",
    "mesh.cells=[1000000000000,1,1]": r"mesh\.cells\.0 = 1000000000000: should be less than or equal to 1000000",
    "mesh={file='part.msh', scale=1e-300}": r"mesh\.scale = 1e-300: should be from",
    "mesh={file='part.xdmf', names={a=99999999999}}": r"mesh\.names\.a = 99999999999: should be less than",
    "material.young=1e-300": r"material\.young = 1e-300: should be from 1e-06 to 1e\+24 in size",
    "traction.0.value=[0,0,1e-200]": r"traction\.0\.value\.2 = 1e-200: should be 0, or from 1e-60 to 1e\+30",
    "spring=[{face='top', stiffness=1e-300}]": r"spring\.0\.stiffness\.0 = 1e-300: should be 0, or from 1e-12",
    "solver={method='successive-tresca', max_outer=1000000000}": r"max_outer = 10+: should be less than or equal",
    f"output.directory='{4 * LONG}'": r"output\.directory = 'x+\.\.\.x+': should have at most 1000 characters",
    'output.directory="a\\u0000b"': r"output\.directory = 'a\\x00b': should have no control characters",
    "contact.face=''": r"contact\.face = '': should have at least 1 character",
    "mesh.cells=" + 5000 * "[": r"--set mesh\.cells=\[+ \.\.\.: lists or tables are nested too deeply",
    "mesh.cells=" + 300 * "[" + 300 * "]": r"mesh\.cells\.0 = \[\[\[\[\.\.\.\]\]\]\]: should be a whole number",
    ".".join(30_000 * "a") + "=1": r"--set a\.a.* \.\.\.: must be key\.key=value",
    "mesh.cells=[" + 4000 * "9" + ",1,1]": r"mesh\.cells\.0 = 9+\.\.\.9+: should be less than or equal to 1000000",
    "mesh.cells=["
    + 5000 * "9"
    + ",1,1]": r"mesh\.cells = '\[9+\.\.\.9+,1,1\]': should be a list of 3 whole.*, not text",
    "material.young=" + 4000 * "9": r"material\.young = 9+\.\.\.9+: is too large: numbers are at most 1\.8e\+308",
    "traction.0.value=[" + 30_000 * "1," + "]": r"value = \[1, 1, 1, 1, 1, 1, \.\.\.\]: should have at most 3 items",
}


@pytest.mark.parametrize("change", ABSURD, ids=lambda change: change[:40])
def test_implausible_values(change):
    text = said(BLOCK, change)
    assert re.search(ABSURD[change], text), text
    assert all(len(line) < 300 for line in text.splitlines())


MONSTERS = {
    "tables in tables": (f"{BLOCK}[{'.'.join(100_000 * 'a')}]\n", r"lists or tables are nested too deeply"),
    "tables inside lines": (BLOCK + "a = " + 5000 * "{a=" + "1" + 5000 * "}", r"nested too deeply"),
    "digits": (BLOCK + "a = " + 5000 * "9", r"is not TOML: Exceeds the limit \(4300 digits\) [^;]* 5000 digits\s*$"),
    "fewer digits": (
        BLOCK + f'[[traction]]\nface = "top"\nvalue = [0.0, 0.0, -{4000 * "9"}]\n',
        r"traction\.\d\.value\.2 = -9+\.\.\.9+: is too large: numbers are at most 1\.8e\+308",
    ),
    "a word": (BLOCK + 3_000_000 * "x", r"is not TOML: Expected '='"),
    "too many clamps": (
        BLOCK + 1001 * '[[clamp]]\nface = "left"\n',
        r"clamp = .*: should have at most 1000 items, not",
    ),
    "wrong clamps": (BLOCK + 900 * "[[clamp]]\n", r"clamp\.10\.face: is missing, .*\ncase\.toml: and 890 more"),
    "too many times": (
        f"{BLOCK}[history]\ntimes = [{','.join(map(str, range(1, 100_002)))}]\n",
        r"at most 100000 items",
    ),
    "times that stand still": (f"{BLOCK}[history]\ntimes = [{'1,' * 5000}]\n", r"1\.0, \.\.\.\] \(5000 of them\)"),
    "a file without end": (BLOCK + "#" * LARGEST, r"case\.toml: cannot be read: it is larger than 4 MB"),
}


@pytest.mark.parametrize("name", MONSTERS)
def test_huge_cases_are_refused_at_once(name):
    text, expected = MONSTERS[name]
    began = time.process_time()
    found = said(text)
    assert re.search(expected, found), found[:1000]
    assert len(found) < 2000
    assert time.process_time() - began < 60.0  # a bound on hours, not a measurement


def test_large_plausible_values_are_accepted():
    rows = ",".join(f"[{k}, {k % 2}]" for k in range(20_000))
    timed = BLOCK.replace('face = "left"', f'face = "left"\namplitude = [{rows}]')
    steps = f"[history]\ntimes = [{','.join(map(str, range(1, 100_001)))}]\n"
    assert said(timed + steps) == ""
    assert said(f"# {'.' * 200} = 3.1.4\n# See e.g. chapter 1. Then 2. Then 3.\n" + BLOCK) == ""
    assert said(BLOCK, "contact.friction=0", "traction.0.value=[0,0,0]", "material.young=1e-3") == ""


SLIPS = {
    "[clamp] twice": (
        BLOCK.replace("[[clamp]]", "[clamp]") + '[clamp]\nface = "top"\n',
        r"Cannot declare .* twice .*: \[clamp\]; there may be several: each is written \[\[clamp\]\]",
    ),
    "[[mesh]]": (
        BLOCK.replace("[mesh]", "[[mesh]]"),
        r"mesh: there is only one: write \[mesh\], with single brackets",
    ),
    "a key below its table's table": (
        BLOCK + "[contact.foundation]\npoint = [0,0,0]\nnormal = [0,0,1]\nnormals = 'body'\n",
        r"contact\.foundation\.normals = 'body': .*; it belongs to \[contact\], above \[contact\.foundation\]",
    ),
    "a key above its table": ("young = 2e11\n" + BLOCK, r"young = 200000000000\.0: .*; it belongs to \[material\] \("),
    "True": (BLOCK.replace("false", "False"), r"Invalid value .*: picture = False; in TOML it is false"),
    "no quotes": (BLOCK.replace('"left"', "left"), r"Invalid value .*: face = left; text must be in quotes"),
}


@pytest.mark.parametrize("name", SLIPS)
def test_mistakes_are_reported_with_the_correction(name):
    text, expected = SLIPS[name]
    found = said(text)
    assert re.search(expected, found, re.DOTALL), found


def test_a_byte_order_mark_is_accepted():
    assert said(b"\xef\xbb\xbf" + BLOCK.encode()) == ""
    path = BoxFile().write(Path("part.msh"))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert "bottom" in read_mesh(path).faces
    path.write_bytes(path.read_bytes().decode("utf-8-sig").encode("utf-16"))
    with pytest.raises(ValueError, match=r"part\.msh: is text in UTF-16; save it as plain text"):
        read_mesh(path)


def test_a_byte_order_mark_in_case_json_is_accepted():
    Path("case.toml").write_text(BLOCK)
    write_case(read_case("case.toml"), Path("out"), MPI.COMM_WORLD)
    kept = Path("out/case.json")
    kept.write_bytes(b"\xef\xbb\xbf" + kept.read_bytes())
    assert written_case(Path("out")) == read_case("case.toml")
    kept.write_text(100_000 * "[")
    with pytest.raises(ValueError, match=r"out/case\.json: "):
        written_case(Path("out"))


@pytest.fixture
def odd_files():
    """A pipe without a writer, a device and a socket."""
    os.mkfifo("pipe.msh")
    listening = socket.socket(socket.AF_UNIX)
    listening.bind("socket.msh")
    yield {"pipe.msh": "a pipe", "/dev/zero": "a device", "socket.msh": "a socket"}
    listening.close()


def test_pipes_and_devices_are_refused_unopened(odd_files):
    for name, kind in odd_files.items():
        for read in (read_case, read_xdmf, read_fclib, *([read_mesh] if name.endswith(".msh") else [])):
            with pytest.raises(ValueError, match=f"{name}: cannot be read.*: it is {kind}: save the contents"):
                read(name)
    Path("mesh.xdmf").write_text(
        '<Xdmf><Domain><Grid><Geometry><DataItem Format="HDF">pipe.msh:/x</DataItem></Geometry></Grid></Domain></Xdmf>'
    )
    with pytest.raises(ValueError, match="it is a pipe"):
        read_xdmf("mesh.xdmf")


def test_a_mesh_of_as_many_unknowns_as_petsc_has_numbers_for():
    """What is refused is in data/wrong_inputs.json."""
    refuse_too_many_cells((800, 800, 800), 1, force=True, comm=MPI.COMM_SELF)
    assert np.prod([801, 801, 801]) * 3 < 2**31 < np.prod([901, 901, 901]) * 3
