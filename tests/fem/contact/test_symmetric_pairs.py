"""Planes of symmetry through a pair: half of both bodies has the answer of the whole ones."""

import numpy as np
import pytest

from coulomb import Clamp, Contact, ContactProblem, Material, PrescribedDisplacement, SymmetryPlane, box, join

SOFT, STIFF = Material(1e9, 0.3), Material(3e9, 0.2)


def body(cells, whole, upper):
    """A block above or below z = 0 whose contact face is curved, across the plane x = 0 or on one side of it."""
    along, across, deep = cells

    def place(k):
        x = (k[0] - (along if whole else 0.0)) / along
        y, depth = k[1] / across, (k[2] if upper else deep - k[2]) / deep
        rise = 0.03 * x**2 + 0.03 * (y - 0.4) ** 2
        return np.stack([x, y, (depth + rise * (1.0 - depth)) * (1.0 if upper else -1.0)])

    size = ((2 if whole else 1) * along, across, deep)
    return box(size, size, place=place)


def solved(whole, smooth):
    """The bodies pressed together by 6 cm, and the upper one moved along the plane of symmetry; gaps between the facets
    or between smooth faces."""
    planes = () if whole else (SymmetryPlane("upper:left"), SymmetryPlane("lower:left"))
    problem = ContactProblem(
        join(upper=body((3, 3, 1), whole, True), lower=body((2, 2, 1), whole, False)),
        {"upper": SOFT, "lower": STIFF},
        [Clamp("lower:bottom"), PrescribedDisplacement("upper:top", (0.0, 4e-3, -0.06)), *planes],
        Contact("upper:bottom", against="lower:top", friction=0.3, smooth=smooth),
        small_strain="warn",
    )
    solution = problem.solve(1e-10)
    surface = solution.problem.surface
    right = surface.x[:, 0] > -1e-9
    x = surface.x[right]
    force = surface.vectors(solution.contact_force.reshape(-1, 3))[right]
    order = np.lexsort(np.round(x, 9).T)
    return x[order], force[order], solution.contact_force.reshape(-1, 3)[right][order]


@pytest.mark.parametrize("smooth", [False, True])
def test_half_is_half_of_the_whole(smooth):
    (x, whole, rows), (there, half, _) = solved(True, smooth), solved(False, smooth)
    assert there == pytest.approx(x, abs=1e-12)
    on_plane = np.abs(x[:, 0]) < 1e-9
    assert np.count_nonzero(on_plane) == 4 and np.count_nonzero(rows[:, 0] > 0.0) > 5
    expected = np.where(on_plane[:, None], 0.5, 1.0) * whole
    expected[on_plane, 0] = 0.0  # of the whole by symmetry, of the half by the plane
    assert np.abs(whole[on_plane, 0]).max() < 1e-7 * np.abs(whole).max()
    assert half == pytest.approx(expected, abs=1e-7 * np.abs(whole).max())
