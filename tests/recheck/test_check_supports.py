"""Runs with supports along any direction, from case files: coulomb check recomputes them."""

import json

import h5py
import numpy as np
import pytest
from case_texts import one_body
from check_runs import copied, edit, made, put

from coulomb.recheck import check

CASE = """\
mesh = { box = [1.0, 0.6, 0.5], cells = [3, 2, 2], cell = "tetrahedron" }
material = { young = 1e9, poisson = 0.3 }
clamp = [{ face = "left", direction = [1, 0, 0.4] }, { face = "back", components = "tangential" }]
symmetry = [{ face = "front" }]
history = { times = [1.0, 2.0, 3.0] }
[[prescribed_displacement]]
face = "top"
value = [0, 0, -1e-3]
components = "z"
amplitude = [[0, 0], [1, 1]]
[[prescribed_displacement]]
face = "top"
value = [2e-3, -1e-3, 0]
direction = [2, -1, 0]
amplitude = [[1, 0], [3, 1]]
[[prescribed_rotation]]
face = "right"
point = [0.5, 0, 0]
axis = [0, 1, 0]
angle = 1e-4
axial = "free"
amplitude = [[0, 0], [3, 1]]
[contact]
face = "bottom"
friction = 0.3
foundation = { shape = "plane", point = [0, 0, 0], normal = [0.1, 0.2, 1] }
"""
"""A block on an inclined floor, which four supports meet obliquely."""


def test_all_figures_can_be_recomputed():
    whole = made(CASE)
    step = json.loads((whole / "steps" / "0003" / "summary.json").read_text())
    kinds = [reaction["kind"] for reaction in step["reactions"]]
    assert kinds == [
        *("clamp", "clamp", "prescribed_displacement", "prescribed_displacement", "prescribed_rotation", "symmetry")
    ]
    total = np.sum([part["force"] for part in step["reactions"]], axis=0) + step["totals"]["force"]
    assert np.abs(total).max() <= 1e-10 * np.abs(step["totals"]["force"]).max()
    header = (whole / "history.csv").read_text().splitlines()[0].split(",")
    assert {"symmetry_front_force_y", "prescribed_rotation_right_moment_y", "clamp_left_force_x"} <= set(header)


TOUCHING = """\
mesh = { box = [1.0, 1.0, 1.0], cells = [3, 3, 3], KIND }
material = { young = 1e5, poisson = 0.3 }
clamp = [{ face = "left" }]
traction = [{ face = "top", value = [0, 0, -1e3] }]
contact = { face = "bottom", friction = 0.3 }
"""


@pytest.mark.parametrize("kind", ['cell = "hexahedron"', 'cell = "tetrahedron", degree = 2'])
def test_held_nodes_inside_the_foundation_are_seen(kind, tmp_path):
    """The gap of nodes that supports hold is found anew: here in files in which they are 1 mm inside the
    floor."""
    run = copied(TOUCHING.replace("KIND", kind), tmp_path / "run")
    assert check(run).passed
    with h5py.File(run / "solution.h5", "r+") as file:
        held = file["Mesh/mesh/geometry"][:, 0] < 1e-9
        values = next(iter(file["Function/displacement"].values()))
        values[...] = np.where(held[:, None], [0.0, 0.0, -1e-3], values[...])
    certificate = check(run).certificate
    assert not certificate["penetration"].passed and not certificate["clamps"].passed
    assert certificate.penetration == pytest.approx(1e-3)


PRESSED = one_body((1.0, 1.0, 0.5), (3, 2, 1), 1e9)
PRESSED += """\
clamp = [{ face = "bottom" }]
history = { times = [0.5, 1.0] }
[contact]
face = "top"
friction = 0.2
force = { x = 1e5, z = -1e6 }
moment = { y = 0.0 }
force_point = [0.55, 0.5, 0.5]
force_amplitude = [[0, 0], [1, 1]]
"""


def test_the_load_on_a_foundation_is_judged_from_the_files(tmp_path):
    """Also where its motion, or the force that the case gives, is another one."""
    found = check(made(PRESSED))
    assert found.passed and not found.faults, str(found)
    assert "foundation balance" in str(check(made(PRESSED) / "steps/0002").certificate)
    for place, value in (("translation", 2), ("rotation", 1)):
        folder = copied(PRESSED, tmp_path / place) / "steps/0002"
        edit(folder / "summary.json", lambda of, at=(place, value): put(of, ("loaded_foundations", 0, *at), -4e-4))
        assert not check(folder).certificate.passed
    folder = copied(PRESSED, tmp_path / "force")
    edit(folder / "case.json", lambda case: case["contact"]["force"].update(z=-1.001e6))
    assert not check(folder / "steps/0002").certificate["foundation balance"].passed
