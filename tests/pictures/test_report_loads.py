"""Loads, load curves and expressions of a case in the words of the report."""

import numpy as np
import pytest

from coulomb.pictures.report.problem import in_time, supports_and_loads, values_in_time

CASE = {
    "gravity": [0.0, 0.0, -9.81],
    "gravity_amplitude": {"table": [[0.0, 0.0], [1.0, 1.0]], "after": "error"},
    "body": [{"name": "lower"}, {"name": "upper", "gravity": [0.0, 0.0, 0.0]}],
    "body_force": ["10*x", 0.0, 0.0],
    "traction": [{"face": "top", "value": [0.0, 0.0, "-1e6*x"]}, {"face": "left", "value": [1e6, 0.0, 0.0]}],
    "pressure": [{"face": "bore", "value": 2e6}, {"face": "rim", "value": "1e5*z", "amplitude": [[0, 0], [2, 1]]}],
    "total_force": [{"face": "lug", "force": [0.0, 0.0, -5e3]}],
    "prescribed_displacement": [{"face": "right", "value": ["1e-6*y", 0.0, 0.0], "components": "x"}],
}


def test_loads_in_words():
    said = {name: text.replace("\u202f", " ") for name, text in supports_and_loads(CASE)}
    assert said == {
        "prescribed displacement on right": "components x: (1e-6*y, 0, 0) m",
        "traction on top": "(0, 0, -1e6*x) Pa",
        "traction on left": "(1, 0, 0) MPa",
        "pressure on bore": "2 MPa",
        "pressure on rim": "1e5*z Pa, factor 0 at 0 s, 1 at 2 s",
        "total force on lug": "(0, 0, −5) kN",
        "body force": "(10*x, 0, 0) N/m³",
        "gravity": "(0, 0, −9.81) m/s², factor 0 at 0 s, 1 at 1 s, not defined after the last",
        "gravity on upper": "(0, 0, 0) m/s², factor 0 at 0 s, 1 at 1 s, not defined after the last",
    }


def test_load_curves_in_words_and_numbers():
    curve = {"table": [[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]], "after": "repeat"}
    assert in_time(curve).replace("\u202f", " ") == ", factor 0 at 0 s, 2 at 1 s, 0 at 2 s, repeated"
    assert in_time([[k, 0.5] for k in range(20)]).endswith(", …")
    assert in_time(None) == ""
    assert values_in_time(curve, [0.5, 2.5, 3.5])[:, 0] == pytest.approx([1.0, 1.0, 1.0])
    assert values_in_time([[0, 0, 0, 0], [1, 1, 2, 3]], [0.5, 2.0]) == pytest.approx(
        np.array([[0.5, 1, 1.5], [1, 2, 3]])
    )
