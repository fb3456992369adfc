"""What a run says that has no valid answer: the cause before what follows from it, and nothing that does not."""

import pytest
from conftest import run_coulomb

from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.results import in_words

CASE = """
output = {picture = false}
[mesh]
box = [0.3, 0.1, 0.1]
cells = [6, 2, 2]
[material]
young = %s
poisson = 0.3
[[traction]]
face = "top"
value = [%s, 0.0, -1.0e6]
[contact]
face = "bottom"
friction = 0.3
"""
CLAMP = '[[clamp]]\nface = "left"\n'


def run(case, folder):
    (folder / "case.toml").write_text(case)
    return run_coulomb("run", folder / "case.toml", "--output", folder / "out", code=None)


def test_without_equilibrium_there_is_no_certificate_of_no_answer(tmp_path):
    """Friction holds 9 of 30 kN: the reason is the first line after the input, and no other fault is named."""
    done = run(CASE % ("2.1e11", "1.0e6"), tmp_path)
    reason = "there is no equilibrium: loads push the body along x with 30 kN; friction holds at most 9 kN"
    lines = done.stdout.splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("contact  'bottom'"))
    assert lines[at + 1 : at + 3] == [reason, "certificate FAILED: there is no answer to judge"]
    assert done.returncode == 1 and done.stderr == f"error: {reason}\n"
    assert in_words(read_run(tmp_path / "out")) == f"{reason[0].upper()}{reason[1:]}. There is no answer to judge."


@pytest.mark.parametrize("young", ["2.1e5", "2.1e11"])
def test_units_are_named_first(young, tmp_path):
    """Young's modulus in MPa: strains of 550 %, and surfaces that run through each other since."""
    done = run(CASE % (young, "0.0") + CLAMP, tmp_path)
    assert done.returncode == (1 if young == "2.1e5" else 0), done.stderr
    if done.returncode:
        first, rest = done.stderr.split(" (limit ", 1)
        assert first.startswith("error: outside the theory: displacement gradients reach 5.5")
        assert first.endswith("where young, loads and mesh are in different units") and "through each other" in rest


def test_a_given_gap_of_the_wrong_sign_is_named(tmp_path):
    done = run(CASE % ("2.1e11", "0.0") + "gap = -0.01\n" + CLAMP, tmp_path)
    assert done.returncode == 2 and "hold 3 of its nodes inside the foundation, up to 10 mm deep" in done.stderr
    assert "its gap of -10 mm is an interference, a distance is positive" in done.stderr
