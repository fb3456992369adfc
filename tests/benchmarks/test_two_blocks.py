"""Two blocks by coulomb and its peers: meshes as arrays, and forces and slips from displacements."""

import numpy as np
import pytest

from benchmarks import two_blocks
from benchmarks.peers import PROBLEMS, measure, missing, pair
from benchmarks.two_blocks import LOWER, TRACTIONS, UPPER, grid


@pytest.mark.parametrize("block", [LOWER, UPPER])
def test_meshes_are_right_handed_and_closed(block):
    made = grid(block, 2)
    corners = made.points[made.cells]
    edges = corners[:, [1, 3, 4]] - corners[:, [0]]
    assert np.linalg.det(edges).sum() == pytest.approx(np.prod(np.subtract(block.far, block.near)))
    outward = np.zeros(3)
    for name, face in made.faces.items():
        a, b, _, d = np.moveaxis(made.points[face.corners], 1, 0)
        normals = np.cross(b - a, d - a)
        outward += np.abs(normals.sum(axis=0)) if name in ("right", "back", "top") else 0.0
        assert np.ptp(made.points[face.corners], axis=(0, 1)).min() == 0.0
        assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(made.areas(name).sum())
        assert np.all(np.isin(face.corners, made.cells[face.cells]))
    x, y, z = np.subtract(block.far, block.near)
    assert outward == pytest.approx([y * z, x * z, x * y])


def test_forces_and_slip_of_a_known_displacement():
    """Uniaxial strain of the upper block over a lower one in shear: stress times area, and the difference of lines.

    The springs are compressed by strain times height: over the lowest cells of height h, times the hat function of a
    contact node, h^2 / 6 of the strain for each metre of width.
    """
    p, strain, shear = 3, 1e-4, 2e-4
    below, above = grid(LOWER, p), grid(UPPER, p)
    upper = np.outer(above.points[:, 2] - two_blocks.HEIGHT, (0.0, 0.0, -strain))
    lower = np.zeros_like(below.points)
    lower[:, 0] = shear * below.points[:, 1]  # in the contact plane only
    found = pair.answer(p, lower, upper, 1.0, 1)
    modulus = UPPER.young * (1 - UPPER.poisson) / ((1 + UPPER.poisson) * (1 - 2 * UPPER.poisson))
    area = np.prod(np.subtract(UPPER.far, UPPER.near)[:2])
    contact = np.unique(above.faces["bottom"].corners)
    expected = modulus * strain * above.areas("bottom")[contact] - above.loads(TRACTIONS)[contact, 2]
    height, width = np.diff(above.lines[2])[0], UPPER.far[1] - UPPER.near[1]
    expected -= two_blocks.SPRING * strain * height / 3.0 * above.areas("left")[contact]
    sprung = two_blocks.SPRING * strain * width * height**2 / 6.0
    assert found.forces[:, 2] == pytest.approx(expected, rel=1e-9)
    assert found.forces[:, 2].sum() == pytest.approx(modulus * strain * area - 1.2e7 * 0.45 / 4.0 - sprung, rel=1e-9)
    assert found.figures.largest_slip == pytest.approx(0.95 * shear)


def test_other_codes_agree():
    """CalculiX's mortar method has our multipliers, but its own integrals and solver.  In its penalty between faces
    and in GetFEM the law holds in other averages over facets: they differ as coarse meshes do."""
    names = ("CalculiX mortar", "CalculiX faces", "GetFEM")
    for name in names:
        if reason := missing(PROBLEMS["two-blocks"][name]):
            pytest.skip(reason)
    ours, mortar, *others = measure([3], names, problem="two-blocks")
    assert mortar.figures == pytest.approx(ours.figures, rel=1e-5)
    assert mortar.force_error < 1e-5
    for row in others:
        assert row.figures == pytest.approx(ours.figures, rel=0.03)
        assert row.force_error < 0.1
    loads = grid(UPPER, 3).loads(TRACTIONS).sum(axis=0)
    carried = ours.figures.normal_force / -loads[2], ours.figures.tangential_force / np.hypot(*loads[:2])
    assert all(0.85 < share < 0.95 for share in carried)  # the spring takes the rest


def test_siconos_agrees_with_the_same_matrices():
    if reason := missing(PROBLEMS["two-blocks"]["Siconos ADMM"]):
        pytest.skip(reason)
    ours, theirs = measure([2], ["Siconos ADMM"], problem="two-blocks")
    assert theirs.figures == pytest.approx(ours.figures, rel=1e-6) and theirs.force_error < 1e-6
