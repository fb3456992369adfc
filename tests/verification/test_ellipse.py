"""The formulas of elliptic contact: their pressure on a half space closes the gap of the two bodies."""

import numpy as np
import pytest

from verification.hertz import Hertz
from verification.hertz_pairs import CYLINDERS, SPHERES, A, Ellipse


def sunk(ellipse, x, y):
    """Sum of the normal displacements of both half spaces at a point inside: by Boussinesq, in polar coordinates
    around the point, where the singularity cancels."""
    phi = (np.arange(200) + 0.5) / 200 * 2.0 * np.pi
    s = (np.arange(100) + 0.5) / 100 * np.pi
    c, d = np.cos(phi), np.sin(phi)
    one = (c / ellipse.half_x) ** 2 + (d / ellipse.half_y) ** 2
    two = x * c / ellipse.half_x**2 + y * d / ellipse.half_y**2
    far = (np.sqrt(two**2 + one * (1.0 - (x / ellipse.half_x) ** 2 - (y / ellipse.half_y) ** 2)) - two) / one
    t, weight = np.outer(far, 0.5 - 0.5 * np.cos(s)), np.outer(far, 0.5 * np.sin(s) * np.pi / 100)
    pressure = ellipse.pressure(x + t * c[:, None], y + t * d[:, None])
    return np.sum(pressure * weight) * 2.0 * np.pi / 200 / (np.pi * ellipse.pair.E_star)


@pytest.mark.parametrize("pair", [SPHERES, CYLINDERS], ids=lambda pair: pair.name)
def test_the_pressure_closes_the_gap(pair):
    ellipse, (Rx, Ry) = Ellipse(pair, A), pair.radii
    for x, y in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.3, -0.6)):
        place = (x * ellipse.half_x, y * ellipse.half_y)
        gap = place[0] ** 2 / (2.0 * Rx) + place[1] ** 2 / (2.0 * Ry)
        assert sunk(ellipse, *place) == pytest.approx(ellipse.approach - gap, rel=1e-4)


def test_a_circle_is_hertz():
    ellipse = Ellipse(SPHERES, A)
    circle = Hertz(ellipse.P, SPHERES.radii[0], *SPHERES.materials)
    assert [circle.a, circle.p0, circle.approach] == pytest.approx([A, ellipse.p0, ellipse.approach])
