"""General contact of Abaqus between named surfaces."""

import pytest
from mpi4py import MPI
from test_deck_tables import CUBES, STEP, tables_of

from coulomb.case.case import read_case

LAWS = "*SURFACE INTERACTION, NAME=si\n*FRICTION\n.2,\n*SURFACE INTERACTION, NAME=sj\n*FRICTION\n.1,\n*CONTACT\n"
GENERAL = CUBES[: CUBES.index("*CONTACT PAIR")] + LAWS
ASSIGNED = "*CONTACT PROPERTY ASSIGNMENT\n , , si\n"
LOAD = STEP.format("*DLOAD\n2, P2, 10.")


def test_general_contact_of_named_surfaces(tmp_path):
    """Pairs as those of *CONTACT PAIR, with the property of the two surfaces, or of all."""
    named = GENERAL + "*CONTACT INCLUSIONS\nslave, master\n" + ASSIGNED
    pair = {"face": "slave", "against": "master", "adjust": [0.0, 1.0]}
    assert tables_of(tmp_path, named + LOAD).tables["contact"] == [pair | {"friction": 0.2}]
    assert tables_of(tmp_path, named + "master, slave, sj\n" + LOAD).tables["contact"] == [pair | {"friction": 0.1}]
    for wrong, said in (
        (named.replace("slave, master\n*CONTACT", ", master\n*CONTACT"), "needs two surfaces, or one"),
        (named.replace("NS\nslave", "NS\nslaves"), r"no \*SURFACE 'slaves'; did you mean 'slave'"),
        (GENERAL + "*CONTACT INCLUSIONS, ALL EXTERIOR\n" + ASSIGNED + "slave, master, sj\n", "INCLUSIONS names them"),
        (GENERAL + "*CONTACT INCLUSIONS, ALL EXTERIOR\n" + ASSIGNED.replace("si", "sk"), "INTERACTION 'SK'"),
    ):
        with pytest.raises(ValueError, match=said):
            tables_of(tmp_path, wrong + LOAD)


SKIN = CUBES.replace("*MATERIAL", "*SURFACE, NAME=skin\n1, S2\n2, S1\n*MATERIAL")


@pytest.mark.parametrize("given", ["skin", "skin,", "skin, Skin"])
def test_a_surface_in_contact_with_itself(tmp_path, given):
    """Also of both cubes: its sides are the pair of the two surfaces."""
    pair, itself = {"friction": 0.2}, {"face": "skin", "against": "skin"}
    deck = SKIN.replace("slave, master", given)
    found = tables_of(tmp_path, deck + LOAD)
    assert found.tables["contact"] == [itself | pair] and "solver" not in found.tables
    assert sum("skin in contact with itself" in note for note in found.notes) == 1
    inclusions = GENERAL.replace("*MATERIAL", "*SURFACE, NAME=skin\n1, S2\n2, S1\n*MATERIAL")
    inclusions += f"*CONTACT INCLUSIONS\n{given}\n{ASSIGNED}skin, , sj\n"
    closed = {"friction": 0.1, "adjust": [0.0, 1.0]}
    assert tables_of(tmp_path, inclusions + LOAD).tables["contact"] == [itself | closed]
    folding = tables_of(tmp_path, deck + LOAD.replace("*STEP", "*STEP, NLGEOM"))
    assert folding.tables["solver"] == {"kinematics": "large"} and "large motions" in folding.notes[-1]
    tied = deck.replace("PRESSURE-OVERCLOSURE=LINEAR\n1.E7", "PRESSURE-OVERCLOSURE=TIED\n1.E7")
    with pytest.raises(ValueError, match="itself is neither TIED nor has a"):
        tables_of(tmp_path, tied + LOAD)
    answers = []
    for text in (deck, CUBES):
        (tmp_path / "deck.inp").write_text(text + LOAD)
        answers.append(read_case(tmp_path / "deck.inp").problem(MPI.COMM_SELF).solve())
    totals = answers[0].at_nodes.totals()
    assert answers[0].valid and totals["normal_force"] == pytest.approx(10.0, rel=1e-6)
    assert answers[0].displacement == pytest.approx(answers[1].displacement, abs=1e-9 * 10.0 / 210000.0)
