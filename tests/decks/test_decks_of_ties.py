"""Pairs of decks that are tied in some steps, as of CalculiX 2.20: cubes without lateral contraction by formulas."""

import pytest
from test_deck_tables import CUBES, STEP, tables_of

from coulomb.case.case import read_case

COLUMN = CUBES.replace("210000., .3", "210000., 0.").replace(".2, 1.E6", ".2, 1.E8")
TIED = COLUMN.replace("OVERCLOSURE=LINEAR", "OVERCLOSURE=TIED")
LAW = "*CHANGE SURFACE BEHAVIOR, INTERACTION=si\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE={}\n1.E9\n"
TAKEN = "*MODEL CHANGE, TYPE=CONTACT PAIR, {}\nslave, master\n"
PULL = 0.5 * 210000.0 * 1e-3
"""Of the top, moved by 1 um."""


def top(way):
    return f"*BOUNDARY\ntop, 3, 3, {way}\n"


def forces(tmp_path, text):
    """The tables; and at the end of each step of the deck the force on the top, and those of contact."""
    tables = tables_of(tmp_path, text).tables
    case = read_case(tmp_path / "deck.inp")
    problem, ends = case.problem(), [float(k + 1) for k in range(text.count("*STEP\n"))]
    found = [step for step in case.load_history().steps(problem) if step.state.time in ends]
    assert len(found) == len(ends) and all(step.solution.valid for step in found)
    name = next(name for name in found[0].row if name.startswith("prescribed") and name.endswith("force_z"))
    return tables, [step.row[name] / PULL for step in found], [step.row["normal_force"] / PULL for step in found]


def test_tied_then_contact(tmp_path):
    text = TIED + "".join(map(STEP.format, (top(1e-3), LAW.format("LINEAR") + top(1e-3), top(-1e-3))))
    tables, on_top, contact = forces(tmp_path, text)
    assert tables["tie"] == [{"face": "slave", "against": "master", "slave": True, "end": 1.0}]
    assert tables["contact"] == [{"face": "slave", "against": "master", "slave": True, "friction": 0.2}]
    assert on_top == pytest.approx([1.0, 0.0, -1.0], rel=1e-6, abs=1e-9)
    assert contact == pytest.approx([0.0, 0.0, 1.0], rel=1e-6, abs=1e-9)


def test_contact_then_tied(tmp_path):
    """Held as it is; the run says that CalculiX pulls it shut where it is open."""
    text = COLUMN + "".join(map(STEP.format, (top(-1e-3), LAW.format("TIED") + top(-1e-3), top(1e-3))))
    tables, on_top, contact = forces(tmp_path, text)
    assert tables["tie"][0]["begin"] == 1.0 and "reaches" not in tables["tie"][0]
    assert on_top == pytest.approx([-1.0, -1.0, 1.0], rel=1e-6) and contact == pytest.approx([1.0, 0.0, 0.0], rel=1e-6)
    assert any("where it is open, CalculiX pulls it shut" in note for note in tables_of(tmp_path, text).notes)


def test_tied_pairs_that_are_taken_out_and_put_in(tmp_path):
    """Put in, they are pulled together as they were before deformation."""
    remove, add = (TAKEN.format(what) for what in ("REMOVE", "ADD"))
    text = TIED + "".join(map(STEP.format, (top(1e-3), remove + top(2e-3), add + top(2e-3), top(0.0))))
    tables, on_top, contact = forces(tmp_path, text)
    assert [(tie.get("begin"), tie.get("end"), tie.get("reaches")) for tie in tables["tie"]] == [
        (None, 1.0, None),
        (2.0, None, 3.0),
    ]
    assert on_top == pytest.approx([1.0, 0.0, 2.0, 0.0], rel=1e-4, abs=1e-9) and contact == [0.0] * 4


@pytest.mark.parametrize("tied", ["*TIE, NAME=t\nslave, master\n", "TIED"])
def test_ties_alone(tmp_path, tied):
    """A deck without a pair that may open or slide is solved, as one that is tied until its end."""
    text = COLUMN[: COLUMN.index("*CONTACT PAIR")] + tied if tied != "TIED" else TIED
    tables, on_top, _ = forces(tmp_path, text + STEP.format(top(1e-3)))
    assert tables["tie"][0]["end"] == 1.0 and on_top == pytest.approx([1.0], rel=1e-9)
    assert any("'slave' is tied until the end" in note for note in tables_of(tmp_path, text + STEP.format("")).notes)


def test_a_clearance_of_tied_faces(tmp_path):
    text = TIED + "*CLEARANCE, SLAVE=slave, MASTER=master, VALUE=.001\n"
    with pytest.raises(ValueError, match=r"line 46: \*CLEARANCE: a pair that is TIED has no clearance"):
        tables_of(tmp_path, text + STEP.format(""))
