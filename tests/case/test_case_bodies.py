"""[[body]] tables of a case: several bodies, each with mesh, material and place."""

import json
from pathlib import Path

import numpy as np
import pytest
from case_texts import body
from mesh_files import BoxFile
from mpi4py import MPI

from coulomb import Contact
from coulomb.case.case import Case, read_case
from coulomb.case.record import case_record, case_text
from coulomb.fem.meshes.named_mesh import volume

BLOCKS = """
clamp = [{ face = "lower:bottom" }, { face = "upper:top" }]
contact = { face = "upper:bottom", against = "lower:top", friction = 0.4 }
"""
BLOCKS += body("lower", (1.2, 0.6, 0.4), (2, 1, 1), young=2.1e11)
BLOCKS += body("upper", (0.8, 0.4, 0.4), (1, 1, 1), (0.2, 0.1, 0.4), 7e10, 0.33, "tetrahedron")
BLOCKS += """\
rotate = { axis = [0.0, 0.0, 2.0], angle = 1.5707963267948966, point = [0.4, 0.2, 0.0] }
"""


ONE = """
mesh = { box = [1.0, 1.0, 1.0], cells = [1, 1, 1] }
material = { young = 1e9, poisson = 0.3 }
contact = { face = "bottom", friction = 0.3 }
"""


@pytest.fixture(autouse=True)
def blocks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(BLOCKS)


def said(*changes, text=BLOCKS):
    """The message about a case; empty if it is right."""
    Path("case.toml").write_text(text)
    try:
        assert isinstance(read_case("case.toml", changes), Case)
    except ValueError as fault:
        return str(fault)
    return ""


def bodies_of(case):
    return {member.name: member.body for member in case.problem(MPI.COMM_WORLD).elasticity.members}


def test_bodies_are_where_their_tables_say():
    bodies = bodies_of(read_case("case.toml"))
    assert list(bodies) == ["lower", "upper"]
    x = bodies["upper"].mesh.domain.geometry.x
    low, high = MPI.COMM_WORLD.allreduce(x.min(axis=0), MPI.MIN), MPI.COMM_WORLD.allreduce(x.max(axis=0), MPI.MAX)
    # (x, y) -> (0.4 - (y - 0.2), 0.2 + (x - 0.4)) of a rectangle 0.8 x 0.4 is one 0.4 x 0.8; then the translation
    assert np.allclose(low, [0.4, -0.1, 0.4], atol=1e-12) and np.allclose(high, [0.8, 0.7, 0.8], atol=1e-12)
    assert MPI.COMM_WORLD.allreduce(volume(bodies["upper"].mesh)) == pytest.approx(0.8 * 0.4 * 0.4)
    assert bodies["lower"].materials.young == 2.1e11 and bodies["upper"].materials.poisson == 0.33
    assert [support.face for support in bodies["upper"].supports] == ["top"]


def test_groups_and_files_of_bodies():
    """A file in two bodies: two copies of one part; the case that is kept names it by its whole path."""
    BoxFile().write(Path("part.msh"))
    part = '[[body]]\nname = "{}"\nfile = "part.msh"\ntranslate = [0.0, 0.0, {}]\n[[body.material]]\ncells = "{}"\n'
    constants = "young = 1e9\npoisson = 0.3\n"
    text = "".join(part.format(name, 2.0 * k, "steel") + constants for k, name in enumerate(("one", "other")))
    text += '[contact]\nface = "one:top"\nagainst = "other:bottom"\nfriction = 0.3\n'
    Path("case.toml").write_text(text)
    case = read_case("case.toml")
    assert list(case.materials()) == ["one:steel", "other:steel"]
    kept = json.loads(case_text(case))
    assert [body["file"] for body in kept["body"]] == [str(Path("part.msh").absolute())] * 2
    record = case_record(case, MPI.COMM_WORLD)
    assert list(record["files"]) == ["body.0.file", "body.1.file"]


def test_the_temperature_of_one_body():
    changes = ["temperature={value=20, body='upper', reference=5}", "body.1.material.expansion=1e-5"]
    bodies = bodies_of(read_case("case.toml", changes))
    assert bodies["lower"].thermal is None and np.all(bodies["upper"].at(0.0).temperature.change == 15.0)
    assert "temperature.body = 'upper': there are no [[body]] tables" in said(changes[0], text=ONE)


def test_gravity_of_one_body():
    """Its weight is density times volume times its own gravity; the others have that of the case, here none."""
    changes = ["body.1.gravity=[0.0, 1.0, -10.0]", "body.1.material.density=1000.0"]
    bodies = bodies_of(read_case("case.toml", changes))
    load = MPI.COMM_WORLD.allreduce(bodies["upper"].at(0.0).load.sum(axis=0))
    assert load == pytest.approx(np.array([0.0, 1.0, -10.0]) * 1000.0 * 0.8 * 0.4 * 0.4, abs=1e-9)
    assert not bodies["lower"].loads
    other = ["gravity=[0.0, 0.0, -5.0]", "body.0.material.density=10.0", "body.1.gravity=[0.0, 0.0, 0.0]"]
    bodies = bodies_of(read_case("case.toml", other))
    size = volume(bodies["lower"].mesh)
    assert bodies["lower"].at(0.0).load.sum(axis=0)[2] == pytest.approx(-5.0 * 10.0 * size)
    assert not bodies["upper"].loads  # and it needs no density


def test_adjust_may_be_0():
    """It is the default: no gap is closed; only with a size does it need a face against."""
    given = ["contact.adjust=0", "contact.adjust=0.0", "contact.adjust=1e-4"]
    assert [read_case("case.toml", [one]).contact.adjust for one in given] == [0.0, 0.0, 1e-4]
    assert not said("contact.adjust=0", text=ONE) and "adjust goes with against" in said(
        "contact.adjust=1e-4", text=ONE
    )
    assert "contact.adjust = -0.1: should be greater than or equal to 0" in said("contact.adjust=-0.1")
    assert read_case("case.toml", ["contact.adjust=[0, 1e-4]"]).contact.contact().closed == (0.0, 1e-4)
    assert "contact.adjust.1 = -0.1: should be greater" in said("contact.adjust=[0, -0.1]")
    assert not said("contact.adjust=[0, 0]", text=ONE)
    for wrong in ((1e-4,), (1e-4, -1e-4), (1e-4, 1e-4, 1e-4), "1e-4", None):
        with pytest.raises(ValueError, match="adjust must be a number of metres >= 0, or one for gaps and one for pen"):
            Contact("a", against="b", friction=0.3, adjust=wrong)


@pytest.mark.parametrize(
    "change, message",
    [
        ("body.0.rotate={axis=[0,0,0],angle=1.0}", "body.0.rotate.axis = [0, 0, 0]: must not be zero"),
        ("body.0.colour='red'", "body.0.colour = 'red': there is no such key (known here: box, cells, cell, degree"),
        (
            "body.0.material=[{cells='a',young=1.0,poisson=0.3}]",
            "a box has no groups of cells; give one [body.material]",
        ),
        (
            "temperature={value=1,body='uper'}",
            "temperature.body = 'uper': there is no body 'uper' (did you mean 'upper'?)",
        ),
        ("body.0.clamp={face='top'}", "there is no such key; [[clamp]] is a table of its own (known"),
        ("body.0.mesh={box=[1,1,1]}", "there is no such key; its keys, as box or file, stand in [[body]] itself"),
        ("contact.master='lower:top'", 'there is no such key: write against = "lower:top"'),
        ("contact.motion=[[0,0,0,0],[1,0,0,1]]", "motion does not go with against"),
        ("body=[]", "case.toml: mesh: is missing\n"),
    ],
)
def test_wrong_bodies(change, message):
    assert message in said(change)
