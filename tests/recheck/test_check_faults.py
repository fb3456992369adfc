"""`coulomb check` finds faults that are planted in the files of small runs, one at a time: those that the tests
of fields and numbers do not plant."""

import shutil

import h5py
import numpy as np
import pytest
from check_runs import BALL, BLOCK, change, copied, made

from coulomb.recheck import check

RUNS = {
    "block": (BLOCK, "."),
    "tresca": (BLOCK + '[solver]\nmethod = "successive-tresca"\n', "."),
    "ball": (BALL, "steps/0002"),
}
"""Case, and the directory in which files are changed."""


def moved(file):
    """A point of the grid."""

    def fault(run):
        with h5py.File(run / f"{file}.h5", "r+") as opened:
            points = opened["Mesh/mesh/geometry"]
            points[len(points) // 2] += 1e-6

    return fault


def other_data(run):
    contents = (run / "contact.xdmf").read_text()
    assert "/Function/gap/" in contents
    (run / "contact.xdmf").write_text(contents.replace("/Function/gap/", "/Function/pressure/", 1))


def without_gap(run):
    with h5py.File(run / "contact.h5", "r+") as opened:
        del opened["Function/gap"]


def not_finite(values):
    values[0] = np.nan
    return values


def of_another(case, *names):
    """Files of the run of another case."""

    def fault(run):
        for name in names:
            shutil.copy(made(case) / name, run / name)

    return fault


def of_first_step(*names):
    def fault(run):
        for name in names:
            shutil.copy(run.parent / "0001" / name, run / name)

    return fault


OTHER_LOAD = BLOCK.replace("-2e7]", "-2.1e7]")
FAULTS = {
    "tresca: slip bound": lambda run: change(run / "contact.h5", "slip_bound", lambda g: 1.001 * g),
    "block: node": lambda run: change(run / "contact.h5", "node", lambda v: v[::-1]),
    "block: points": moved("solution"),
    "block: points of the face": moved("contact"),
    "block: no field": without_gap,
    "block: not finite": lambda run: change(run / "contact.h5", "pressure", not_finite),
    "block: xdmf": other_data,
    "block: answer of another case": of_another(OTHER_LOAD, "solution.h5"),
    "block: forces of another case": of_another(OTHER_LOAD, "contact.h5"),
    "block: summary of another case": of_another(OTHER_LOAD, "summary.json"),
    "block: all files of another case": of_another(OTHER_LOAD, "solution.h5", "contact.h5", "summary.json"),
    "ball: another step": of_first_step("solution.h5", "contact.h5"),
    "ball: all of another step": of_first_step("solution.h5", "contact.h5", "summary.json"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_planted_faults_are_found(name, tmp_path):
    """Each by itself, or the files are refused."""
    case, folder = RUNS[name.partition(":")[0]]
    run = copied(case, tmp_path / "run")
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    FAULTS[name](run / folder)
    assert any(path.read_bytes() != contents for path, contents in before.items()), "nothing was changed"
    try:
        found = check(run if name.startswith("ball") else run / folder)
    except ValueError:
        return
    assert not found.passed, str(found)
