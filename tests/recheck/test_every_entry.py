"""`coulomb check` compares every field and every number of a run, whatever the problem has."""

import json
import shutil

import h5py
import numpy as np
import pytest
from bodies_runs import TWO, UNLOADED
from case_texts import body, one_body
from check_runs import BALL, BLOCK, TRESCA_STEPS, WEDGE, copied, get, leaves, made, one_entry, put, shown
from history_runs import ENDING_SUPPORTS, ENDING_TIES, PRESS_FIT, RUBBER_ON_RUBBER, SHOE, TURNED_BOLT, TURNED_FACE
from mpi4py import MPI
from resumed_rows import rows_of, same_to_the_tolerance
from rubber_blocks import DRAWN
from test_check_heat import BARS, SLIDER
from test_check_supports import CASE
from test_check_supports import PRESSED as LOADED
from test_check_ties import GLUED, SCREWED, SPRING, SPRUNG
from two_pairs_runs import LENS

from coulomb.case.record import written_case
from coulomb.contact_fields import COMPLIANCES
from coulomb.io.field_files import grids_of
from coulomb.io.history_files import HistoryFiles
from coulomb.recheck import check, run
from coulomb.recheck.posed import OF_SOLVER

SECTOR = one_body((0.5, 0.5, 0.4), (3, 4, 2))
SECTOR += """\
cyclic_symmetry = [{ face = "left", against = "front", axis = [0.0, 0.0, 1.0], sectors = 4 }]
traction = [{ face = "top", value = ["-4e5*y", "4e5*x", "-1e6"] }]
contact = { face = "bottom", friction = 0.3 }
"""

PRESSED = one_body((0.1, 0.1, 0.02), (4, 3, 2), 1e9)
PRESSED += """\
contact = { face = "bottom", friction = 0.3 }
history = { times = [0.5, 1.0] }
point_load = [{ face = "top", force = [0.0, 0.0, -5e3], moment = [0.0, 2.0, 0.0] }]
[[rigid_face]]
face = "top"
translation = { x = 0.0, y = 0.0 }
rotation = { x = 0.0, z = 0.004 }
amplitude = [[0.0, 0.0], [1.0, 1.0]]
"""

SLICE = one_body((0.1, 0.02, 0.05), (4, 1, 3), 1e9, degree=2)
SLICE += """\
contact = { face = "bottom", friction = 0.3 }
history = { times = [0.5, 1.0] }
symmetry = [{ face = "front" }]
rigid_face = [{ face = "back", along = "free", rotation = { x = 1e-4 }, amplitude = [[0.0, 0.0], [1.0, 1.0]] }]
point_load = [{ face = "top", force = [20.0, 5.0, -5e2] }]
"""

WOUND = {"shear": [5e9, 4.5e9, 3.5e9], "directions": '[["1 + x", "y", 0.3], [0, 0, 1]]', "density": 1600.0}
WOUND |= {"young": [1.3e11, 1.1e10, 9e9], "poisson": [0.28, 0.3, 0.4], "expansion": [-1e-6, 3e-5, 2e-5]}
ORTHOTROPIC = one_body((1.0, 0.8, 0.6), (3, 2, 2), cell="tetrahedron", **WOUND)
ORTHOTROPIC += """\
[temperature]
value = "20 + 40*x - 30*z"
reference = 15.0
amplitude = [[0, 0], [2, 1]]
[[clamp]]
face = "top"
[[traction]]
face = "right"
value = [1e6, 2e5, -3e5]
[contact]
face = "bottom"
friction = 0.3
foundation = {point = [0.0, 0.0, 3e-5], normal = [0.0, 0.0, 1.0]}
[history]
times = [1, 2]
[output]
picture = false
"""

SLIP_RATE = BALL.replace("friction = 0.4", "friction = { static = 0.4, kinetic = 0.2, decay_speed = 1e-3 }")

RUNS = {
    "hexahedra": (BLOCK, "."),
    "tetrahedra": (WEDGE, "."),
    "ball": (BALL, "steps/0002"),
    "pair": (TWO, "steps/0001"),
    "large motions": (DRAWN.replace("times = [0.5, 1.0, 1.5, 2.0]", "times = [0.5, 1.0, 1.2]"), "steps/0003"),
    "oblique supports": (CASE, "steps/0003"),
    "tie": (GLUED, "steps/0001"),
    "sector": (SECTOR, "."),
    "rigid face": (PRESSED, "steps/0002"),
    "slice": (SLICE, "steps/0002"),
    "springs of a rigid face": (SPRUNG, "steps/0002"),
    "bolt": (SCREWED, "steps/0002"),
    "locked bolt": (SCREWED, "steps/0004"),
    "foundation under load": (LOADED, "steps/0002"),
    "heat": (BARS, "."),
    "heat of friction": (SLIDER, "steps/0002"),
    "orthotropic": (ORTHOTROPIC, "steps/0002"),
    "gaps": (PRESS_FIT, "steps/0002"),
    "rotation": (SHOE, "steps/0003"),
    "slip rate": (SLIP_RATE, "steps/0003"),
    "a face in two pairs": (LENS, "steps/0002"),
}
"""Case, and the directory in which files are changed."""

LEFT = {
    "large motions": {"stress_xy", "stress_yz"},
    "oblique supports": {"friction_work"},
    "a face in two pairs": {"friction_work"},
    "heat": {"temperature_change"},
    "heat of friction": {"temperature_change"},
}
"""Fields that are rounding errors, and temperatures, of which one entry is less than conduction is solved for."""

GIVEN = {"displacement", "contact_force", *COMPLIANCES, "status", "node", "opposite_of", "node_number"}
"""Fields that the others follow from, and whole numbers."""


def held_beside(name, beside, height=0.0, kind=()):
    """A body, of which one face follows nodes of a coarser one beside it that is clamped."""
    size = (1.0, 0.5, 0.5)
    beside = body(beside, size, (2, 2, 2), (0.0, 0.0, height), 1e5, 0.3, *kind)
    return beside + body(name, size, (3, 3, 3), (1.0, 0.0, height), 1e5, 0.3, *kind)


FOLLOWING = """\
contact = { face = "b:bottom", friction = 0.3 }
tie = [{ face = "b:left", against = "a:right", slave = true }]
traction = [{ face = "b:top", value = [0, 1e3, -2e3] }]
clamp = [{ face = "a:left" }, { face = "a:right" }]
"""
"""Nodes that follow clamped ones are no contact points: they are found anew by the ties of the case."""

STACKED = """\
contact = { face = "b:top", against = "d:bottom", slave = true, friction = 0.3 }
traction = [{ face = "d:top", value = [0, 0, -50] }]
clamp = [{ face = "a:left" }, { face = "a:right" }, { face = "c:left" }, { face = "c:right" }]
tie = [
    { face = "b:left", against = "a:right", slave = true },
    { face = "d:left", against = "c:right", slave = true },
]
"""
STACKED += held_beside("b", "a") + held_beside("d", "c", 0.5)
"""The same of a pair, on both sides."""

FLOATING = """\
tie = [{ face = "pad:top", against = "top:bottom" }]
traction = [{ face = "top:top", value = [2400.0, 0.0, -15000.0] }]
contact = { face = "pad:bottom", friction = 0.3 }
"""
FLOATING += body("pad", (0.8, 0.4, 0.2), (3, 1, 2), None, 2e9, cell="tetrahedron")
FLOATING += body("top", (0.8, 0.4, 0.4), (3, 2, 1), (0.0, 0.0, 0.2), 1.5e8, degree=2)
"""Tied bodies that contact holds, each by itself: sums of rounding errors of both together differ from these."""

UNCHANGED = {name: text for name, (text, _) in RUNS.items() if name != "locked bolt"}
UNCHANGED |= {
    "successive Tresca": BLOCK + '[solver]\nmethod = "successive-tresca"\n',
    "springs of a body before the last": TWO.replace(
        "[[prescribed", '[[spring]]\nface = "lower:top"\nstiffness = 1e9\n[[prescribed'
    ),
    "no contact force in the last step": UNLOADED,
    "springs of rigid faces alone": SPRUNG.replace(SPRING, ""),
    "followers of hexahedra": FOLLOWING + held_beside("b", "a"),
    "followers of tetrahedra": FOLLOWING + held_beside("b", "a", kind=("tetrahedron", 2)),
    "followers on both sides": STACKED,
    "floating": FLOATING,
}


def agree(found):
    """That a check has passed, with the case, and names what it takes from the files."""
    assert found.passed and found.recorded, str(found)
    for one in found.steps or (found,):
        assert all(f"{field} of contact.xdmf" in one.trusted[-1] for field in COMPLIANCES)


@pytest.mark.parametrize("name", UNCHANGED)
def test_unchanged_files_agree_without_a_case(name, tmp_path):
    folder = copied(UNCHANGED[name], tmp_path / "run")
    (folder / "case.json").unlink()
    found = check(folder)
    assert found.passed and "judged from the files alone, since there is no case.json" in str(found), str(found)


def changed_fields(folder, spoil, left):
    """The beginnings of the faults of all fields but those left, which are changed."""
    for file in ("solution", "contact"):
        grids = grids_of(folder / f"{file}.xdmf")
        with h5py.File(folder / f"{file}.h5", "r+") as opened:
            for grid, group in grids.items():
                fields = opened["Function"][group] if group else opened["Function"]
                for field in sorted({*fields} - left):
                    data = fields[f"{field}/0"]
                    data[...] = spoil(data[...])
                    yield f"{file}.xdmf: {field}{f' of {grid}' if grid else ''}: "


OF_STEP = ("number", "time", "case", "pending", "halvings")
"""Of a load step, what the check takes from there or judges otherwise."""


def judged(path):
    """Whether an entry follows from the answer; names of faces and what is understood are of the case."""
    if path[0] in (*OF_SOLVER, "remarks", "understood", "law", "loaded_foundations", "run", "picture"):
        return False
    taken = ("step", *OF_STEP), ("heat", "rounds", "agreement")
    return "faces" not in path[-2:] and not any(path[0] == top and path[1] in names for top, *names in taken)


@pytest.mark.parametrize("name", RUNS)
def test_every_field_and_number(name, tmp_path, monkeypatch):
    """All are changed at once, one entry of every field, and every number by a millionth of itself unless it is a
    rounding error; each is named."""
    folder = copied(RUNS[name][0], tmp_path / "run") / RUNS[name][1]
    numbers, numbers_of = [], run.numbers_of
    monkeypatch.setattr(run, "numbers_of", lambda *of: numbers.append(numbers_of(*of)) or numbers[-1])
    agree(check(folder))
    millionths, spoilt, largest = 0, json.loads((folder / "summary.json").read_text()), dict[str, float]()
    places = [(path, value) for path, value in leaves(spoilt) if judged(path)]

    def key(path):
        return next(name for name in path[::-1] if isinstance(name, str))

    for path, value in places:
        if isinstance(value, float):
            largest[key(path)] = max(largest.get(key(path), 0.0), abs(value))
    for path, value in places:
        rounding = np.ptp([get(of, path) for of in numbers]) if isinstance(value, float) else 0.0
        rounding = max(rounding, 2e-13 * largest.get(key(path), 0.0), 1e-12 * (path[0] == "certificate"))
        if isinstance(value, bool):
            put(spoilt, path, not value)
        elif isinstance(value, int):
            put(spoilt, path, value + 1)
        elif isinstance(value, float):
            exact = rounding < 1e-7 * abs(value)
            millionths += exact
            put(spoilt, path, value * (1.0 + 1e-6) if exact else value + 10.0 * rounding + 1e-12)
        else:
            put(spoilt, path, "other")
    assert millionths > 40
    (folder / "summary.json").write_text(json.dumps(spoilt))
    changed = [*changed_fields(folder, one_entry, GIVEN | LEFT.get(name, set())), *(shown(path) for path, _ in places)]
    faults = check(folder).faults
    missed = [start for start in changed if not any(fault.startswith(start) for fault in faults)]
    assert not missed, missed


HISTORIES = {
    name: text for name, (text, step) in RUNS.items() if step != "." and name not in ("bolt", "a face in two pairs")
}
HISTORIES |= {
    "Tresca": TRESCA_STEPS,
    "supports that end": ENDING_SUPPORTS,
    "ties that end": ENDING_TIES,
    "two bodies in large motions": RUBBER_ON_RUBBER,
    "turned bolt": TURNED_BOLT,
    "turned face": TURNED_FACE,
}


LOST = {"supports that end": 2, "ties that end": 3}
"""Steps that are lost, after which supports are on their way and faces tied; of the others one."""


@pytest.mark.parametrize("name", HISTORIES)
def test_a_history_goes_on_from_its_files(name, tmp_path):
    """The last steps are lost and computed again."""
    folder, whole = copied(HISTORIES[name], tmp_path / "run"), rows_of(made(HISTORIES[name]))
    for number in range(LOST.get(name, 1)):
        shutil.rmtree(folder / f"steps/{len(whole) - number:04d}")
    settings = written_case(folder)
    settings.load_history().run(settings.problem(MPI.COMM_SELF), HistoryFiles(folder, resume=True))
    assert all(map(same_to_the_tolerance, rows_of(folder), whole))
    agree(check(folder))


@pytest.mark.parametrize("name", [name for name in UNCHANGED if name not in RUNS | HISTORIES])
def test_other_unchanged_results_agree(name):
    """Those of `RUNS` and `HISTORIES` are checked before and after what is done with them."""
    agree(check(made(UNCHANGED[name])))
