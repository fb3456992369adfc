"""`coulomb check` refuses fields and numbers that do not follow from the answer, or differ from the case."""

import json
import re

import h5py
import numpy as np
import pytest
from bodies_runs import TWO
from case_texts import one_body
from check_runs import (
    BALL,
    BLOCK,
    UNASKED,
    WEDGE,
    change,
    copied,
    edit,
    field,
    get,
    leaves,
    made,
    one_entry,
    put,
    run_case,
    scaled,
    shown,
)
from shared_problems import lose

from coulomb.contact_fields import COMPLIANCES, names
from coulomb.model.nodal_answer import HELD, OPEN, SLIP, STICK
from coulomb.recheck import check, run

ON_CELLS = ("von_mises_stress", "stress_xz", "principal_stress_2", "young", "poisson")
RUNS = {"hexahedra": BLOCK, "tetrahedra": WEDGE}
ON_BODY = ("displacement", "load", "held", "prescribed", "spring_force", "reaction", "rigid_force_5", *ON_CELLS)
ON_FACE = [name for name in names() if name not in ("status", *COMPLIANCES)]  # of the solver's matrix: as recorded


@pytest.mark.parametrize("text", RUNS.values(), ids=RUNS)
def test_unchanged_results_agree(text):
    found = check(made(text))
    assert found.passed and found.recorded, found
    assert not any("taken as written" in line for line in found.trusted)
    assert all(f"{name} of contact.xdmf" in found.trusted[-1] for name in COMPLIANCES)


@pytest.mark.parametrize("text", RUNS.values(), ids=RUNS)
def test_a_missing_case_is_reported(text, tmp_path):
    folder = copied(text, tmp_path / "run")
    (folder / "case.json").unlink()
    found = check(folder)
    assert found.passed, found
    assert any("from the files alone, since there is no case.json" in line for line in found.trusted)


def spoilt(folder, names, spoil):
    for name in names:
        change(folder / f"{'solution' if name in ON_BODY else 'contact'}.h5", name, spoil)
    return check(folder)


def named(faults, name):
    file = "solution" if name in ON_BODY else "contact"
    return any(fault.startswith((f"{file}.xdmf: {name}",)) for fault in faults)


@pytest.mark.parametrize("spoil", [scaled(1.0 + 1e-6), one_entry], ids=["all", "one entry"])
@pytest.mark.parametrize("text", RUNS.values(), ids=RUNS)
def test_every_field(text, spoil, tmp_path):
    """From displacement and contact force follow others; all of them are changed at once, and each is named."""
    answer = ("displacement", "contact_force")
    for name in answer:
        found = spoilt(copied(text, tmp_path / name), [name], spoil)
        assert not found.passed and len(found.faults) >= 3
    others = sorted({*ON_BODY, *ON_FACE} - {*answer})
    faults = spoilt(copied(text, tmp_path / "run"), others, spoil).faults
    assert not [name for name in others if not named(faults, name)]


@pytest.mark.parametrize(("old", "new"), [(STICK, SLIP), (SLIP, STICK), (SLIP, OPEN), (SLIP, HELD), (HELD, STICK)])
def test_status_of_one_node(old, new, tmp_path):
    folder = copied(BLOCK, tmp_path / "run")

    def spoil(status):
        status[np.argmax(np.round(status[:, 0]) == old)] = new
        return status

    assert np.any(np.round(field(folder / "contact.h5", "status")) == old)
    change(folder / "contact.h5", "status", spoil)
    assert any(fault.startswith("contact.xdmf: status") for fault in check(folder).faults)


def test_held_nodes_have_no_fields(tmp_path):
    folder = copied(BLOCK, tmp_path / "run")
    held = np.round(field(folder / "contact.h5", "status")) == HELD
    change(folder / "contact.h5", "pressure", lambda p: np.where(held[:, None], 1.0, p))
    assert any(fault.startswith("contact.xdmf: pressure: 1 at") for fault in check(folder).faults)


@pytest.mark.parametrize("text", RUNS.values(), ids=RUNS)
def test_every_number(text, tmp_path, monkeypatch):
    """All are changed at once, each by a millionth of itself unless it is a rounding error; each is named."""
    folder, numbers, numbers_of = copied(text, tmp_path / "run"), [], run.numbers_of
    monkeypatch.setattr(run, "numbers_of", lambda *of: numbers.append(numbers_of(*of)) or numbers[-1])
    assert check(folder).passed
    first, *others = ({**of, "small_strain": {**of["small_strain"], "violations": []}} for of in numbers)
    millionths, spoilt, largest = 0, json.loads((folder / "summary.json").read_text()), dict[str, float]()
    places = [(path, value) for path, value in leaves(first) if path[0] not in ("remarks", "understood")]

    def key(path):
        return next(name for name in path[::-1] if isinstance(name, str))

    for path, value in places:
        if isinstance(value, float):
            largest[key(path)] = max(largest.get(key(path), 0.0), abs(value))
    for path, value in places:
        rounding = max(abs(get(other, path) - value) for other in others) if isinstance(value, float) else 0.0
        rounding = max(rounding, 2e-13 * largest.get(key(path), 0.0), 1e-12 * (path[0] == "certificate"))
        if isinstance(value, bool):
            put(spoilt, path, not value)
        elif isinstance(value, int):
            put(spoilt, path, value + 1)
        elif isinstance(value, float):
            exact = rounding < 1e-7 * abs(value)
            millionths += exact
            put(spoilt, path, value * (1.0 + 1e-6) if exact else value + 10.0 * rounding + 1e-12)
        elif path != ("law",) and "faces" not in path[-2:]:
            put(spoilt, path, "other")
    assert millionths > 40
    (folder / "summary.json").write_text(json.dumps(spoilt))
    faults = check(folder).faults
    for path, _ in places:
        if path[-1] != "law" and "faces" not in path[-2:]:
            assert any(fault.startswith(shown(path)) for fault in faults), path


NUMBERS = (
    [
        (("law",), "tresca"),
        (("totals", "faces"), ["top"]),
        (("material", 0, "young"), 2.000002e11),
        (("material", 0, "cells"), "stiff"),
        (("friction", "min"), 0.1000001),
        (("certificate", "passed"), False),
        (("certificate", "penetration", "limit"), 1e-5),
        (("certificate", "penetration", "value"), 1e-7),
        (("small_strain", "gradient"), 1e-9),
    ],
    [(("friction",), 0.3), (("faces", 0, "faces"), ["top"])],
)


@pytest.mark.parametrize("numbers", NUMBERS)
def test_numbers_of_the_case_and_the_certificate(numbers, tmp_path):
    folder = copied(BLOCK, tmp_path / "run")
    for key, value in numbers:
        edit(folder / "summary.json", lambda contents, key=key, value=value: put(contents, key, value))
    faults = check(folder).faults
    assert not [key for key, _ in numbers if not any(fault.startswith(shown(key)) for fault in faults)]


@pytest.mark.parametrize("key", ["totals", "nodes", "maximum", "certificate.penetration", "small_strain", "material"])
def test_missing_numbers(key, tmp_path):
    folder = copied(BLOCK, tmp_path / "run")
    *path, last = key.split(".")
    edit(folder / "summary.json", lambda contents: get(contents, path).pop(last))
    try:
        assert any(key in fault for fault in check(folder).faults)
    except ValueError as error:
        assert f"has no {key!r}" in str(error)


LOWERED = {"point": [0, 0, -1e-9], "normal": [0, 0, 1]}
OTHER_NUMBERS = {
    "summary.json.friction.max": lambda c: c["contact"].update(friction=0.300001),
    "summary.json.friction.min": lambda c: c["contact"]["region"][0].update(friction=0.1000001),
    "contact.xdmf: initial_gap": lambda c: c["contact"].update(
        foundation={"point": [0, 0, -1e-9], "normal": [0, 0, 1]}
    ),
    "solution.xdmf: prescribed": lambda c: c["clamp"][0].update(value=[0.0, 1e-6, -2.000002e-6]),
    "solution.xdmf: spring_force": lambda c: c["spring"][0].update(stiffness=[0.0, 1e9, 2.000002e9]),
    "summary.json.loads[0].force[2]": lambda c: c["traction"][0].update(value=[1e6, 2e6, -2.00002e7]),
    "summary.json.material[0].young": lambda c: c["material"].update(young=2.000002e11),
    "summary.json.material[0].poisson": lambda c: c["material"].update(poisson=0.3000003),
}


def test_other_numbers_in_the_case(tmp_path):
    """All are changed at once; each has a fault of its own."""
    folder = copied(BLOCK, tmp_path / "run")
    for other in OTHER_NUMBERS.values():
        edit(folder / "case.json", other)
    faults = check(folder).faults
    assert not [name for name in OTHER_NUMBERS if not any(fault.startswith(f"{name}: ") for fault in faults)]


OTHER_CASES = {
    "place of a region": lambda c: c["contact"]["region"][0]["box"][1].__setitem__(0, 0.7),
    "no region": lambda c: c["contact"].pop("region"),
    "law": lambda c: c.update(contact={"face": "bottom", "slip_stress": 1e6}),
    "face": lambda c: c["contact"].update(face="back"),
    "inclination": lambda c: c["contact"].update(foundation={"point": [0, 0, 0], "normal": [0, 1e-7, 1]}),
    "clamp": lambda c: c["clamp"][0].update(components="xy"),
    "another clamp": lambda c: c["clamp"].append({"face": "right", "components": "y"}),
    "no spring": lambda c: c.pop("spring"),
    "body force": lambda c: c.update(body_force=[0.0, 0.0, -1.0]),
    "mesh": lambda c: c["mesh"].update(cells=[6, 3, 3]),
    "size": lambda c: c["mesh"].update(box=[1.2, 0.6, 0.400001]),
    "cells": lambda c: c["mesh"].update(cell="tetrahedron"),
    "history": lambda c: c.update(history={"times": [1.0]}),
    "a face that is none": lambda c: c["traction"][0].update(face="left"),
}


@pytest.mark.parametrize("other", OTHER_CASES.values(), ids=OTHER_CASES)
def test_another_case(other, tmp_path):
    folder = copied(BLOCK, tmp_path / "run")
    edit(folder / "case.json", other)
    assert_refused(folder)


def assert_refused(folder):
    """There are faults, or the files do not belong to the problem of the case, or it has none."""
    try:
        found = check(folder)
    except ValueError as error:
        assert re.search("case.json|another mesh", str(error))
    else:
        assert found.faults and not found.passed


def two_faces(*changes):
    return lambda c: [c["contact"][k].update(table) for k, table in changes]


@pytest.mark.parametrize(
    "other",
    [
        two_faces((0, {"slip_stress": 2.000002e6})),
        two_faces((1, {"slip_stress": 2e6})),
        two_faces((0, {"normals": "foundation"})),
        two_faces((0, {"face": "right"}), (1, {"face": "bottom"})),
        lambda c: c["contact"].pop(),
        lambda c: c["contact"][0]["foundation"].update(radius=2000.0000101),
    ],
    ids=["slip stress", "of the other face", "normals", "faces changed round", "one face", "radius"],
)
def test_another_case_of_two_faces(other, tmp_path):
    folder = copied(WEDGE, tmp_path / "run")
    edit(folder / "case.json", other)
    assert_refused(folder)


def test_a_missing_mesh_file(tmp_path):
    """Then the problem cannot be posed, and the files are judged alone."""
    folder = copied(BLOCK, tmp_path / "run")
    gone = str(tmp_path / "part.msh")
    edit(folder / "case.json", lambda c: c.update(mesh={"file": gone}))
    found = check(folder)
    assert found.passed and any(f"since {gone} is not there" in line for line in found.trusted)
    change(folder / "contact.h5", "pressure", scaled(1.001))
    assert not check(folder).passed


def test_nodes_missing_from_the_surface(monkeypatch, tmp_path):
    """A faulty contact surface, in the run and in the check, omits the middle third of the face."""
    lose(monkeypatch, lambda x: (x[:, 0] > 0.39) & (x[:, 0] < 0.81))
    folder = run_case(BLOCK.replace("[[contact.region]]", "").split("box = [[")[0] + UNASKED, tmp_path / "run")
    assert np.sum(np.round(field(folder / "contact.h5", "status")) == HELD) > 10
    found = check(folder)
    assert not found.passed and found.certificate["penetration"].value > 1e-2


def test_a_single_step(tmp_path):
    folder = copied(BALL, tmp_path / "run")
    (folder / "steps" / "0002").rename(tmp_path / "alone")
    found = check(tmp_path / "alone")
    assert found.passed, found
    assert any("slip origin" in line for line in found.trusted)


SQUEEZED = one_body((1.2, 0.6, 0.4), (6, 3, 2))
SQUEEZED += """\
clamp = [{ face = "top", value = [0.0, 0.0, -0.15] }]
contact = { face = "bottom", friction = 0.3 }
"""


@pytest.mark.parametrize("accepted", [False, True])
@pytest.mark.parametrize("with_case", [False, True])
def test_outside_the_theory(accepted, with_case, tmp_path):
    folder = copied(f'small_strain = "warn"\n{SQUEEZED}' if accepted else SQUEEZED, tmp_path / "run")
    if not with_case:
        (folder / "case.json").unlink()
    found = check(folder)
    assert found.certified and not found.faults, found
    assert found.passed is accepted and ("outside the theory: displacement grad" in str(found)) is not accepted
    edit(folder / "summary.json", lambda contents: contents.update(valid=not accepted))
    assert any(fault.startswith("summary.json.valid") for fault in check(folder).faults)


def put_at_most(path, group, name, where, value):
    """A value of a field at the node where another field has its largest value."""
    with h5py.File(path, "r+") as file:
        fields = file["Function"][group]
        node = int(np.argmax(next(iter(fields[where].values()))[:, 0]))
        next(iter(fields[name].values()))[node] = value


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_clamped_node_that_is_called_open(tmp_path):
    """It is written without a normal and without an area."""
    folder = copied(BLOCK, tmp_path / "run")
    put_at_most(folder / "contact.h5", ".", "status", "status", OPEN)
    assert any(fault.startswith("contact.xdmf: status") for fault in check(folder).faults)
    (folder / "case.json").unlink()
    with pytest.raises(ValueError, match="of a contact point are no axes"):
        check(folder)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(
    ("text", "folder", "group"), [(BLOCK, ".", "."), (TWO, "steps/0001", "upper_bottom")], ids=["foundation", "pair"]
)
@pytest.mark.parametrize("name", ["normal", "tangent_1"])
def test_a_contact_node_without_an_axis(text, folder, group, name, tmp_path):
    run = copied(text, tmp_path / "run")
    put_at_most(run / folder / "contact.h5", group, name, "pressure", 0.0)
    faults = check(run).faults if folder == "." else check(run).steps[0].faults
    assert any(fault.startswith(f"contact.xdmf: {name}") for fault in faults), faults
    (run / "case.json").unlink()
    with pytest.raises(ValueError, match="of a contact point are no axes"):
        check(run)
