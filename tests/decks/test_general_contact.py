"""General contact of Abaqus between named surfaces."""

import pytest
from test_deck_tables import CUBES, STEP, tables_of

LAWS = "*SURFACE INTERACTION, NAME=si\n*FRICTION\n.2,\n*SURFACE INTERACTION, NAME=sj\n*FRICTION\n.1,\n*CONTACT\n"
GENERAL = CUBES[: CUBES.index("*CONTACT PAIR")] + LAWS
ASSIGNED = "*CONTACT PROPERTY ASSIGNMENT\n , , si\n"
LOAD = STEP.format("*DLOAD\n2, P2, 10.")


def test_general_contact_of_named_surfaces(tmp_path):
    """Pairs as those of *CONTACT PAIR, with the property of the two surfaces, or of all."""
    named = GENERAL + "*CONTACT INCLUSIONS\nslave, master\n" + ASSIGNED
    pair = {"face": "slave", "against": "master"}
    assert tables_of(tmp_path, named + LOAD).tables["contact"] == [pair | {"friction": 0.2}]
    assert tables_of(tmp_path, named + "master, slave, sj\n" + LOAD).tables["contact"] == [pair | {"friction": 0.1}]
    for wrong, said in (
        (named.replace("slave, master\n*CONTACT", "slave,\n*CONTACT"), "contact of one with itself is not read"),
        (named.replace("NS\nslave", "NS\nslaves"), r"no \*SURFACE 'slaves'; did you mean 'slave'"),
        (GENERAL + "*CONTACT INCLUSIONS, ALL EXTERIOR\n" + ASSIGNED + "slave, master, sj\n", "INCLUSIONS names them"),
        (GENERAL + "*CONTACT INCLUSIONS, ALL EXTERIOR\n" + ASSIGNED.replace("si", "sk"), "INTERACTION 'SK'"),
    ):
        with pytest.raises(ValueError, match=said):
            tables_of(tmp_path, wrong + LOAD)
