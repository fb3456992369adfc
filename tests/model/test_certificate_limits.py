"""Each condition of the certificate just inside its limit and just outside, by synthetic evidence with one error.

Expected values follow from the formulas of docs/certificate.md; the scales are known by construction.
"""

from dataclasses import replace

import pytest
from synthetic_evidence import CASES, SLIP, failed, synthetic_evidence, turned_short_slip, turned_small_friction

from coulomb.model.certificate import ANGLE_LIMIT, LIMIT, judge


@pytest.mark.parametrize("sway", [1e-3, 1.0, 30.0])
@pytest.mark.parametrize("clamped", ["xyz", "yz", "z"])
def test_exact_evidence_has_measures_of_zero(clamped, sway):
    evidence, _ = synthetic_evidence(clamped, sway=sway)
    for check in judge(evidence).checks:
        assert check.value <= 1e-3 * check.limit, check


@pytest.mark.parametrize(("name", "error", "options"), CASES)
def test_just_inside_and_just_outside(name, error, options):
    limit = 0.1 if name == "slip angle" else 1e-6
    evidence, turnover = synthetic_evidence(**options)
    for value, fails in ((0.95 * limit, set()), (1.05 * limit, {name})):
        certificate = judge(error(evidence, value, turnover))
        assert certificate[name].value == pytest.approx(value, rel=1e-3)
        assert failed(certificate) == fails


def test_every_condition_has_a_case():
    named = {name for name, _, _ in CASES}
    assert {check.name for check in judge(synthetic_evidence()[0]).checks} == named | {"finite"}
    assert (LIMIT, ANGLE_LIMIT) == (1e-6, 0.1)


@pytest.mark.parametrize("error", [turned_short_slip, turned_small_friction])
def test_no_angle_for_small_slip_or_friction(error):
    """Slip under 1e-3 of the scale or friction under 1e-2 of the largest: its direction is that of the errors."""
    evidence, turnover = synthetic_evidence()
    turned = error(evidence, 1.0, turnover)
    assert judge(turned)["slip angle"].value == pytest.approx(1.0)
    closure, force, bound = turned.closure.copy(), turned.force.copy(), turned.bound.copy()
    if error is turned_short_slip:
        closure[SLIP, 1:] *= 0.98
    else:
        force[SLIP, 1:] *= 0.98
        bound[SLIP] *= 0.98
    assert judge(replace(turned, closure=closure, force=force, bound=bound))["slip angle"].value <= 1e-6


def test_no_angle_for_rounding_errors_without_friction():
    evidence, _ = synthetic_evidence()
    force = evidence.force.copy()
    force[:, 1:] *= -1e-16
    without = judge(replace(evidence, force=force, bound=0.0 * evidence.bound))
    assert without.passed, without
