"""Known answers: every row of the table of `python -m verification` within its tolerance."""

import pytest

from verification import CASES, COARSE


@pytest.mark.parametrize("name", CASES)
def test_rows(name):
    """The rows say what is compared, and why the tolerance is what it is."""
    verified = COARSE.get(name, CASES[name])()
    failed = [f"{row.quantity}: {row.ours:g} for {row.formula:g}, {row.why}" for row in verified.rows if not row.passed]
    assert not failed
    assert all(row.why and 0.0 <= row.tolerance <= 0.5 for row in verified.rows)
