"""Small runs whose files the tests of `coulomb check` change: each is computed once and copied."""

import functools
import json
import shutil
import tempfile
from pathlib import Path

import h5py
import numpy as np
from case_texts import one_body
from mpi4py import MPI
from two_pairs_runs import LENS, write_lens

from coulomb.case.case import read_case
from coulomb.case.record import write_case
from coulomb.io import output
from coulomb.io.field_files import read_grids
from coulomb.io.history_files import HistoryFiles

BLOCK = one_body((1.2, 0.6, 0.4), (6, 3, 2))
BLOCK += """\
clamp = [{ face = "left", value = [0.0, 1e-6, 2e-6] }]
spring = [{ face = "right", stiffness = [0.0, 1e9, 2e9] }]
traction = [{ face = "top", value = [1e6, 2e6, -2e7] }]
[contact]
face = "bottom"
friction = 0.3
[[contact.region]]
box = [[0.5, 0.0, 0.0], [0.9, 0.6, 0.0]]
friction = 0.1
[[probe]]
name = "heel"
point = [0.33, 0.21, 0.0]
[[probe]]
name = "middle"
point = [0.5, 0.3, 0.2]
"""
"""Hexahedra, Coulomb friction by region, the plane of the face, a clamp that moves, springs."""

WEDGE = one_body((1.2, 0.6, 0.4), (4, 2, 2), cell="tetrahedron")
WEDGE += """\
clamp = [{ face = "left", value = [3e-5, 1e-5, -2e-5] }]
traction = [{ face = "right", value = [2e6, 1e6, -4e6] }]
spring = [{ face = "back", stiffness = 1e8 }]
[[contact]]
face = "bottom"
slip_stress = 2e6
foundation = {shape = "sphere", centre = [0.6, 0.3, -2000.0], radius = 2000.00001}
normals = "body"
[[contact]]
face = "top"
slip_stress = 1e6
foundation = {point = [0.8, 0.0, 0.39999], normal = [0.0, 0.00001, -1.0]}
"""
"""Tetrahedra, Tresca friction, two faces: one against a ball, with the body's normals, one against an oblique plane."""

BALL = one_body((1.0, 0.6, 0.4), (4, 3, 2), 5e6, 0.4)
BALL += """\
[[clamp]]
face = "top"
value = [0.0, 2e-3, 0.0]
amplitude = [[0, 0], [1, 0], [3, 1]]
[[traction]]
face = "right"
value = [1e3, 0.0, 2e3]
amplitude = [[0, 1], [3, 2]]
[contact]
face = "bottom"
friction = 0.4
foundation = {shape = "sphere", centre = [0.5, 0.3, -8.0], radius = 8.0}
motion = [[0, 0, 0, 0], [1, 0, 0, 5e-3], [2, 2e-3, 0, 5e-3], [3, -1e-3, 1e-3, 6e-3]]
[[probe]]
name = "heel"
point = [0.6, 0.3, 0.0]
[history]
times = [1, 2, 3]
"""
"""Hexahedra, a load history of three steps: a moving ball, a clamp and a traction with amplitudes."""

TRESCA_STEPS = BALL.replace("cells = [4, 3, 2]", 'cells = [4, 2, 2], cell = "tetrahedron"').replace(
    "friction = 0.4", "slip_stress = 2e4"
)
"""The same history with tetrahedra and Tresca friction."""

UNASKED = "[solver]\ntolerance = 2e-8\n"
"""Above 1e-8 the solver does not evaluate the certificate, so that only the check can detect a fault of the code."""


def read_grid(path):
    """The only grid of an XDMF file, or the first of several."""
    return next(iter(read_grids(path).values()))


_RUNS = tempfile.TemporaryDirectory(prefix="coulomb-check-")  # removed at the end of the process


@functools.cache
def made(text):
    """Directory of a computed case; tests must not change it."""
    folder = Path(tempfile.mkdtemp(dir=_RUNS.name))
    if text is LENS:
        write_lens(folder)
    return run_case(text, folder / "run")


def run_case(text, target):
    """Run a case in this process as `coulomb run` does."""
    case = target.with_suffix(".toml")
    case.write_text(text)
    settings = read_case(case)
    problem = settings.problem(MPI.COMM_SELF)
    if settings.history is not None:
        settings.load_history().run(problem, HistoryFiles(target))
    else:
        output.write(problem.solve(solver=settings.contact_solver()), target)
    write_case(settings, target, MPI.COMM_SELF)
    return target


def copied(text, target):
    """A copy of a run that a test may change."""
    return Path(shutil.copytree(made(text), target))


def change(path, name, function):
    """Change a field of an HDF5 file in place."""
    with h5py.File(path, "r+") as file:
        group = file[f"Function/{name}"]
        data = group[next(iter(group))]
        data[...] = function(data[...])


def field(path, name):
    """A field of an HDF5 file."""
    with h5py.File(path, "r") as file:
        group = file[f"Function/{name}"]
        return np.squeeze(group[next(iter(group))][...])


def edit(path, function):
    """Change a JSON file in place."""
    tables = json.loads(path.read_text())
    function(tables)
    path.write_text(json.dumps(tables))


def leaves(tree, path=()):
    """All entries of JSON with their places."""
    if isinstance(tree, dict | list):
        for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield from leaves(value, (*path, key))
    else:
        yield path, tree


def put(tree, path, value):
    """Replace an entry of JSON."""
    for key in path[:-1]:
        tree = tree[key]
    tree[path[-1]] = value


def get(tree, path):
    """An entry of JSON."""
    for key in path:
        tree = tree[key]
    return tree


def shown(path):
    """A place as it is written in a fault."""
    return "summary.json" + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)


_NOTHING = 1e-10
"""Below this a field is zero but for what the solver leaves: gaps in metres of a closed face, at a residual of 1e-8."""


def scaled(factor):
    """A field times a factor; a field of zeros gets one value other than zero."""

    def spoil(values):
        if np.max(np.abs(values)) > _NOTHING:
            return factor * values
        values.flat[values.shape[-1] * (len(values) // 2)] = 1e-6
        return values

    return spoil


def one_entry(values):
    """The largest entry by a millionth."""
    largest = np.unravel_index(np.argmax(np.abs(values)), values.shape)
    values[largest] = values[largest] * (1.0 + 1e-6) if abs(values[largest]) > _NOTHING else 1e-6
    return values


def fields(path):
    """By name, at the points of the file."""
    with h5py.File(path) as file:
        found = {name: np.squeeze(group["0"][()]) for name, group in file["Function"].items() if name != "young"}
        return {"x": file["Mesh/mesh/geometry"][()], **found}


def order(points, wanted):
    """For each wanted place the number of the point there."""
    distance = np.linalg.norm(points[None] - wanted[:, None], axis=2)
    assert distance.min(axis=1).max() < 1e-12
    return distance.argmin(axis=1)
