"""Gaps and overlaps of a deck before deformation: closed without strain, or kept."""

import re

import pytest
from test_deck_tables import CUBES, STEP, tables_of

from coulomb.case.case import read_case

PUSH = STEP.format("*BOUNDARY\ntop, 3, 3, -.001")


def apart(by):
    """The upper cube lifted, without lateral contraction: each is a spring of stiffness E A / h."""

    def lifted(line):
        return f"{line[1]}{float(line[2]) + by:g}"

    return re.sub(r"^(1[1-8], ., ., )(.)$", lifted, CUBES, flags=re.MULTILINE).replace("210000., .3", "210000., 0.")


@pytest.mark.parametrize(
    "gap, adjust, left",
    [
        (0.0002, ", ADJUST=0.", 0.0002),  # only overlaps are closed
        (-0.0002, ", ADJUST=0.", 0.0),
        (-0.02, ", ADJUST=.01", 0.0),  # overlaps of any size
        (0.005, ", ADJUST=1.D-2", 0.0),
        (0.0002, ", ADJUST=.0001", 0.0002),
        (-0.0002, "", -0.0002),  # an interference
    ],
)
def test_adjust_closes_gaps_up_to_its_value_and_every_overlap(gap, adjust, left, tmp_path):
    """As CalculiX 2.20 and Abaqus do; overlaps beyond ADJUST were an interference, and ADJUST=0 closed gaps, too."""
    tables_of(tmp_path, apart(gap).replace("INTERACTION=si,", f"INTERACTION=si{adjust},") + PUSH)
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.certificate.passed
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(210000.0 * (0.001 - left) / 2.0, rel=1e-6)


@pytest.mark.parametrize("of", ["slave, master", ", ALL EXTERIOR"])
def test_general_contact_closes_overlaps(of, tmp_path):
    """Abaqus moves the nodes without strain; they were pressed apart."""
    text = apart(-0.0002)
    inclusions = f"*CONTACT INCLUSIONS{of}\n" if of[0] == "," else f"*CONTACT INCLUSIONS\n{of}\n"
    text = text[: text.index("*CONTACT PAIR")] + f"*CONTACT\n{inclusions}"
    tables_of(tmp_path, text + PUSH)
    problem = read_case(tmp_path / "deck.inp").problem()
    assert [one.closed for one in problem.contacts] == [(0.0, 1.0)]
    solution = problem.solve()
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(105.0, rel=1e-6)
