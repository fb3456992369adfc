"""Decks as tables of a case: what becomes of every card, and of loads and supports from step to step."""

import numpy as np
import pytest
from dolfinx.mesh import CellType

from coulomb.case.case import read_case
from coulomb.decks.tables import translate
from coulomb.fem.meshes import functions_of_nodes, lagrange_points

CUBES = """** two cubes, the upper one on the lower one
*NODE, NSET=all
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
11, 0, 0, 1
12, 1, 0, 1
13, 1, 1, 1
14, 0, 1, 1
15, 0, 0, 2
16, 1, 0, 2
17, 1, 1, 2
18, 0, 1, 2
*ELEMENT, TYPE=C3D8, ELSET=cubes
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 11, 12, 13, 14, 15, 16, 17, 18
*NSET, NSET=base, GENERATE
1, 4
*NSET, NSET=top, GENERATE
15, 18
*SURFACE, NAME=master
1, S2
*SURFACE, NAME=slave
2, S1
*MATERIAL, NAME=steel
*ELASTIC
210000., .3
*DENSITY
7.8e-9
*SOLID SECTION, ELSET=cubes, MATERIAL=steel
*BOUNDARY
base, 1, 3
top, 1, 2
*CONTACT PAIR, INTERACTION=si, TYPE=SURFACE TO SURFACE
slave, master
*SURFACE INTERACTION, NAME=si
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR
1.E7
*FRICTION
.2, 1.E6
"""

STEP = "*STEP\n*STATIC\n{}\n*END STEP\n"


def tables_of(tmp_path, text, **options):
    (tmp_path / "deck.inp").write_text(text)
    return translate(str(tmp_path / "deck.inp"), **options)


def steps(*texts):
    return CUBES + "".join(STEP.format(text) for text in texts)


def test_one_step(tmp_path):
    """Node forces of one step need no history; penalties are not needed; the case can be solved."""
    found = tables_of(tmp_path, steps("*CLOAD\ntop, 3, -1.\n15, 3, -1.\n*NODE PRINT, NSET=all\nU"))
    assert not found.refused
    fates = {row.keyword: row.fate for row in found.cards}
    assert fates["CLOAD"] == fates["FRICTION"] == "used" and fates["NODE PRINT"] == "not needed here"
    tables = found.tables
    assert tables["clamp"] == [{"components": "xyz", "nodes": "base"}, {"components": "xy", "nodes": "top"}]
    assert tables["contact"] == [{"face": "slave", "against": "master", "friction": 0.2}]
    assert "history" not in tables and tables["units"] == {"length": "mm", "stress": "MPa"}
    forces = {tuple(table["nodes"]): table["force"] for table in tables["nodal_force"]}
    assert forces == {(16, 17, 18): [0.0, 0.0, -1.0], (15,): [0.0, 0.0, -2.0]}  # of one step they add up
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.certificate.passed
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(5.0)


def test_loads_go_on_from_step_to_step(tmp_path):
    """A later value replaces, linearly from the one before; OP=NEW lets others go to 0; what is not given stays."""
    found = tables_of(
        tmp_path,
        steps("*DLOAD\n2, P2, 10.", "*DLOAD\n2, P2, 4.\n*CLOAD\n15, 1, 3.", "*CLOAD, OP=NEW\n16, 1, 1."),
    )
    assert found.tables["history"] == {"times": [1.0, 2.0, 3.0]}
    (pressure,) = found.tables["pressure"]
    assert pressure == {"face": "2 P2", "value": 10.0, "amplitude": [[0.0, 0.0], [1.0, 1.0], [2.0, 0.4]]}
    forces = {table["nodes"][0]: table for table in found.tables["nodal_force"]}
    assert forces[15] == {"nodes": [15], "force": [3.0, 0.0, 0.0], "amplitude": [[1.0, 0.0], [2.0, 1.0], [3.0, 0.0]]}
    assert forces[16]["amplitude"] == [[2.0, 0.0], [3.0, 1.0]]


def test_supports_that_begin_and_end(tmp_path):
    found = tables_of(tmp_path, steps("*CLOAD\ntop, 3, -1.", "*BOUNDARY, OP=NEW\nbase, 1, 3\ntop, 1, 1, .1"))
    clamps = {(table["nodes"], table["components"]): table for table in found.tables["clamp"]}
    assert clamps["top", "y"]["end"] == 1.0 and "end" not in clamps["base", "xyz"]
    (moved,) = found.tables["prescribed_displacement"]
    assert moved["components"] == "x" and moved["value"] == [0.1, 0.0, 0.0]
    assert moved["amplitude"] == [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]]
    late = "*BOUNDARY, OP=NEW\nbase, 1, 3\ntop, 3, 3, .1"
    (moved,) = tables_of(tmp_path, steps("*CLOAD\ntop, 3, -1.", late, late)).tables["prescribed_displacement"]
    assert moved == {"components": "z", "value": [0.0, 0.0, 0.1], "nodes": "top", "begin": 1.0, "reaches": 2.0}
    held = "*BOUNDARY, FIXED\n16, 3, 3"  # where it is, then from there
    found = tables_of(tmp_path, steps("*CLOAD\ntop, 3, -1.", held, "*BOUNDARY\n16, 3, 3, .2"))
    first = next(table for table in found.tables["clamp"] if table["nodes"] == [16])
    (then,) = found.tables["prescribed_displacement"]
    assert (first["begin"], first["end"]) == (1.0, 2.0) and "reaches" not in first
    assert (then["begin"], then["reaches"], then["value"]) == (2.0, 3.0, [0.0, 0.0, 0.2])


def test_amplitudes(tmp_path):
    """A value is that times the factor at the time, of the step or in all, without a ramp."""
    curve = "*AMPLITUDE, NAME=a\n0., 1., 1., 1.\n*AMPLITUDE, NAME=b, TIME=TOTAL TIME\n0., 0., 2., 2.\n"
    text = CUBES + curve + STEP.format("*CLOAD, AMPLITUDE=A\n15, 3, -1.\n*DLOAD, AMPLITUDE=b\n2, P2, 5.")
    found = tables_of(tmp_path, text + STEP.format(""))
    (force,), (pressure,) = found.tables["nodal_force"], found.tables["pressure"]
    assert force == {"nodes": [15], "force": [0.0, 0.0, -1.0]}
    assert pressure == {"face": "2 P2", "value": 10.0, "amplitude": [[0.0, 0.0], [1.0, 0.5], [2.0, 1.0]]}


def test_frames_of_nodes(tmp_path):
    """Directions of *TRANSFORM: a support along them, and around the axis of a cylinder."""
    frame = "*TRANSFORM, NSET=top, TYPE=R\n1., 1., 0., -1., 1., 0.\n"
    found = tables_of(tmp_path, CUBES.replace("top, 1, 2", "top, 2, 2") + frame + STEP.format("*CLOAD\ntop, 1, 2."))
    (_, held) = found.tables["clamp"]
    assert np.allclose(np.cross(held["direction"], [-1.0, 1.0, 0.0]), 0.0)
    (force,) = found.tables["nodal_force"]
    assert np.allclose(force["force"], [np.sqrt(2.0), np.sqrt(2.0), 0.0])
    around = frame.replace("TYPE=R\n1., 1., 0., -1., 1., 0.", "TYPE=C\n3., 0., 0., 3., 0., 1.")
    found = tables_of(tmp_path, CUBES.replace("top, 1, 2", "top, 2, 2") + around + STEP.format("*CLOAD\ntop, 3, 1."))
    (_, held) = found.tables["clamp"]
    x, y = 0.0, 1.0
    values = [eval(part, {"x": x, "y": y, "z": 0.0}) if isinstance(part, str) else part for part in held["direction"]]
    assert abs(np.dot(values, [x - 3.0, y, 0.0])) < 1e-12 and np.linalg.norm(values) > 0.0
    outwards = CUBES.replace("top, 1, 2", "top, 2, 2") + around + STEP.format("*CLOAD\n18, 1, 2.")
    (force,) = tables_of(tmp_path, outwards).tables["nodal_force"]
    assert force["nodes"] == [18] and np.allclose(force["force"], [-6.0 / np.sqrt(10.0), 2.0 / np.sqrt(10.0), 0.0])


def test_equations(tmp_path):
    """Sets are matched node by node; equations with the same directions and coefficients are one table."""
    level = "*EQUATION\n2\ntop, 3, 1., 5, 3, -1.\n*EQUATION\n3\n6, 1, 2., 7, 1, -1.\n8, 3, .5\n2\n6, 3, 1., 7, 3, -1."
    one, other = tables_of(tmp_path, CUBES + level + "\n" + STEP.format("")).tables["equation"]
    assert [term["nodes"] for term in one["terms"]] == [[15, 16, 17, 18, 6], [5, 5, 5, 5, 7]]
    kinds = [[(term["component"], term["coefficient"]) for term in table["terms"]] for table in (one, other)]
    assert kinds == [[("z", 1.0), ("z", -1.0)], [("x", 2.0), ("x", -1.0), ("z", 0.5)]]
    assert [term["nodes"] for term in other["terms"]] == [[6], [7], [8]]
    assert [(term["component"], term["coefficient"]) for term in other["terms"]] == [
        ("x", 2.0),
        ("x", -1.0),
        ("z", 0.5),
    ]
    for lines, message in (
        ("2\n6, 4, 1., 7, 1, 1.", "between displacements 1, 2 and 3, not 4"),
        ("2\n6, 1, 1., 99, 1, 1.", "node 99 is not defined"),
        ("2\n6, 1, 1., top, 1, 1.", "as many nodes as the first, or one"),
        ("2\n6, 1, 1.", "has 1 terms of node, direction and coefficient, not 2"),
    ):
        with pytest.raises(ValueError, match=rf"deck.inp: line \d+: \*EQUATION: .*{message}"):
            tables_of(tmp_path, f"{CUBES}*EQUATION\n{lines}\n" + STEP.format(""))


def test_refused_cards_are_named_with_their_line(tmp_path):
    text = steps("*CLOAD\ntop, 3, -1.") + "*PLASTIC\n1., 0.\n*DYNAMIC\n"
    found = tables_of(tmp_path, text)
    line = text[: text.index("*PLASTIC")].count("\n") + 1
    assert [row.keyword for row in found.refused] == ["PLASTIC", "DYNAMIC"] and not found.tables
    with pytest.raises(ValueError, match=rf"--ignore CARD.*\n  \*PLASTIC: deck.inp, line {line}: .*\n  \*DYNAMIC"):
        found.refuse("deck.inp")
    assert not tables_of(tmp_path, text, ignore=["plastic", "*Dynamic"]).refused


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("top, 1, 2", "nowhere, 1, 2"), r"line 38: \*BOUNDARY: there is no node set 'nowhere'"),
        (("base, 1, 3", "base, 1, x"), r"line 37: \*BOUNDARY: damaged: 'x' is no number"),
        (("MATERIAL=steel", "MATERIAL=iron"), r"\*SOLID SECTION: there is no \*MATERIAL 'iron'"),
        (("slave, master", "slave, nobody"), r"there is no \*SURFACE 'nobody'"),
        (("INTERACTION=si,", "INTERACTION=none,"), r"there is no \*SURFACE INTERACTION 'none'"),
        (("ELSET=cubes, MATERIAL", "ELSET=none, MATERIAL"), "there is no element set 'none'"),
    ],
)
def test_wrong_decks(change, message, tmp_path):
    with pytest.raises(ValueError, match=f"deck.inp: .*{message}"):
        tables_of(tmp_path, steps("*CLOAD\ntop, 3, -1.").replace(*change))


def test_materials(tmp_path):
    """Constants at the temperature, orthotropic ones by compliance, hyperelastic ones for large motions."""
    own = "*ELASTIC\n1000., .3, 20.\n2000., .3, 120.\n*EXPANSION, ZERO=20.\n1.e-5\n*DENSITY\n7.8e-9\n"
    warm = CUBES.replace("*ELASTIC\n210000., .3\n*DENSITY\n7.8e-9\n", own)
    warm += "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nall, 20.\n"
    found = tables_of(tmp_path, warm + STEP.format("*TEMPERATURE\nall, 70."))
    assert found.tables["material"]["young"] == 1500.0
    assert found.tables["temperature"] == {"value": 70.0, "reference": 20.0}
    young, nu = 1000.0, 0.25
    lame, shear = young * nu / (1 + nu) / (1 - 2 * nu), young / 2 / (1 + nu)
    stiff = [lame + 2 * shear, lame, lame + 2 * shear, lame, lame, lame + 2 * shear, shear, shear, shear]
    text = CUBES.replace("*ELASTIC\n210000., .3", "*ELASTIC, TYPE=ORTHO\n" + ", ".join(map(repr, stiff)) + ", 294.")
    table = tables_of(tmp_path, text + STEP.format("")).tables["material"]
    assert np.allclose(table["young"], young) and np.allclose(table["poisson"], nu)
    rubber = CUBES.replace("*ELASTIC\n210000., .3", "*HYPERELASTIC, MOONEY-RIVLIN\n.5, .1, .02")
    found = tables_of(tmp_path, rubber + "*STEP, NLGEOM\n*STATIC\n.25, 1.\n*BOUNDARY\ntop, 3, 3, -.1\n*END STEP\n")
    assert found.tables["material"] == {"law": "mooney-rivlin", "c1": 0.5, "c2": 0.1, "bulk": 100.0, "density": 7.8e-9}
    assert found.tables["solver"] == {"kinematics": "large"} and found.tables["history"]["times"] == [
        0.25,
        0.5,
        0.75,
        1.0,
    ]


def test_pairs_that_are_taken_out_and_put_in(tmp_path):
    """Out of the model their gap is its size; a clearance that is an overlap comes in the course of the step."""
    out, put = (f"*MODEL CHANGE, TYPE=CONTACT PAIR, {word}\nslave, master" for word in ("REMOVE", "ADD"))
    clearance = "*CLEARANCE, SLAVE=slave, MASTER=master, VALUE=-0.01\n"
    (contact,) = tables_of(tmp_path, CUBES + clearance + STEP.format(out) + STEP.format(put)).tables["contact"]
    gaps = {time: contact["gap"] * factor for time, factor in contact["gap_amplitude"]}
    assert gaps[0.0] == gaps[1.0] > 3.0 and gaps[2.0] == pytest.approx(-0.01) and 0.0 in gaps.values()


def test_friction_that_changes(tmp_path):
    change = "*CHANGE FRICTION, INTERACTION=si\n*FRICTION\n.1, 1.E6"
    (contact,) = tables_of(tmp_path, steps("", change)).tables["contact"]
    rows = [[time, contact["friction"] * factor] for time, factor in contact["friction_amplitude"]]
    assert np.allclose(rows, [[0.0, 0.2], [1.0, 0.2], [1.0, 0.1]], atol=2e-6)


def test_general_contact_finds_the_pairs(tmp_path):
    pair = "*CONTACT PAIR, INTERACTION=si, TYPE=SURFACE TO SURFACE\nslave, master\n"
    general = "*Contact\n*Contact Inclusions, ALL EXTERIOR\n*Contact Property Assignment\n , , SI\n"
    found = tables_of(tmp_path, CUBES.replace(pair, general) + STEP.format("*CLOAD\ntop, 3, -1."))
    assert found.tables["auto_contact"]["friction"] == 0.2 and "contact" not in found.tables
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.certificate.passed and solution.at_nodes.totals()["normal_force"] == pytest.approx(4.0)


COLUMN = """*NODE
21, 5, 0, 0
22, 6, 0, 0
23, 6, 1, 0
24, 5, 1, 0
25, 5, 0, 1
26, 6, 0, 1
27, 6, 1, 1
28, 5, 1, 1
29, 5, 0, 2
30, 6, 0, 2
31, 6, 1, 2
32, 5, 1, 2
99, 0, 0, 9
*ELEMENT, TYPE=C3D8, ELSET=cubes
3, 21, 22, 23, 24, 25, 26, 27, 28
4, 25, 26, 27, 28, 29, 30, 31, 32
*NSET, NSET=foot, GENERATE
21, 24
*NSET, NSET=head, GENERATE
29, 32
*SURFACE, NAME=section
3, S2
*BOUNDARY
foot, 1, 3
head, 1, 3
"""


@pytest.mark.parametrize(("vector", "sign"), [("", 1.0), ("0., 0., 1.\n", 1.0), ("0., 0., -1.\n", -1.0)])
def test_bolts(vector, sign, tmp_path):
    """The body is cut at the section; a vector into the elements of the surface presses in place of pulling."""
    bolt = "*PRE-TENSION SECTION, SURFACE=section, NODE=99\n" + vector
    loads = STEP.format("*CLOAD\n99, 1, 10.\ntop, 3, -1.")
    found = tables_of(tmp_path, CUBES + COLUMN + bolt + loads)
    assert found.tables["mesh"]["cut"] == ["section"] and found.tables["pretension"][0]["force"] == 10.0 * sign
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    (foot,) = (one for one in solution.reactions if one.face == "foot")
    assert foot.force[2] == pytest.approx(-10.0 * sign)
    locked = "*BOUNDARY, FIXED\n99, 1, 1"
    (table,) = tables_of(tmp_path, CUBES + COLUMN + bolt + loads + STEP.format(locked)).tables["pretension"]
    assert table["lock"] == 1.0 and table["amplitude"] == [[0.0, 0.0], [1.0, 1.0]]


def test_ties_couplings_and_rigid_faces(tmp_path):
    text = CUBES + COLUMN + "*NSET, NSET=reference\n99\n*SURFACE, NAME=lid\n4, S2\n*SURFACE, NAME=ground\n3, S1\n"
    free = text.replace("head, 1, 3\n", "")
    kinematic = "*COUPLING, REF NODE=reference, SURFACE=lid, CONSTRAINT NAME=c\n*KINEMATIC\n1, 3\n"
    found = tables_of(tmp_path, free + kinematic + STEP.format("*BOUNDARY\n99, 3, 3, -0.1\n99, 5\n*CLOAD\n99, 1, 7."))
    (rigid,) = found.tables["rigid_face"]
    assert rigid == {"face": "lid", "point": [0.0, 0.0, 9.0], "translation": {"z": -0.1}, "rotation": {"y": 0.0}}
    assert found.tables["point_load"] == [{"face": "lid", "point": [0.0, 0.0, 9.0], "force": [7.0, 0.0, 0.0]}]
    spread = kinematic.replace("*KINEMATIC\n1, 3", "*DISTRIBUTING\n1, 3")
    found = tables_of(tmp_path, free + spread + STEP.format("*CLOAD\n99, 1, 7.\n99, 6, 2."))
    (load,) = found.tables["point_load"]
    assert load["force"] == [7.0, 0.0, 0.0] and load["moment"] == [0.0, 0.0, 2.0] and "rigid_face" not in found.tables
    tie = "*TIE, NAME=t\nlid, ground\n"
    assert tables_of(tmp_path, text + tie + STEP.format("")).tables["tie"] == [
        {"face": "lid", "against": "ground", "slave": True}
    ]
    sector = "*TIE, CYCLIC SYMMETRY, NAME=t\nlid, ground\n*CYCLIC SYMMETRY MODEL, N=6, TIE=t\n0, 0, 0, 0, 0, 1\n"
    (cyclic,) = tables_of(tmp_path, text + sector + STEP.format("")).tables["cyclic_symmetry"]
    assert cyclic["sectors"] == 6 and cyclic["axis"] == [0.0, 0.0, 1.0]


def test_springs(tmp_path):
    """Of one node they add up; SPRINGA along the line to a node of no solid; between nodes of solids, or along no axis,
    they are equations with a stiffness."""
    ground = CUBES.replace("18, 0, 1, 2", "18, 0, 1, 2\n91, -1., 0., 1.\n92, -1., 1., 1.")
    springs = "*ELEMENT, TYPE=SPRING1, ELSET=g\n101, 11\n102, 12\n*SPRING, ELSET=g\n2\n\n50.\n"
    springs += "*ELEMENT, TYPE=SPRINGA, ELSET=a\n103, 91, 11\n*BOUNDARY\n91, 1, 3\n*SPRING, ELSET=a\n\n7.\n"
    found = tables_of(tmp_path, ground + springs + STEP.format("*DLOAD\n2, P2, 10."))
    assert {row.keyword: row.fate for row in found.cards}["SPRING"] == "used"
    by_nodes = {tuple(table["nodes"]): table["stiffness"] for table in found.tables["spring"]}
    assert by_nodes == {(11,): [7.0, 50.0, 0.0], (12,): [0.0, 50.0, 0.0]}
    assert read_case(tmp_path / "deck.inp").problem().solve().certificate.passed
    pairs = springs.replace("103, 91, 11", "103, 7, 16\n104, 91, 13")
    pairs += "*ELEMENT, TYPE=SPRING2, ELSET=b\n105, 5, 11\n*SPRING, ELSET=b\n1, 2\n9.\n"
    found = tables_of(tmp_path, ground + pairs + STEP.format("*DLOAD\n2, P2, 10.")).tables["equation"]
    terms = [{(*t["nodes"], t["component"]): t["coefficient"] for t in one["terms"]} for one in found]
    along = 0.5**0.5
    assert terms[0] == pytest.approx({(7, "y"): along, (7, "z"): -along, (16, "y"): -along, (16, "z"): along})
    assert terms[1] == pytest.approx({(13, "x"): 2.0 / 5.0**0.5, (13, "y"): 1.0 / 5.0**0.5})
    assert terms[2] == {(5, "x"): 1.0, (11, "y"): -1.0} and [one["stiffness"] for one in found] == [7.0, 7.0, 9.0]
    assert read_case(tmp_path / "deck.inp").problem().solve().certificate.passed
    for wrong, said in (
        (springs.replace("ELSET=a\n\n7.", "ELSET=a, NONLINEAR\n0., 0., 1., 1."), "only linear springs are read"),
        (springs.replace("103, 91, 11", "103, 91, 92"), "no node of a solid element"),
    ):
        with pytest.raises(ValueError, match=said):
            tables_of(tmp_path, ground + wrong + STEP.format("*DLOAD\n2, P2, 10."))


def test_weight_set_by_set(tmp_path):
    """One gravity for all elements may be given in several lines; it may act on some alone, whose weight the foot then
    carries, beside rotation of some, density times omega^2 times the distance from the axis."""
    sets = CUBES + "*ELSET, ELSET=low\n1\n*ELSET, ELSET=up\n2\n"
    weight = "*DLOAD\nlow, GRAV, 9810., 0., 0., -1.\nup, GRAV, 9810., 0., 0., -1."
    assert tables_of(tmp_path, sets + STEP.format(weight)).tables["gravity"] == [0.0, 0.0, -9810.0]
    up = STEP.format("*DLOAD\nup, GRAV, 9810., 0., 0., -1.")
    rho = 7.8e-9
    assert tables_of(tmp_path, sets + up).tables["volume_force"] == [
        {"cells": "up", "value": [0.0, 0.0, -rho * 9810.0]}
    ]
    turned = "*DLOAD\nup, GRAV, 9810., 0., 0., -1.\nup, CENTRIF, 1.E3, -1., .5, 0., 0., 0., 1."
    found = tables_of(tmp_path, sets.replace("top, 1, 2\n", "") + STEP.format(turned))
    assert len(found.tables["volume_force"]) == 2
    answer = read_case(tmp_path / "deck.inp").problem().solve()
    (foot,) = (one for one in answer.reactions if "base" in one.name)
    assert answer.valid and foot.force[:2] == pytest.approx([-rho * 1.5e3, 0.0])
    section = "*SOLID SECTION, ELSET=cubes, MATERIAL=steel\n"
    two = sets.replace(section, section.replace("cubes", "low") + section.replace("cubes", "up"))
    tables_of(tmp_path, two + up)
    answer = read_case(tmp_path / "deck.inp").problem().solve()
    assert answer.valid and answer.forces["normal_force"] == pytest.approx(7.8e-9 * 9810.0)
    (foot,) = (one for one in answer.reactions if "base" in one.name)
    assert foot.force[2] == pytest.approx(7.8e-9 * 9810.0)


def test_nodes_that_stay_in_a_plane_or_on_a_line(tmp_path):
    """The lid of a sheared cube stays plane, its edge straight, while one node is pulled; what is not plane is said."""
    moved = CUBES.replace("17, 1, 1, 2", "17, 1, 1, 2.5").replace("18, 0, 1, 2", "18, 0, 1, 2.25")
    moved = moved.replace("16, 1, 0, 2", "16, 1, 0, 2.25").replace("top, 1, 2", "15, 1, 3\n18, 1, 1")
    load = STEP.format("*CLOAD\n17, 3, 1.\n16, 2, .1\n*DLOAD\n2, P2, 10.")
    found = tables_of(tmp_path, moved + "*MPC\nPLANE, 15, 16, 18,\n17\nSTRAIGHT, 11, 12, 12\n" + load)
    assert found.tables["equation"] and not found.refused
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    x, u = solution.problem.elasticity.x, solution.displacement
    lid = [
        int(np.argmin(np.linalg.norm(x - place, axis=1)))
        for place in ((0, 0, 2), (1, 0, 2.25), (0, 1, 2.25), (1, 1, 2.5))
    ]
    one, two, three, four = u[lid]
    normal = np.cross(x[lid[1]] - x[lid[0]], x[lid[2]] - x[lid[0]])
    assert normal @ (four - two - three + one) == pytest.approx(0.0, abs=1e-9 * np.abs(u).max())
    assert abs((four - two - three + one)[0]) > 1e-3 * np.abs(u).max()  # it moves within the plane
    with pytest.raises(ValueError, match=r"line \d+: \*MPC: PLANE: node 17 is 0\.\d+ off"):
        tables_of(tmp_path, moved.replace("1, 2.5", "1, 3.") + "*MPC\nPLANE, 15, 16, 18, 17\n" + load)
    with pytest.raises(ValueError, match=r"\*MPC: the first 2 nodes of STRAIGHT make none"):
        tables_of(tmp_path, moved + "*MPC\nSTRAIGHT, 5, 11, 12\n" + load)
    gap = tables_of(tmp_path, moved + "*GAP, ELSET=g\n.1, 0., 0., 1.\n" + load)
    assert "give a *CONTACT PAIR of the faces" in gap.refused[0].why
    link = tables_of(tmp_path, moved + "*MPC\nLINK, 15, 16\n" + load)
    assert [(row.keyword, row.why.partition("; ")[0][-12:]) for row in link.refused] == [("MPC", "of kind LINK")]


def test_nodes_that_move_as_others(tmp_path):
    """*MPC of kind BEAM: on arms that turn with a reference node; of TIE and PIN: as the other, as equations say."""
    text = CUBES.replace("top, 1, 2\n", "") + "*NODE\n900, .5, .5, 3\n"
    moved = STEP.format("*BOUNDARY\n900, 1, 2\n900, 3, 3, -1e-4\n900, 4\n900, 5, 5, 1e-5\n900, 6")
    assert not tables_of(tmp_path, text + "*MPC\nBEAM, top, 900\n" + moved).refused
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    x, u = solution.problem.elasticity.x, solution.displacement
    lid = x[:, 2] > 1.999
    assert np.allclose(u[lid], np.column_stack([np.full(4, -1e-5), np.zeros(4), -1e-4 - 1e-5 * (x[lid, 0] - 0.5)]))
    load = STEP.format("*CLOAD\n15, 3, -1.")
    rows = "".join(f"*EQUATION\n2\n17, {dof}, 1., 15, {dof}, -1.\n" for dof in (1, 2, 3))
    expected = tables_of(tmp_path, text + rows + load).tables["equation"]
    for kind in ("TIE", "PIN"):
        assert tables_of(tmp_path, text + f"*MPC\n{kind}, 17, 15\n" + load).tables["equation"] == expected
    for wrong, said in (
        ("BEAM, 15, 16", "line 48: .*nodes of solids have no rotations"),
        ("TIE, top, base, 15", "needs a kind and two nodes"),
        ("PIN, 15, top", "'15' has 1 nodes, but 'top' 4"),
        ("PIN, 900, 15", "node 900 belongs to no solid element"),
    ):
        with pytest.raises(ValueError, match=said):
            tables_of(tmp_path, text + f"*MPC\n{wrong}\n" + load)


def test_temperatures_of_some_nodes(tmp_path):
    """Of one cube of two alone: it expands freely by alpha dT, while the other stays; in steps back again."""
    own = "*EXPANSION\n1.e-5\n*INITIAL CONDITIONS, TYPE=TEMPERATURE\nall, 20.\n"
    text = CUBES.replace("base, 1, 3\ntop, 1, 2", "1, 1, 3\n2, 2, 3\n4, 3, 3\n18, 1, 2\n17, 2, 2")
    text = text.replace("*DENSITY\n", own[: own.index("*INITIAL")] + "*DENSITY\n") + own[own.index("*INITIAL") :]
    high = "*ELSET, ELSET=upper\n2\n*NSET, NSET=high, GENERATE\n11, 18\n"
    text = text.replace("*NSET, NSET=base", high + "*NSET, NSET=base")
    heated = tables_of(tmp_path, text + STEP.format("*TEMPERATURE\nhigh, 120.\n*CLOAD\ntop, 3, -1.e-3"))
    at = [{"nodes": "upper", "value": 120.0}]
    assert heated.tables["temperature"] == {"value": 20.0, "reference": 20.0, "at": at}
    problem = read_case(tmp_path / "deck.inp").problem()
    z, u = problem.body.elasticity.x[:, 2], problem.solve().displacement
    assert np.allclose(u[z == 2.0, 2], 1e-3, rtol=1e-3) and np.all(np.abs(u[z < 2.0, 2]) < 1e-6)
    cooled = text + "".join(STEP.format(f"*TEMPERATURE\nhigh, {value}.") for value in (120, 70))
    assert tables_of(tmp_path, cooled).tables["temperature"]["amplitude"] == [[0.0, 0.0], [1.0, 1.0], [2.0, 0.5]]
    back = tables_of(tmp_path, cooled.replace("*TEMPERATURE\nhigh, 70.", "*TEMPERATURE, OP=NEW\n1, 20."))
    assert back.tables["temperature"]["amplitude"] == [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]
    with pytest.raises(ValueError, match=r"\*TEMPERATURE: temperatures of different nodes do not follow one course"):
        tables_of(tmp_path, cooled.replace("high, 70.", "base, 70."))
    with pytest.raises(ValueError, match=r"CONDITIONS: 8 nodes of solids, as 11, have no initial"):
        tables_of(tmp_path, cooled.replace("all, 20.", "base, 20.\n5, 20.\n6, 20.\n7, 20.\n8, 20."))


def test_expansion_by_temperature_is_that_from_zero(tmp_path):
    """alpha(T) (T - zero) - alpha(T0) (T0 - zero) = 3e-4 * 100 - 2e-4 * 50 = 0.02, as in CalculiX."""
    own = "*EXPANSION, ZERO=0.\n2.e-4, 50.\n3.e-4, 100.\n*DENSITY\n"
    warm = CUBES.replace("*DENSITY\n", own) + "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nall, 50.\n"
    found = tables_of(tmp_path, warm + STEP.format("*TEMPERATURE\nall, 100."))
    assert found.tables["material"]["expansion"] == pytest.approx(0.02 / 50.0)


def test_loads_that_are_given_twice(tmp_path):
    """Lines of one card with the same value add up; sides that a step before presses with others are said."""
    sets = CUBES + "*ELSET, ELSET=both\n1, 2\n"
    pressures = tables_of(tmp_path, sets + STEP.format("*DLOAD\nboth, P2, 5.\n2, P2, 5.")).tables["pressure"]
    assert [table["value"] for table in pressures] == [5.0, 5.0]
    assert tables_of(tmp_path, steps("*DLOAD\n2, P2, 5.\n2, P2, 5.")).tables["pressure"][0]["value"] == 10.0
    twice = "*DLOAD\nboth, P2, 5."
    assert len(tables_of(tmp_path, sets + STEP.format(twice) * 2).tables["pressure"]) == 1
    with pytest.raises(ValueError, match=r"\*DLOAD: presses some of the sides that a step before presses with others"):
        tables_of(tmp_path, sets + STEP.format(twice) + STEP.format("*DLOAD\n2, P2, 8."))
    new = tables_of(tmp_path, sets + STEP.format(twice) + STEP.format("*DLOAD, OP=NEW\n2, P2, 8.")).tables["pressure"]
    assert [table["amplitude"][-1] for table in new] == [[2.0, 0.0], [2.0, 1.0]]


def test_loads_of_other_kinds(tmp_path):
    """Weight without a set and along two directions, forces per volume, tractions; what is not read is said."""
    weight = "*DLOAD\n, GRAV, 9810., 0., 0., -2.\ncubes, GRAV, 3., 1., 0., 0.\ncubes, BZ, -.5"
    tables = tables_of(tmp_path, steps(weight)).tables
    assert tables["gravity"] == [3.0, 0.0, -9810.0] and tables["body_force"] == [0.0, 0.0, -0.5]
    surface = CUBES + "*SURFACE, NAME=lid\n2, S2\n"
    tables = tables_of(tmp_path, surface + STEP.format("*DSLOAD\nlid, TRVEC, 10., 3., 0., -4.")).tables
    assert tables["traction"] == [{"face": "lid", "value": [6.0, 0.0, -8.0]}]
    for load, said in (
        ("*DLOAD\n2, P, 5.", "loads of kind 'P' are not read: which side"),
        ("*DLOAD\n2, HP2, 5., 1., 0.", "loads of kind 'HP2' are not read"),
        ("*DLOAD\ncubes, GRAV, 1., 0., 0., 1.\n2, GRAV, 1., 0., 0., 1.", "give the name of a set of elements, not"),
    ):
        with pytest.raises(ValueError, match=said):
            tables_of(tmp_path, steps(load))


REFUSED_OPTIONS = {
    "*FRICTION\n.2, 1.E6": {
        "*FRICTION, EXPONENTIAL DECAY\n.3, .2, 1.": "friction of kind EXPONENTIALDECAY",
        "*FRICTION\n.2, 0., 0.\n.1, 0., 100.": "line 46: .*depends on slip rate, pressure or temperature",
    },
    "*SURFACE BEHAVIOR, PRESS": {"*SURFACE BEHAVIOR, NO SEPARATION, PRESS": "NO SEPARATION"},
    "*FRICTION\n": {
        "*CLEARANCE, CPSET=a, VALUE=.1\n*FRICTION\n": "SLAVE, MASTER and VALUE alone",
        "*CLEARANCE, SLAVE=slave, MASTER=slave, VALUE=.1\n*FRICTION\n": "no \\*CONTACT PAIR of these",
        "*SURFACE, TYPE=CYLINDER, NAME=roll\nSTART, 0., 0.\n*FRICTION\n": "is analytical: it needs a",
        "*AMPLITUDE, NAME=a, DEFINITION=MODULATED\n1, 6., 0., 0.\n0., 1.\n*FRICTION\n": "TABULAR, SMOOTH STEP and",
        "*AMPLITUDE, NAME=a, VALUE=ABSOLUTE\n0., 0., 1., 1.\n*FRICTION\n": "VALUE=ABSOLUTE",
    },
}


@pytest.mark.parametrize("right", REFUSED_OPTIONS)
def test_options_that_change_the_answer_are_not_skipped(right, tmp_path):
    for option, said in REFUSED_OPTIONS[right].items():
        load = STEP.format(f"*CLOAD{', AMPLITUDE=a' if 'AMPLITUDE' in option else ''}\ntop, 3, -1.")
        with pytest.raises(ValueError, match=said):
            tables_of(tmp_path, CUBES.replace(right, option) + load)


def test_axes_of_an_orientation_that_are_turned(tmp_path):
    """By the angle of the second line: 90 degrees about the third axis makes the second the first."""
    own = "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n3., 2., 1., .1, .1, .1, 1., 1.,\n1."
    text = CUBES.replace("*ELASTIC\n210000., .3", own).replace(
        "MATERIAL=steel\n*B", "MATERIAL=steel, ORIENTATION=o\n*B"
    )
    axes = "*ORIENTATION, NAME=o\n1., 0., 0., 1., 1., 0.\n3, 90.\n"
    material = tables_of(tmp_path, text + axes + STEP.format("*DLOAD\n2, P2, 5.")).tables["material"]
    assert np.allclose(material["directions"], [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def test_temperatures_in_20_node_cells_are_of_second_order():
    """x^2 y z is among the functions of the 20 nodes, so that it is exact in the middles of faces and cell, too."""
    cell = CellType.hexahedron
    nodes = lagrange_points(cell, 2)
    values = nodes[:, 0] ** 2 * nodes[:, 1] * nodes[:, 2]
    assert np.allclose(functions_of_nodes(cell, 20, nodes) @ values[:20], values)
    corners = functions_of_nodes(cell, 8, nodes) @ nodes[:8]
    assert np.allclose(corners, nodes)
