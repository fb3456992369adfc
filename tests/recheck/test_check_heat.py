"""Heat in the files of a run: checked by `coulomb check`, continued by `coulomb resume`."""

import json

import numpy as np
import pytest
from case_texts import body, one_body
from check_runs import change, copied, made
from conftest import run_coulomb

from coulomb.recheck import check

BARS = """\
reference_temperature = 20.0
clamp = [{ face = "lower:bottom" }]
symmetry = [{ face = "upper:left" }, { face = "upper:front" }]
pressure = [{ face = "upper:top", value = 1e6 }]
[[heat]]
face = "lower:bottom"
temperature = 20.0
[[heat]]
face = "upper:top"
film = 500.0
ambient = "80 + 100*x"
[[heat]]
source = 1e5
body = "upper"
[contact]
face = "upper:bottom"
against = "lower:top"
friction = 0.2
thermal = { factor = 2e3, hardness = 1e6 }
"""
BARS += body("lower", (0.02, 0.02, 0.05), (3, 2, 4), expansion=1.2e-5, conductivity=50.0)
ALUMINIUM = {"young": 7e10, "poisson": 0.33, "expansion": 2.3e-5, "conductivity": 200.0}
BARS += body("upper", (0.02, 0.02, 0.03), (4, 3, 5), (0.0, 0.0, 0.05), cell="tetrahedron", degree=2, **ALUMINIUM)

SLIDER = one_body((0.04, 0.02, 0.02), (4, 2, 3), expansion=1e-5, conductivity=50.0)
SLIDER += """\
reference_temperature = 25.0
history = { times = [1.0, 1.5, 1.75] }
[[prescribed_displacement]]
face = "top"
components = "yz"
value = [0.0, 0.0, -2e-6]
amplitude = [[0, 0], [1, 1]]
[[prescribed_displacement]]
face = "top"
components = "x"
value = [2e-3, 0.0, 0.0]
amplitude = [[1, 0], [2, 1]]
[[heat]]
face = "top"
temperature = 30.0
[[heat]]
face = "front"
flux = 1e3
amplitude = [[0, 0], [1, 1]]
[contact]
face = "bottom"
friction = 0.3
thermal = { factor = 2e4, hardness = 1e8, temperature = 25.0, share = 0.3 }
"""


def changed(values):
    """One entry that no load acts on, by a hundred thousandth of the largest."""
    place = np.argmin(np.abs(np.abs(values) - 0.5 * np.max(np.abs(values))))
    values.flat[place] += 1e-5 * np.max(np.abs(values))
    return values


def test_a_changed_temperature_is_found(tmp_path):
    """With the load that it causes it would be a solution of the contact problem."""
    folder = copied(SLIDER, tmp_path / "run") / "steps/0003"
    change(folder / "solution.h5", "temperature_change", changed)
    faults = check(folder).faults
    assert any("temperature_change" in line and "conduction, contact forces and slip" in line for line in faults)


def test_columns_of_a_history():
    """Friction power is its force times slip rate; heat flows add up to nothing."""
    row = json.loads((made(SLIDER) / "steps/0003/summary.json").read_text())["step"]["row"]
    flows = [name for name in row if name.startswith("heat_") and name != "heat_imbalance"]
    assert flows == ["heat_temperature_top", "heat_heat_flux_front", "heat_friction_bottom", "heat_foundation_bottom"]
    assert row["heat_heat_flux_front"] == pytest.approx(1e3 * 8e-4)
    assert row["heat_friction_bottom"] == pytest.approx(0.3 * row["normal_force"] * 2e-3, rel=1e-3)
    assert sum(row[name] for name in flows) == pytest.approx(0.0, abs=1e-8 * row["heat_friction_bottom"])
    assert 25.0 < row["temperature_min"] < row["temperature_max"] == 30.0


def test_a_run_whose_heat_is_not_found_has_no_valid_answer(tmp_path):
    """Nothing fixes the temperature of the upper bar; its contact at the reference temperature alone is solved."""
    case, target = tmp_path / "case.toml", tmp_path / "run"
    film = '[[heat]]\nface = "upper:top"\nfilm = 500.0\nambient = "80 + 100*x"\n'
    assert film in BARS
    case.write_text(BARS.replace(film, "").replace("thermal = { factor = 2e3, hardness = 1e6 }", ""))
    done = run_coulomb("run", case, "--output", target, "--set", "output.picture=false", code=1)
    summary = json.loads((target / "summary.json").read_text())
    assert "nothing fixes the temperature of upper" in done.stderr
    assert (
        not summary["valid"] and not summary["certificate"]["passed"] and not summary["certificate"]["heat"]["passed"]
    )
    run_coulomb("check", target, code=1)
