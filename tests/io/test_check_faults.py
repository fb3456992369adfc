"""`coulomb check` finds faults that are planted in the files of small runs, one at a time."""

import shutil

import h5py
import numpy as np
import pytest
from bodies_runs import TWO
from check_runs import BALL, BLOCK, change, copied, edit, made, one_entry, put
from rubber_blocks import DRAWN
from test_check_heat import SLIDER
from test_check_ties import GLUED, SCREWED

from coulomb.io.recheck import check

LARGE = DRAWN.replace("times = [0.5, 1.0, 1.5, 2.0]", "times = [0.5, 1.0, 1.2]")
RUNS = {
    "block": (BLOCK, "."),
    "ball": (BALL, "steps/0002"),
    "pair": (TWO, "steps/0002"),
    "pad": (GLUED, "steps/0001"),
    "bolt": (SCREWED, "steps/0003"),
    "heat": (SLIDER, "steps/0002"),
    "large": (LARGE, "steps/0003"),
}
"""Case, and the directory in which files are changed."""


def entry(file, name):
    """The largest entry of a field by a millionth, an entry of a field of zeros by as much."""
    return lambda run: change(run / f"{file}.h5", name, one_entry)


def number(*path, by=1.000001):
    """An entry of summary.json by a millionth of itself; a text, a switch or a count by another one."""

    def fault(run):
        def other(contents):
            of = contents
            for key in path:
                of = of[key]
            other = not of if isinstance(of, bool) else of + 1 if isinstance(of, int) else f"{of}?"
            put(contents, path, of * by if isinstance(of, float) and of else 1e-6 if isinstance(of, float) else other)

        edit(run / "summary.json", other)

    return fault


def mesh(file, group, of, function):
    """Points ("geometry") or cells ("topology") of a grid."""

    def fault(run):
        with h5py.File(run / f"{file}.h5", "r+") as opened:
            data = opened[f"Mesh/{group}/{of}"]
            values = data[...]
            function(values)
            data[...] = values

    return fault


def swapped(rows):
    rows[len(rows) // 2, [0, 1]] = rows[len(rows) // 2, [1, 0]]


def twice(rows):
    rows[0] = rows[-1]


def moved(points):
    points[len(points) // 2] += 1e-6


def text(name, old, new):
    """The first place of a text in a file."""

    def fault(run):
        contents = (run / name).read_text()
        assert old in contents
        (run / name).write_text(contents.replace(old, new, 1))

    return fault


def without(group, name):
    """A field is missing in the HDF5 file."""

    def fault(run):
        with h5py.File(run / f"{group}.h5", "r+") as opened:
            del opened["Function"][name]

    return fault


def not_finite(run):
    def spoil(values):
        values[0] = np.nan
        return values

    change(run / "contact.h5", "pressure", spoil)


def of_another(case, *names):
    """Files of the run of another case."""

    def fault(run):
        for name in names:
            shutil.copy(made(case) / name, run / name)

    return fault


def of_step(step, *names):
    """Files of another step."""

    def fault(run):
        for name in names:
            shutil.copy(run.parent / step / name, run / name)

    return fault


def whole(fault):
    """In the directory of the history."""
    return lambda run: fault(run.parents[1])


def shorter(run):
    lines = (run / "history.csv").read_text().splitlines(keepends=True)
    (run / "history.csv").write_text("".join(lines[:-1]))


def other_number(run):
    """The third column of the second step in history.csv."""
    lines = [line.split(",") for line in (run / "history.csv").read_text().splitlines()]
    lines[2][2] = repr(float(lines[2][2]) * (1.0 + 1e-6) + 1e-6)
    (run / "history.csv").write_text("\n".join(map(",".join, lines)) + "\n")


def pending(run):
    edit(run / "summary.json", lambda contents: contents["step"].update(pending=[2.5]))


OTHER_LOAD = BLOCK.replace("-2e7]", "-2.1e7]")


def group_entry(file, group, name):
    return entry(file, f"{group}/{name}")


ON_BODY = ("displacement", "load", "held", "prescribed", "spring_force", "rigid_force_5", "young", "poisson")
STRESSES = ("von_mises_stress", "stress_xz", "principal_stress_2")
ON_FACE = (
    *("contact_force", "pressure", "friction_traction", "friction_use", "slip", "gap", "normal", "tangent_1"),
    *("initial_gap", "given_gap", "area", "friction", "cohesion", "coefficient", "slip_bound", "slip_origin"),
)
FAULTS = {
    **{f"block: {name}": entry("solution", name) for name in (*ON_BODY, *STRESSES)},
    **{f"block: {name}": entry("contact", name) for name in ON_FACE},
    "block: status": lambda run: change(run / "contact.h5", "status", lambda v: np.where(v == v.max(), v.min(), v)),
    "block: face": lambda run: change(run / "contact.h5", "face", lambda v: v + 1.0),
    "block: node": lambda run: change(run / "contact.h5", "node", lambda v: v[::-1]),
    "block: cells": mesh("solution", "mesh", "topology", swapped),
    "block: facets": mesh("contact", "mesh", "topology", swapped),
    "block: a facet twice": mesh("contact", "mesh", "topology", twice),
    "block: points": mesh("solution", "mesh", "geometry", moved),
    "block: points of the face": mesh("contact", "mesh", "geometry", moved),
    "block: no field": without("contact", "gap"),
    "block: not finite": not_finite,
    "block: xdmf": text("contact.xdmf", "/Function/gap/", "/Function/pressure/"),
    "block: time": lambda run: [
        text(f"{of}.xdmf", 'Value="0.0"', 'Value="1.0"')(run) for of in ("solution", "contact")
    ],
    "block: answer of another case": of_another(OTHER_LOAD, "solution.h5"),
    "block: forces of another case": of_another(OTHER_LOAD, "contact.h5"),
    "block: summary of another case": of_another(OTHER_LOAD, "summary.json"),
    "block: all files of another case": of_another(OTHER_LOAD, "solution.h5", "contact.h5", "summary.json"),
    "block: friction of the case": text("case.json", '"friction": 0.3', '"friction": 0.3001'),
    "block: material of the case": text("case.json", "0.3", "0.30001"),
    "block: total force": number("totals", "force", 0),
    "block: force of a face": number("faces", 0, "force", 2),
    "block: moment of a reaction": number("reactions", 0, "moment", 1),
    "block: load": number("loads", 0, "force", 2),
    "block: open nodes": number("nodes", "open"),
    "block: slip of a probe": number("probes", 0, "slip", 0),
    "block: largest pressure": number("maximum", "contact_pressure"),
    "block: certificate": number("certificate", "passed"),
    "block: equilibrium": number("certificate", "equilibrium", "passed"),
    "block: limit": number("certificate", "equilibrium", "limit"),
    "block: gradient": number("small_strain", "gradient"),
    "block: valid": number("valid"),
    "block: young": number("material", 0, "young"),
    **{f"ball: {name}": entry("contact", name) for name in ("accumulated_slip", "friction_work", "slip_origin")},
    "ball: largest pressure": entry("contact", "largest_pressure"),
    "ball: energy": number("step", "energy", "elastic"),
    "ball: row": number("step", "row", "energy_dissipated"),
    "ball: time": number("step", "time"),
    "ball: number": number("step", "number"),
    "ball: pending": pending,
    "ball: another step": of_step("0001", "solution.h5", "contact.h5"),
    "ball: all of another step": of_step("0001", "solution.h5", "contact.h5", "summary.json"),
    "ball: a line less": whole(shorter),
    "ball: history.csv": whole(other_number),
    "ball: series": whole(text("contact.xdmf", "steps/0002", "steps/0001")),
    "ball: summary of the whole": whole(number("history", "energy", "elastic")),
    "ball: steps": whole(number("steps")),
    "pair: force on the master": group_entry("contact", "lower_top", "contact_force"),
    "pair: pressure on the master": group_entry("contact", "lower_top", "pressure"),
    "pair: normal": group_entry("contact", "upper_bottom", "normal"),
    "pair: gap": group_entry("contact", "upper_bottom", "initial_gap"),
    "pair: area": group_entry("contact", "upper_bottom", "area"),
    "pair: temperature": group_entry("solution", "upper", "temperature_change"),
    "pair: facets of the master": mesh("contact", "lower_top", "topology", swapped),
    "pair: opposite force": number("faces", 0, "opposite_force", 2),
    "pair: force on a body": number("bodies", 0, "contact_force", 2),
    "pad: tie": group_entry("solution", "lower", "tie_force"),
    "pad: peel stress": group_entry("solution", "lower", "peel_stress"),
    "pad: force of a tie": number("ties", 0, "force", 2),
    "bolt: tie": group_entry("solution", "up", "tie_force"),
    "bolt: force": number("bolts", 0, "force"),
    "bolt: shortening": number("bolts", 0, "shortening"),
    "heat: temperature": lambda run: change(run / "solution.h5", "temperature_change", lambda v: v * 1.0001),
    "heat: power": lambda run: number("heat", "flows", 0, "power", by=1.001)(run),
    "large: displacement": entry("solution", "displacement"),
    "large: von Mises": entry("solution", "von_mises_stress"),
    "large: force": entry("contact", "contact_force"),
    "large: normal": entry("contact", "normal"),
    "large: energy": number("step", "energy", "elastic"),
}


@pytest.mark.parametrize("name", RUNS)
def test_unchanged(name):
    found = check(made(RUNS[name][0]))
    assert found.passed, str(found)


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
