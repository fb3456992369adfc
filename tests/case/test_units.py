"""Units of a case: nothing is converted, the numbers of a case and its results are in them; angles in degrees."""

import json
import tomllib
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from conftest import ROOT, run_coulomb

from coulomb import Equation, RigidFace, Spring, units
from coulomb.case.case import Case, read_case
from coulomb.fem.bodies.rigid_modes import RigidLoad, RigidPart
from coulomb.fem.bodies.supports import held_in_words
from coulomb.pictures.report.problem import _material
from coulomb.units import Units, plain, quantity, vector

MM = [
    'units={length="mm", stress="MPa"}',
    "mesh.box=[3000.0,1000.0,1000.0]",
    "mesh.cells=[6,2,2]",
    "material.young=2.119e5",
    "traction.0.value=[0.0,10.0,-40.0]",
    "traction.1.value=[20.0,0.0,0.0]",
]
"""demos/block.toml."""


def run(directory, changes):
    words = [word for change in changes for word in ("--set", change)]
    done = run_coulomb("run", ROOT / "demos" / "block.toml", *words, "--output", directory)
    return done.stdout, json.loads((directory / "summary.json").read_text())


def test_a_block_in_millimetres(tmp_path):
    """The same forces, in newtons; lengths and stresses in the units of the case; the same words."""
    said, si = run(tmp_path / "si", ["mesh.cells=[6,2,2]"])
    said_mm, mm = run(tmp_path / "mm", MM)
    assert mm["units"] == {"length": "mm", "stress": "MPa", "force": "N", "moment": "N mm", "energy": "mJ"}
    for name, factor in {"force": 1.0, "moment": 1e3, "greatest_slip": 1e3, "greatest_pressure": 1e-6}.items():
        assert np.array(mm["totals"][name]) == pytest.approx(factor * np.array(si["totals"][name]), rel=1e-9), name

    def words(text):
        return [line for line in text.splitlines() if line.startswith(("body", "load", "force on", "contact nodes"))]

    assert words(said_mm) == words(said) and len(words(said)) == 5
    root = ElementTree.parse(tmp_path / "mm" / "contact.xdmf")
    shown = {one.get("Name").removeprefix("unit of "): one.get("Value") for one in root.iter("Information")}
    assert {"pressure": "MPa", "slip": "mm", "contact_force": "N", "area": "mm²"}.items() <= shown.items()
    run_coulomb("check", tmp_path / "mm")


def test_names_of_units():
    assert [Units("mm", "MPa").name(one) for one in ("N", "J", "N m", "W", "J/m²", "m/N")] == [
        *("N", "mJ", "N mm", "mW", "mJ/mm²", "mm/N"),
    ]
    assert [Units("mm", "GPa").name(one) for one in ("N", "J")] == ["kN", "J"]
    assert [Units("in", "psi").name(one) for one in ("Pa", "N", "N m", "N/m³")] == ["psi", "lbf", "lbf in", "lbf/in³"]
    assert Units("cm", "kPa").name("m/N") == "cm/(kPa cm²)" and Units().name("rad") == Units("mm").name("rad") == "rad"
    with pytest.raises(ValueError, match="units: length must be one of m, cm, mm, um, in, ft, but is 'km'"):
        units.use("km")


def test_numbers_with_units():
    """1 in² psi is the pound-force, 4.448 N."""
    assert Units("in", "psi").factor("N") == pytest.approx(4.4482216152605, rel=1e-12)
    units.use("mm", "MPa")
    assert plain(quantity(0.024, "m")) == "24 um" and plain(quantity(182.9, "Pa")) == "182.9 MPa"
    assert plain(vector([10.0, 0.0, -2e6], "N m")) == "(0, 0, -2) kN m" and plain(quantity(5e5, "m²")) == "0.5 m^2"
    assert plain(quantity(6.8e-13, "m", 2)) == "6.8e-13 mm" and plain(quantity(0.0, "J")) == "0 mJ"
    units.use("in", "psi")
    assert plain(quantity(0.024, "m")) == "0.024 in" and plain(quantity(1.2e4, "N")) == "12000 lbf"


class _Said:
    """A function of place as a case gives it."""

    def __init__(self, said):
        self.said = said

    def __call__(self, x):
        return x


def test_words_about_loads_springs_and_the_report():
    """In N, mm and MPa: 20000 N mm are 20 N m, 7.8e-9 t/mm3 are 7800 kg/m3; numbers as given have the units given."""
    units.use("mm", "MPa")
    part = RigidPart(np.zeros(3), 50.0)
    assert str(RigidLoad(0, part, np.zeros(3), np.array([0.0, 0.0, 2e4]))).startswith(
        "around z through (0, 0, 0) with 20 N m"
    )
    assert Spring("front", 7.0).holds == "stiffness 7 N/mm^3"
    assert RigidFace("top", translation_stiffness=(1, 2, 3)).holds.startswith(
        "stiffness (1, 2, 3) N/mm and (0, 0, 0) N mm/rad"
    )
    far = Equation([((1049,), "x", 1.0), ([7], "y", -1.0)], stiffness=2.0)
    assert far.eliminated == "nodes 1049" and Equation([(["a:1", "a:2"], "x", 1.0)]).eliminated == "nodes 'a:1', 'a:2'"
    assert held_in_words("xyz", _Said("x-1"), 0.0) == "along x-1"
    assert held_in_words("xyz", _Said("(1.0)*(x-(-5.0))+" * 9), 0.0) == "along a function of x"
    assert "7800 kg/m³" in _material({"young": 2.1e5, "poisson": 0.3, "density": 7.8e-9})


def test_degrees():
    turned = {"face": "right", "point": [0, 0, 0], "axis": [1, 0, 0], "degrees": 90}
    rows = {"point": [0, 0, 0], "axis": [0, 0, 1], "degrees": [[0, 0], [2, 180.0]]}
    table = tomllib.loads((ROOT / "demos" / "block.toml").read_text())
    table |= {"prescribed_rotation": [turned], "history": {"times": [1.0]}}
    table["contact"]["rotation"] = rows
    case = Case.model_validate(table)
    assert case.prescribed_rotation[0].angle == pytest.approx(np.pi / 2)
    assert case.contact.rotation.angle == ((0.0, 0.0), (2.0, pytest.approx(np.pi)))
    turned["angle"] = 1.0
    with pytest.raises(ValueError, match=r"give angle \(radians\) or degrees, one of the two"):
        Case.model_validate(table)


def test_a_csv_file_in_degrees(tmp_path):
    (tmp_path / "turn.csv").write_text("0, 0\n2, 180\n")
    rotation = 'contact.rotation={point=[0,0,0], axis=[0,0,1], degrees={file="turn.csv"}}'
    (tmp_path / "case.toml").write_text((ROOT / "demos" / "block.toml").read_text())
    case = read_case(tmp_path / "case.toml", [rotation, "history={times=[1.0]}"])
    assert case.contact.rotation.angle.table[-1] == (2.0, pytest.approx(np.pi))
    again = Case.model_validate_json(case.model_dump_json(exclude_unset=True))
    assert again.contact.rotation.angle.table == case.contact.rotation.angle.table
