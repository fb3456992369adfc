"""An O-ring, large motions: a slice beside a quarter in 3D."""

import math

from benchmarks.slices import measure


def test_forces_of_a_slice_are_those_of_a_quarter():
    """A quarter of n layers has chords: sin(t)/t of the volume, of which t = pi/(2 n) is the angle of a layer."""
    one, quarter = measure([4], [0.5])
    t = math.pi / 8.0
    assert math.sin(t) / t < quarter.force / one.force < 1.0
    assert quarter.unknowns > 2 * one.unknowns and quarter.cells == 4 * one.cells
