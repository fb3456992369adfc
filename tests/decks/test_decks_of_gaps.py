"""Gaps and overlaps of a deck before deformation, closed without strain or kept; laws of contact."""

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


def test_rough_faces_do_not_slip(tmp_path):
    """The upper cube is pushed by ten times its weight on the faces, at the foot, where nothing tilts it."""
    text = CUBES.replace("top, 1, 2\n", "top, 2\n").replace("*FRICTION\n.2, 1.E6", "*FRICTION, ROUGH")
    load = STEP.format("*DLOAD\n2, P2, 1.\n*CLOAD\n11, 1, 2.5\n12, 1, 2.5\n13, 1, 2.5\n14, 1, 2.5")
    found = tables_of(tmp_path, text + load)
    assert not found.refused and not any("stick slope" in note for note in found.notes)
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.certificate.passed
    assert solution.at_nodes.totals()["force"] == pytest.approx([-10.0, 0.0, 1.0], rel=1e-6, abs=1e-5)


TABLE = CUBES.replace("PRESSURE-OVERCLOSURE=LINEAR\n1.E7", "PRESSURE-OVERCLOSURE=TABULAR\n{}")


@pytest.mark.parametrize(
    "rows, said",
    [
        ("0., 0.\n50., .01\n1.E9, .02", "a table whose least slope is 5e.03 is a layer"),
        ("0., -.1\n1.E7, 1.", "does not begin with no pressure at no overclosure is a layer"),
        ("0., 0.", "needs lines of pressure and overclosure, both ascending"),
        ("0., 0.\n1.E7, 0.", "needs lines of pressure and overclosure, both ascending"),
        ("0.\n1.E7", "needs 2 numbers, not 1"),
    ],
)
def test_a_table_of_pressures_is_a_penalty_or_a_layer(rows, said, tmp_path):
    """A stiff one is hard contact, like a stiff line."""
    load = STEP.format("*DLOAD\n2, P2, 1.")
    hard = tables_of(tmp_path, TABLE.format("0., 0.\n1.E7, 1.\n3.E7, 2.") + load).tables
    assert hard == tables_of(tmp_path, CUBES + load).tables
    with pytest.raises(ValueError, match=rf"line \d+: \*SURFACE BEHAVIOR: .*{said}"):
        tables_of(tmp_path, TABLE.format(rows) + load)
