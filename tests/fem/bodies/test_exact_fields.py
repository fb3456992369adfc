"""Zeros and integers are exact in the files, and every value is at its own point."""

import numpy as np
import pytest
from check_runs import fields, order
from conftest import make_block, without_pictures

import coulomb
from coulomb.io.grid_file import GridFields, write_grids
from coulomb.io.result_grids import body_grid
from coulomb.model.nodal_answer import HELD, OPEN, OPEN_BELOW
from coulomb.model.stopping_criterion import zero_open_forces


@pytest.mark.parametrize(("cell", "law"), [("hexahedron", "tresca"), ("tetrahedron", "coulomb")])
def test_written_fields_equal_the_answer_exactly_and_are_zero_where_it_is_open(cell, law, tmp_path):
    solution = make_block(3, cell=cell, slip_stress=1e7 if law == "tresca" else None).solve()
    with without_pictures():
        solution.write(tmp_path)
    assert solution.certificate.passed
    elasticity, surface = solution.problem.elasticity, solution.problem.surface
    body, at = fields(tmp_path / "solution.h5"), fields(tmp_path / "contact.h5")
    node = order(body["x"], elasticity.x)
    assert np.array_equal(body["displacement"][node], solution.displacement)
    assert np.array_equal(body["load"][node], solution.problem.loading.load)
    assert np.array_equal(body["held"][node], elasticity.held.components.astype(float))
    node = order(at["x"], surface.x)
    assert np.array_equal(at["pressure"][node], solution.contact_force[0::3] / surface.area)
    assert np.array_equal(at["area"][node], surface.area)
    assert np.array_equal(at["contact_force"][node], -surface.vectors(solution.contact_force.reshape(-1, 3)))
    assert {0.0, 2.0, 3.0} <= set(np.unique(at["status"])) <= {0.0, 1.0, 2.0, 3.0}
    open_ = at["status"] == OPEN
    assert np.array_equal(at["pressure"] == 0.0, open_ | (at["status"] == HELD))
    friction = np.linalg.norm(at["friction_traction"], axis=1)[open_]
    if law == "coulomb":
        assert not friction.any() and not at["contact_force"][open_].any() and not at["friction_use"][open_].any()
    else:  # slip stress acts without pressure
        assert np.all(friction > 1e6)
        assert not np.sum((at["contact_force"] * at["normal"])[open_], axis=1).any()
    for name, values in at.items():
        if name not in ("x", "status", "node"):
            assert not values[at["status"] == HELD].any(), name


@pytest.mark.parametrize("solver", [coulomb.InteriorPoint(), coulomb.SuccessiveTresca()])
def test_the_certificate_is_of_the_written_forces(solver):
    """The certificate is of the forces with exact zeros, which equal the solver's within its residual."""
    problem = make_block(4)
    solution = problem.solve(solver=solver)
    x, raw = solution.contact_force, solution.result.x
    assert coulomb.certify(problem, x, solution.displacement).checks == solution.certificate.checks
    assert np.linalg.norm(x - raw) <= 1e-8 * np.linalg.norm(raw)
    none = x[0::3] == 0.0
    assert none.any() and np.all(x[0::3][~none] > OPEN_BELOW * x.max())
    fresh = problem.displacement(x)
    assert np.abs(fresh - solution.displacement).max() <= 1e-12 * np.abs(fresh).max()


def test_only_small_forces_are_set_to_zero():
    """Wrong answers are not corrected: forces across a gap, tension, friction without pressure."""
    problem = make_block(4)
    solution = problem.solve()
    u, force = solution.displacement, solution.contact_force.reshape(-1, 3)
    gap = problem.surface.gap - problem.relative_displacement(u)[:, 0]
    far = int(np.argmax(gap))
    size = np.linalg.norm(force)
    assert not force[far].any()
    for large, small in (([2e-6, 0, 0], [9e-7, 0, 0]), ([-2e-6, 0, 0], [-9e-7, 0, 0]), ([0, 2e-6, 0], [0, 9e-7, 0])):
        for values, stays in ((large, True), (small, False)):
            spoilt = force.copy()
            spoilt[far] = np.array(values) * size
            kept = zero_open_forces(problem, spoilt.ravel(), problem.relative_displacement(u)).reshape(-1, 3)[far]
            assert np.array_equal(kept, spoilt[far] if stays else np.zeros(3))
    pressing = int(np.argmin(np.where(gap < 1e-3 * gap.max(), np.abs(gap), np.inf)))
    spoilt = force.copy()
    for part, stays in ((2.0 * OPEN_BELOW, True), (0.5 * OPEN_BELOW, False)):  # without a gap the sign decides
        spoilt[pressing] = [part * force.max(), 0.0, 0.0]
        assert zero_open_forces(problem, spoilt.ravel(), problem.relative_displacement(u)).reshape(-1, 3)[
            pressing, 0
        ] == (spoilt[pressing, 0] if stays else 0)


def test_a_file_that_cannot_be_written_is_a_clear_error(tmp_path):
    problem = make_block(3)
    with pytest.raises(OSError, match=r"a\.h5: No such file or directory"):
        grid = GridFields(body_grid(problem.elasticity), {}, {})
        write_grids(problem.comm, tmp_path / "none" / "a.xdmf", [grid], 0.0)
