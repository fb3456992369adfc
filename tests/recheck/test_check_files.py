"""`coulomb check` refuses fields and numbers that do not follow from the answer, or differ from the case."""

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
    put,
    run_case,
    scaled,
    shown,
)
from shared_problems import lose

from coulomb.model.nodal_answer import HELD, OPEN, SLIP, STICK
from coulomb.recheck import check


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


NAMES = {("law",): "tresca", ("totals", "faces"): ["top"], ("faces", 0, "faces"): ["top"], ("friction",): 0.3}


def test_names_of_law_and_faces(tmp_path):
    folder = copied(BLOCK, tmp_path / "run")
    for key, value in NAMES.items():
        edit(folder / "summary.json", lambda contents, key=key, value=value: put(contents, key, value))
    faults = check(folder).faults
    assert not [key for key in NAMES if not any(fault.startswith(shown(key)) for fault in faults)]


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
