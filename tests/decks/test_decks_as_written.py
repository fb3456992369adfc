"""Decks as users write them: nearly right names, damaged lines, slave nodes without facets, laws that change."""

from pathlib import Path

import numpy as np
import pytest
from conftest import run_coulomb
from test_deck_tables import CUBES, STEP, steps, tables_of

from coulomb import LoadHistory
from coulomb.case.case import read_case
from coulomb.decks.geometry import Geometry
from coulomb.decks.node_surfaces import facets_with_nodes

NEARLY = {
    "base, 1, 3": ("bases, 1, 3", r"line \d+: \*BOUNDARY: there is no node set 'bases'; did you mean 'base'\?"),
    "ELSET=cubes, MATERIAL": ("ELSET=cube, MATERIAL", r"no element set 'cube'; did you mean 'cubes'\?"),
    "MATERIAL=steel\n*BOUND": ("MATERIAL=stel\n*BOUND", r"no \*MATERIAL 'stel'; did you mean 'STEEL'\?"),
    "slave, master": (
        "slave, mastr",
        r"line \d+: \*CONTACT PAIR: there is no \*SURFACE 'mastr'; did you mean 'master'",
    ),
    "INTERACTION=si,": ("INTERACTION=law,", r"there is no \*SURFACE INTERACTION 'law'; there are 'SI'"),
    "1, 1, 2, 3, 4, 5, 6, 7, 8": ("1, 1, 2, 3, 4, 5, 6, 7", r"deck.inp: line 20: \*ELEMENT: damaged: elements of type"),
    "12, 1, 0, 1": ("12, 1, 0, 1o", r"deck.inp: line 12: \*NODE: damaged: '1o' is no number"),
}


@pytest.mark.parametrize("right", NEARLY)
def test_a_wrong_name_or_line_is_said_with_its_place(right, tmp_path):
    wrong, said = NEARLY[right]
    assert right in CUBES
    with pytest.raises(ValueError, match=said):
        tables_of(tmp_path, CUBES.replace(right, wrong) + STEP.format("*CLOAD\ntop, 3, -1."))


def test_one_text_in_many_ways(tmp_path):
    """Lower case, tabs, Windows' line ends, Fortran's exponents, comments inside data, an included file."""
    text = CUBES + STEP.format("*DLOAD\n2, P2, 1.D1")
    nodes = text[: text.index("*ELEMENT")]
    (tmp_path / "nodes.txt").write_text(nodes.replace("\n", "\r\n"), newline="")
    ways = [
        text,
        text.lower().replace("\n", "\r\n"),
        text.replace(", ", ",\t").replace("\n1, 1, 2", "\n** a comment, 1\n\n1, 1, 2"),
        text.replace("INTERACTION=si, ", "INTERACTION=si,\n "),
        "*INCLUDE, INPUT=nodes.txt\n" + text[text.index("*ELEMENT") :],
    ]
    found = [tables_of(tmp_path, way) for way in ways]
    assert not any(one.refused for one in found)
    plain = [str({**one.tables, "output": 0}).lower() for one in found]
    assert len(set(plain)) == 1
    (tmp_path / "nodes.txt").write_text(nodes.replace("7, 1, 1, 1", "7, 1, 1, one"))
    with pytest.raises(ValueError, match=r"nodes.txt: line 9: \*NODE: damaged: 'one' is no number"):
        tables_of(tmp_path, ways[-1])


def test_a_slave_node_without_facets(tmp_path, monkeypatch):
    """The slave are the facets with it that face the master, and no sides; the deck says so, and presses as a whole."""
    text = CUBES.replace("*SURFACE, NAME=slave\n2, S1", "*NSET, NSET=one\n12\n*SURFACE, NAME=slave, TYPE=NODE\none")
    found = tables_of(tmp_path, text + STEP.format("*DLOAD\n2, P2, 10."))
    assert found.tables["contact"][0]["face"] == "slave"
    assert any(
        "slave: its 1 slave node makes no facets: the slave are the 1 with one of them" in n for n in found.notes
    )
    deck = Geometry(str(tmp_path / "deck.inp"))
    facets = facets_with_nodes(deck, "SLAVE")
    assert [sorted(deck.tags[one]) for one in facets] == [[11, 12, 13, 14]]
    monkeypatch.chdir(tmp_path)
    run_coulomb("run", "deck.inp", "--quiet", "--set", "output.picture=false")
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(10.0)


def test_slave_nodes_with_facets_are_these(tmp_path):
    text = CUBES.replace("*SURFACE, NAME=slave\n2, S1", "*SURFACE, NAME=slave, TYPE=NODE\n11\n12\n13\n14")
    tables_of(tmp_path, text + STEP.format("*DLOAD\n2, P2, 10."))
    assert facets_with_nodes(Geometry(str(tmp_path / "deck.inp")), "slave") is None


def test_a_law_that_changes(tmp_path):
    """From hard to hard with another penalty nothing changes; from hard to next to nothing it is out."""
    change = "*CHANGE SURFACE BEHAVIOR, INTERACTION=si\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE={}\n{}\n"
    hard = tables_of(tmp_path, steps("*DLOAD\n2, P2, 10.", change.format("LINEAR", "1.E9")))
    assert hard.tables["contact"] == [{"face": "slave", "against": "master", "friction": 0.2}]
    out = tables_of(tmp_path, steps("*DLOAD\n2, P2, 10.", change.format("LINEAR", "1.E-20")))
    (pair,) = out.tables["contact"]
    assert pair["gap_amplitude"][0] == [0.0, 0.0] and pair["gap_amplitude"][-1][1] == 1.0


def test_a_pair_that_is_put_in_has_a_step_of_its_own(tmp_path):
    """The forces of the rest do no work over the gap that stands for a pair that is out."""
    text = CUBES + "*CLEARANCE, SLAVE=slave, MASTER=master, VALUE=-.001\n"
    change = "*MODEL CHANGE, TYPE=CONTACT PAIR, {}\nslave, master"
    found = tables_of(tmp_path, text + STEP.format(change.format("REMOVE")) + STEP.format(change.format("ADD")))
    assert found.tables["history"]["times"] == pytest.approx([1.0, 1.000001, 2.0], rel=1e-9)


def test_a_pair_that_is_taken_out_under_load_gives_its_energy_back(tmp_path):
    """Pressed and pushed to the side, taken out and put in: forces of contact work along the way of the bodies, not
    over the gap that stands for a pair that is out."""
    change = "*MODEL CHANGE, TYPE=CONTACT PAIR, {}\nslave, master"
    press = steps("*BOUNDARY\ntop, 3, 3, -.001\ntop, 1, 1, .0001", change.format("REMOVE"), change.format("ADD"))
    (tmp_path / "deck.inp").write_text(press)
    case = read_case(tmp_path / "deck.inp")
    ends = [(step.state.time, step.state.energy) for step in LoadHistory(case.history.ends).steps(case.problem())]
    elastic = [energy.elastic for _, energy in ends]
    assert elastic[0] > 0.0 and elastic[1] < 1e-9 * elastic[0]
    for _, energy in ends:  # all but what friction takes as the pair is put in
        assert abs(energy.imbalance) <= 1e-6 * elastic[0]
    assert ends[1][1].foundation == pytest.approx(-elastic[0], rel=1e-4)


def test_supports_of_later_steps(tmp_path, monkeypatch):
    """Pressed; the top is let go and the edge of the foot pushed from where it is to 0.1, and back: friction is F N."""
    monkeypatch.chdir(tmp_path)
    text = CUBES + "*NSET, NSET=foot, GENERATE\n11, 14\n"
    text += STEP.format("*DLOAD\n2, P2, 10.")
    text += STEP.format("*BOUNDARY, OP=NEW\nbase, 1, 3\nfoot, 2, 2, .01\nfoot, 1, 1, 0.")
    text += STEP.format("*BOUNDARY, OP=NEW\nbase, 1, 3\nfoot, 2, 2, -.01\nfoot, 1, 1, 0.")
    Path("deck.inp").write_text(text)
    found = tables_of(tmp_path, text)
    (moved,) = found.tables["prescribed_displacement"]
    assert (moved["begin"], moved["reaches"]) == (1.0, 2.0) and "end" not in moved
    assert moved["amplitude"] == [[1.0, 1.0], [2.0, 1.0], [3.0, -1.0]]
    case = read_case("deck.inp")
    steps_taken = list(case.load_history().steps(case.problem()))
    forces = [step.solution.at_nodes.totals()["force"] for step in steps_taken]
    assert all(step.solution.certificate.passed for step in steps_taken)
    assert np.array(forces)[:, 1] == pytest.approx([0.0, -2.0, 2.0], rel=1e-5, abs=1e-6)


ENDS = {
    "*EQUATION\n0\n": r"\*EQUATION: needs at least one term",
    "*TRANSFORM, NSET=top, TYPE=R\n1., 1.\n": r"\*TRANSFORM: needs 6 numbers, not 2",
    "*TRANSFORM, NSET=top, TYPE=R\n": r"\*TRANSFORM: has 0 data lines, and needs another",
    "*AMPLITUDE, NAME=a, SHIFTX=x\n0., 0., 1., 1.\n": r"\*AMPLITUDE: SHIFTX=x is no number",
    "*AMPLITUDE, NAME=a\n0., 0., 1., 1e400\n": r"\*AMPLITUDE: damaged: '1e400' is no number",
    "*AMPLITUDE, NAME=a\n": r"\*AMPLITUDE: needs pairs of time and factor",
    "*CLEARANCE, SLAVE=slave, MASTER=master, VALUE=none\n": r"\*CLEARANCE: VALUE=none is no number",
    "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nall\n": r"\*INITIAL CONDITIONS: needs nodes and a temperature",
    "*CYCLIC SYMMETRY MODEL, N=x\n0, 0, 0, 0, 0, 1\n*TIE, CYCLIC SYMMETRY, NAME=t\nslave, master\n": "N=x is no number",
    "*SURFACE, NAME=other\nnone, S1\n": r"\*SURFACE: the element set 'none' is not defined",
    "*CLOAD\ntop, 3, -1.\n": r"\*CLOAD: stands outside of the steps",
    "*STEP\n*STATIC\n*TIE, NAME=t\nslave, master\n*END STEP\n": r"\*TIE: stands inside of a step",
    "*NSET, NSET=more\n77\n": r"\*NSET: node 77 is not defined",
}


@pytest.mark.parametrize("cards", ENDS)
def test_a_card_with_too_little_is_said_with_its_line(cards, tmp_path):
    text = CUBES + cards + STEP.format("*CLOAD, AMPLITUDE=a\ntop, 3, -1." if "=a" in cards else "*TEMPERATURE\nall, 1.")
    if "INITIAL" not in cards:
        text = text.replace("*TEMPERATURE\nall, 1.", "*CLOAD\nmore, 3, -1." if "more" in cards else "*DLOAD\n2, P2, 1.")
    with pytest.raises(ValueError, match=rf"deck.inp: line \d+: .*{ENDS[cards]}"):
        tables_of(tmp_path, text)
        read_case(tmp_path / "deck.inp").problem()


def test_a_part_with_two_instances(tmp_path):
    """The second one turned, with a point of the assembly; sections of the part are of both; all in lower case."""
    nodes, cells = (
        CUBES[CUBES.index("*NODE") : CUBES.index("11, 0")],
        "*ELEMENT, TYPE=C3D8, ELSET=e\n1,1,2,3,4,5,6,7,8\n",
    )
    part = f"*PART, NAME=p\n{nodes}{cells}*SURFACE, NAME=up\ne, S2\n*SURFACE, NAME=down\ne, S1\n"
    part += "*SOLID SECTION, ELSET=e, MATERIAL=steel\n,\n*END PART\n"
    put = "*ASSEMBLY, NAME=a\n*INSTANCE, NAME=one, PART=p\n*END INSTANCE\n*INSTANCE, NAME=two, PART=p\n0., 1., 1.\n"
    put += "0., 1., 0., 0., 1., 1., -90.\n*END INSTANCE\n*NODE\n1, 0., 0., 5.\n"
    put += "*NSET, NSET=fix, INSTANCE=one, GENERATE\n1, 4\n"
    put += "*NSET, NSET=lid, INSTANCE=two\n5, 6, 7, 8\n*SURFACE, NAME=top, TYPE=NODE\nlid, 1.\n"
    put += "*COUPLING, CONSTRAINT NAME=c, REF NODE=1, SURFACE=top\n*KINEMATIC\n*END ASSEMBLY\n"
    law = "*MATERIAL, NAME=steel\n*ELASTIC\n1000., .3\n*SURFACE INTERACTION, NAME=si\n1.,\n"
    law += "*FRICTION, SLIP TOLERANCE=.005\n.3\n"
    law += "*CONTACT PAIR, INTERACTION=si\ntwo.down, one.up\n*BOUNDARY\nfix, ENCASTRE\n1, 1, 2\n1, 4, 6\n"
    found = tables_of(tmp_path, (part + put + law + STEP.format("*CLOAD\n1, 3, -2.")).lower())
    assert not found.refused and not any("stick slope" in note for note in found.notes)
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.certificate.passed and solution.at_nodes.totals()["normal_force"] == pytest.approx(2.0)


def test_contact_of_rubber_and_elastic_slip_are_said(tmp_path):
    """Stiffness is soft or hard beside that of the material, hyperelastic too; where CalculiX slips elastically."""
    rubber = CUBES.replace("*ELASTIC\n210000., .3", "*HYPERELASTIC, NEO HOOKE\n.5, .02")
    assert len(tables_of(tmp_path, rubber + STEP.format("")).tables["contact"]) == 1
    (said,) = [
        note for note in tables_of(tmp_path, CUBES.replace(".2, 1.E6", ".2") + STEP.format("")).notes if "slope" in note
    ]
    assert "a stick slope of 1.05e+05, as where none is given" in said
    assert not [note for note in tables_of(tmp_path, CUBES + STEP.format("")).notes if "slope" in note]


def test_frames_of_a_part_turn_with_its_instances(tmp_path):
    """Each instance has its own directions of the material and of nodes; the axis of a cylinder moves with it, too."""
    mesh = CUBES[: CUBES.index("2, 11, 12")].replace("ELSET=cubes", "ELSET=cube")
    part = (
        f"*PART, NAME=P\n{mesh}*NSET, NSET=foot\n1, 2, 3, 4\n*ORIENTATION, NAME=grain\n1., 0., 0., 1., 2., 0.\n"
        "*ORIENTATION, NAME=round, SYSTEM=CYLINDRICAL\n1., 0., 0., 1., 0., 5.\n"
        "*TRANSFORM, NSET=foot\n1., 0., 0., 0., 1., 0.\n"
        "*SOLID SECTION, ELSET=cube, MATERIAL=wood, ORIENTATION=grain\n*END PART\n"
    )
    instances = (
        "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=low, PART=P\n*END INSTANCE\n"
        "*INSTANCE, NAME=up, PART=P\n2., 0., 1.\n0., 0., 0., 0., 0., 1., 90.\n*END INSTANCE\n*END ASSEMBLY\n"
    )
    law = "*MATERIAL, NAME=wood\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n12., 3., 2., .1, .1, .1, 1., 1.\n1.\n"
    text = f"{part}{instances}{law}*BOUNDARY\nlow.foot, 1, 3\nup.foot, 1\n" + STEP.format("*CLOAD\nup.5, 3, -1.")
    tables = tables_of(tmp_path, text).tables
    low, up = (one["directions"] for one in tables["material"])
    assert low == [[1.0, 0.0, 0.0], [1.0, 2.0, 0.0]]
    assert np.allclose(up, [[0.0, 1.0, 0.0], [-2.0, 1.0, 0.0]], atol=1e-15)
    held = next(one["direction"] for one in tables["clamp"] if "direction" in one)
    assert np.allclose(held, [0.0, 1.0, 0.0], atol=1e-15)
    axes = [card.vector(0, 6) for card in Geometry(str(tmp_path / "deck.inp")).others if "SYSTEM" in card.parameters]
    assert np.allclose(axes, [[1, 0, 0, 1, 0, 5], [0, 3, 1, 0, 3, 6]], atol=1e-14)


def test_parameters_that_there_are_not(tmp_path):
    """They were left out without a word, with the amplitude that one meant: one like a parameter is refused, and the
    table of the cards names others."""
    load = STEP.format("*CLOAD\ntop, 3, -1.\n*CLOAD, {}=a\ntop, 3, -1.")
    curve = CUBES + "*AMPLITUDE, NAME=a\n0., 0., 1., 2.\n"
    (refused,) = tables_of(tmp_path, curve + load.format("AMPLITDE")).refused
    assert refused.why.endswith("there is no parameter AMPLITDE; did you mean AMPLITUDE?")
    (row,) = (one for one in tables_of(tmp_path, curve + load.format("AMP")).cards if one.keyword == "CLOAD")
    line = 1 + curve.count("\n") + load.partition("{}")[0].count("\n")
    assert (row.fate, row.count, row.why) == ("used", 2, f"deck.inp, line {line}: not read: AMP")
