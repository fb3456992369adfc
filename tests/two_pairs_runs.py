"""Runs of a body with one contact face, all around, between two others, for the tests of their files."""

import numpy as np
from case_texts import body
from mesh_files import BoxFile

PLATE = (1.0, 0.6, 0.3), (2, 1, 1)
LENS = """\
[[body]]
name = "mid"
file = "lens.msh"
material = {young = 7e10, poisson = 0.3}
[[clamp]]
face = "low:bottom"
[[prescribed_displacement]]
face = "up:top"
value = [2e-5, 1e-5, -4e-4]
amplitude = [[0, 0], [1, 1]]
[[contact]]
face = "mid:around"
against = "low:top"
friction = 0.3
[[contact]]
face = "mid:around"
against = "up:bottom"
friction = 0.05
[[probe]]
name = "crown"
point = [0.5, 0.3, 0.4]
body = "mid"
[output]
directory = "run"
picture = false
[history]
times = [0.5, 1]
"""
LENS = body("low", *PLATE, (0.0, 0.0, -0.3)) + LENS + body("up", *PLATE, (0.0, 0.0, 0.4))
"""A cushion, crowned by 1 mm above and below, between two plates: its lower and upper face and two of its sides are
one, "around"."""


def write_lens(path, cell="hexahedron", degree=1, cells=(4, 2, 2)):
    """lens.msh."""
    file = BoxFile((1.0, 0.6, 0.4), cells, cell)

    def crowned(x):
        bulge = 1e-3 * ((x[:, 0] - 0.5) ** 2 + (x[:, 1] - 0.3) ** 2)
        return np.column_stack([x[:, 0], x[:, 1], x[:, 2] + bulge * (1.0 - x[:, 2] / 0.2)])

    if degree == 2:
        file.second_order(crowned)
    else:
        file.points = crowned(file.points)
    around = [file.faces.pop(name) for name in ("bottom", "left", "top", "right")]
    file.faces["around"] = np.concatenate(around)
    return file.write(path / "lens.msh")
