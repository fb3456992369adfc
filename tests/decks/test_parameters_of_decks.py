"""Parameters that change what a card says are refused with the line, not left out without a word."""

import pytest
from conftest import run_coulomb
from test_deck_tables import CUBES, STEP, tables_of

PUSH = STEP.format("*CLOAD\ntop, 3, -1.")
TIES = "*TIE, NAME=t\nslave, master\n"


@pytest.mark.parametrize(
    ("card", "given"),
    [
        ("*CLOAD", "SECTOR=2"),
        ("*CLOAD", "LOAD CASE=2"),
        ("*CLOAD", "FOLLOWER=YES"),
        ("*BOUNDARY", "SUBMODEL, STEP=1"),
        ("*BOUNDARY", "TYPE=VELOCITY"),
        ("*ELASTIC", "DEPENDENCIES=1"),
        ("*SOLID SECTION", "COMPOSITE"),
        ("*NODE", "INPUT=nodes.inp"),
        ("*CONTACT PAIR", "TIED"),
        ("*TIE", "TIED NSET=base"),
    ],
)
def test_what_is_not_read(tmp_path, card, given):
    text = (CUBES.replace("*MATERIAL", TIES + "*MATERIAL") if card == "*TIE" else CUBES) + PUSH
    assert not tables_of(tmp_path, text).refused
    (row,) = tables_of(tmp_path, text.replace(card, f"{card}, {given}", 1)).refused
    line = text[: text.index(card)].count("\n") + 1
    assert row.keyword == card[1:] and f"deck.inp, line {line}: " in row.why


def test_gaps_of_ties_are_said(tmp_path, monkeypatch):
    """In the run by how much; what CalculiX makes of them by a note."""
    monkeypatch.chdir(tmp_path)
    text = CUBES[: CUBES.index("*CONTACT PAIR")].replace(", 0, 1\n12", ", 0, 1.01\n12") + TIES
    text = text.replace("*TIE,", "*TIE, POSITION TOLERANCE=0.005,") + PUSH
    notes = tables_of(tmp_path, text).notes
    assert any("CalculiX leaves nodes free beyond its POSITION TOLERANCE, 0.005" in note for note in notes)
    checked = run_coulomb("check-case", "deck.inp")
    assert "up to 0.01 mm apart" in checked.stdout.replace("10 um", "0.01 mm")


def test_check_case_of_supports_that_begin(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    held = STEP.format("*BOUNDARY, OP=NEW\nbase, 1, 3\ntop, 1, 2\ntop, 3, 3, -1e-4")
    (tmp_path / "deck.inp").write_text(CUBES + PUSH + held)
    run_coulomb("check-case", "deck.inp")
