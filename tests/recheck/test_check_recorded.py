"""`coulomb check`: meshes of the files, what was accepted knowingly, and the names of what cannot be compared."""

import copy
import json
from dataclasses import replace

import h5py
import pytest
from bodies_runs import TWO
from check_runs import BALL, BLOCK, copied, edit, get, leaves, made, put, shown
from conftest import run_coulomb
from mesh_files import BoxFile
from mpi4py import MPI
from shared_problems import FailsAt
from test_check_files import SQUEEZED

import coulomb
from coulomb.case.case import read_case
from coulomb.case.record import write_case
from coulomb.io import output
from coulomb.io.history_files import HistoryFiles
from coulomb.recheck import check

SECOND_ORDER = {
    cell: BLOCK.replace("cells = [6, 3, 2]", f'cells = [3, 2, 1], cell = "{cell}", degree = 2')
    for cell in ("hexahedron", "tetrahedron")
}
MESHES = {
    "quadrilaterals": (BLOCK, ".", "contact.h5", "mesh"),
    "9 nodes": (SECOND_ORDER["hexahedron"], ".", "contact.h5", "mesh"),
    "6 nodes": (SECOND_ORDER["tetrahedron"], ".", "contact.h5", "mesh"),
    "triangles of a slave": (TWO, "steps/0001", "contact.h5", "upper_bottom"),
    "quadrilaterals of a master": (TWO, "steps/0001", "contact.h5", "lower_top"),
    "hexahedra": (BLOCK, ".", "solution.h5", "mesh"),
    "27 nodes": (SECOND_ORDER["hexahedron"], ".", "solution.h5", "mesh"),
    "10 nodes": (SECOND_ORDER["tetrahedron"], ".", "solution.h5", "mesh"),
}


REFUSED = r"have them in another order|has another mesh than the case"


def topology(path, group, function):
    with h5py.File(path, "r+") as file:
        data = file[f"Mesh/{group}/topology"]
        data[...] = function(data[...])


def exchanged(i, j):
    def spoil(rows):
        rows[len(rows) // 2, [i, j]] = rows[len(rows) // 2, [j, i]]
        return rows

    return spoil


def twice(rows):
    rows[0] = rows[-1]
    return rows


OTHERS = [(name, exchanged(0, 1)) for name in MESHES] + [(name, exchanged(-2, -1)) for name in ("9 nodes", "10 nodes")]
OTHERS += [(name, twice) for name in ("hexahedra", "quadrilaterals", "triangles of a slave")]


@pytest.mark.parametrize(("name", "spoil"), OTHERS)
def test_nodes_of_a_cell_in_another_order(name, spoil, tmp_path):
    """A quadrilateral of which two nodes are exchanged is a bow tie; the order of triangles is that of the body."""
    text, folder, file, group = MESHES[name]
    run = copied(text, tmp_path / "run") / folder
    topology(run / file, group, spoil)
    with pytest.raises(ValueError, match=REFUSED):
        check(run)


def accept(contents):
    contents["small_strain"]["accepted"] = contents["valid"] = True


def test_nobody_else_accepts_strains_outside_the_theory(tmp_path):
    """What was accepted is in case.json: from the summary alone an answer outside the theory does not become valid."""
    folder = copied(SQUEEZED, tmp_path / "run")
    edit(folder / "summary.json", accept)
    found = check(folder)
    assert not found.passed and found.outside
    assert any(fault.startswith("summary.json.small_strain.accepted: True, but False") for fault in found.faults)
    assert any(fault.startswith("summary.json.valid: True, but False") for fault in found.faults)
    edit(folder / "case.json", lambda case: case.update(small_strain="warn"))
    assert check(folder).passed


HISTORY = f"{SQUEEZED}[history]\ntimes = [1.0, 2.0]\n"


def test_a_step_outside_the_theory_stays_so(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text(HISTORY)
    run = ("run", case, "--set", "output.picture=false", "--output")
    run_coulomb(*run, tmp_path / "strict", code=1)
    run_coulomb(*run, tmp_path / "forced", "--force")
    assert json.loads((tmp_path / "forced" / "case.json").read_text())["small_strain"] == "warn"
    strict, forced = check(tmp_path / "strict"), check(tmp_path / "forced")
    assert not strict.passed and not any(step.faults for step in strict.steps) and forced.passed
    edit(tmp_path / "strict" / "steps/0001/summary.json", accept)
    assert any("small_strain.accepted" in fault for fault in check(tmp_path / "strict").steps[0].faults)
    edit(tmp_path / "strict" / "case.json", lambda case: case.update(small_strain="warn"))  # as before a resume
    assert any("small_strain.accepted" in fault for fault in check(tmp_path / "strict").steps[0].faults)


def named(found):
    (line,) = [line for line in found.trusted if line.startswith("as recorded by the run")]
    return line.partition(": ")[2].split(", ")


def without_effect(folder, said):
    """Entries of summary.json that may be changed without a fault, each by itself named in the last line or in a
    tolerance of rounding.  Those of a table are changed together, and by themselves if no fault names them."""
    contents, tables = json.loads((folder / "summary.json").read_text()), {}
    for path, value in leaves(contents):
        top = next((key for key in path[1:][::-1] if isinstance(key, str)), None)
        if path[0] not in said and f"{top} of {path[0]}" not in said and not isinstance(value, float):
            tables.setdefault(path[0], []).append(path)

    def faults(paths):
        spoilt = copy.deepcopy(contents)
        for path in paths:
            value = get(contents, path)
            put(spoilt, path, not value if isinstance(value, bool) else "other")
        (folder / "summary.json").write_text(json.dumps(spoilt))
        try:
            return check(folder).faults
        except ValueError as error:
            return (str(error),)

    passing = []
    for paths in tables.values():
        named = faults(paths)
        alone = [path for path in paths if not any(fault.startswith(shown(path)) for fault in named)]
        passing += [path for path in alone if not faults([path])]
    return passing


@pytest.mark.parametrize("with_case", [True, False])
def test_every_entry_is_compared_or_named(with_case, tmp_path):
    folder = copied(SQUEEZED, tmp_path / "run")
    if not with_case:
        (folder / "case.json").unlink()
    edit(folder / "summary.json", lambda contents: contents["totals"].update(news=1))
    said = named(check(folder))
    assert {"news of totals", "residual", "iterations.csv"} <= set(said)
    assert ("solver of case.json" in said) is with_case
    assert ("meaning of certificate" in said and "loads" in said) is not with_case
    assert not without_effect(folder, said)


def test_other_files_and_fields_are_named(tmp_path):
    mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2))
    clamp = coulomb.PrescribedDisplacement("top", (0.0, 0.0, -1e-3))
    steel, floor = coulomb.Material(2.1e11, 0.3), coulomb.Contact("bottom", 0.3)
    solution = coulomb.ContactProblem(mesh, steel, [clamp], floor).solve()
    output.write(solution, tmp_path, fields={"mine": solution.function})
    (tmp_path / "notes.txt").write_text("mine")
    for said in (named(check(tmp_path)), named(check(tmp_path, solution.problem))):
        assert {"mine of solution.xdmf", "iterations.csv", "notes.txt"} <= set(said)


def test_a_history_names_them_in_one_line():
    said = named(check(made(BALL)))
    whole = {"start of history", "iterations.csv of the step", "path_following and residual of history.csv"}
    assert whole | {"solver of case.json", "residual"} <= set(said) and len(said) == len(set(said))
    assert not {f"{one} of step" for one in ("energy", "row", "pending", "halvings")} & set(said)


def test_times_of_the_fields(tmp_path):
    folder = copied(BALL, tmp_path / "run") / "steps/0002"
    path = folder / "solution.xdmf"
    path.write_text(path.read_text().replace('Time Value="2.0"', 'Time Value="2.5"'))
    assert any(fault.startswith("solution.xdmf: time: 2.5, but 2 follows") for fault in check(folder).faults)


def test_halvings_are_the_new_times(tmp_path):
    folder = copied(BALL, tmp_path / "run")
    edit(folder / "steps/0002/summary.json", lambda summary: summary["step"].update(halvings=1))
    assert any("halved 1 times, but the times [] are new" in fault for fault in check(folder).faults)
    edit(folder / "steps/0002/summary.json", lambda summary: summary["step"].update(halvings=0))
    for times, new in (([1, 2], [3.0]), ([1, 3], [2.0])):
        edit(folder / "case.json", lambda case, times=times: case["history"].update(times=times))
        (fault,) = check(folder).faults
        assert f"halved 0 times, but the times {new} are new" in fault


def test_columns_of_no_step(tmp_path):
    folder = copied(BALL, tmp_path / "run")
    lines = (folder / "history.csv").read_text().splitlines()
    (folder / "history.csv").write_text("\n".join([f"{lines[0]},more", *(f"{line},1" for line in lines[1:])]) + "\n")
    assert check(folder).faults == ["history.csv: has columns that no load step has: more"]


def test_a_halved_step_agrees(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text(BALL)
    settings = read_case(case)
    history = replace(settings.load_history(), solver=FailsAt((1, 2)))
    history.run(settings.problem(MPI.COMM_SELF), HistoryFiles(tmp_path / "run"))
    write_case(settings, tmp_path / "run", MPI.COMM_SELF)
    found = check(tmp_path / "run")
    assert found.passed and len(found.steps) == 5


OF_FILE = """\
mesh = {file = "part.msh"}
material = {young = 2e11, poisson = 0.3}
contact = {face = "bottom", friction = 0.3}
clamp = [{face = "left"}]
traction = [{face = "top", value = [1e6, 0.0, -2e7], amplitude = [[0, 0], [2, 1]]}]
history = {times = [1, 2], halvings = 3}
solver = {tolerance = 1e-9}
"""


def test_the_case_of_a_step(tmp_path):
    """What may not change between steps is compared with case.json, and what may is named."""
    BoxFile().write(tmp_path / "part.msh")
    (tmp_path / "case.toml").write_text(OF_FILE)
    run = tmp_path / "run"
    run_coulomb("run", "case.toml", "--set", "output.picture=false", "--output", run, cwd=tmp_path)
    path, said = run / "steps/0001/summary.json", named(check(run))
    contents = json.loads(path.read_text())
    places = {place: value for place, value in leaves(contents["step"]["case"])}
    for place, value in places.items():
        other = "other.msh" if isinstance(value, str) else value + 1 if isinstance(value, int) else 1.5 * value or 0.5
        put(contents["step"]["case"], place, other)
    path.write_text(json.dumps(contents))
    free = {("tables", *place) for place in (("mesh", "file"), ("history", "halvings"), ("solver", "tolerance"))}
    faults = [fault.removeprefix("summary.json.step.case: ") for fault in check(run / "steps/0001").faults]
    assert len(faults) == len(places.keys() - free)
    for place in places.keys() - free:
        name = ".".join(map(str, place[1:]))
        start = f"the contents of {name}" if place[0] == "files" else f"{name} is "
        assert any(fault.startswith(start) for fault in faults), (start, faults)
    assert {"file of step", "halvings of step", "solver of step"} <= set(said)
    assert "case of step" not in said and "tables of step" not in said and "files of step" not in said
