"""Rigid surfaces of decks that have no volume: elements R3D3, R3D4 and R2D2, and analytical surfaces."""

import numpy as np
import pytest
from test_deck_tables import CUBES, STEP, tables_of

from coulomb.case.case import read_case
from coulomb.decks.geometry_file import read_geometry
from coulomb.decks.node_surfaces import corners_of_sides

BLOCK = CUBES.replace("2, 11, 12, 13, 14, 15, 16, 17, 18\n", "").replace("*SURFACE, NAME=slave\n2, S1\n", "")
BLOCK = BLOCK.replace("NAME=master", "NAME=slave").replace("slave, master", "slave, rigid")
BLOCK = BLOCK.replace(
    "base, 1, 3\ntop, 1, 2\n", "base, 3\n1, 1\n4, 1\n5, 1\n8, 1\n1, 2\n2, 2\n5, 2\n6, 2\n900, 1, 2\n900, 4, 6\n"
)
BLOCK = BLOCK.replace("*FRICTION\n.2, 1.E6\n", "") + "*NODE\n900, .5, .5, 3\n"
"""A cube of 1 mm, E = 210000 MPa, free to the sides, below what a reference node moves."""

TURNED = (
    "*ELEMENT, TYPE=R3D4, ELSET=plate\n9, {}\n*SURFACE, NAME=rigid\nplate, {}\n*RIGID BODY, ELSET=plate, REF NODE=900\n"
)
PLATES = {
    "towards the block": TURNED.format("11, 14, 13, 12", "SPOS"),
    "away from it": TURNED.format("11, 12, 13, 14", "SNEG"),
    "without a side": TURNED.format("11, 14, 13, 12", ""),
    "triangles": TURNED.replace("R3D4", "R3D3").format("11, 14, 13\n10, 11, 13, 12", "SPOS"),
    "a plane": "*SURFACE, NAME=rigid, TYPE=CYLINDER\n.5, .5, 1., 1., .5, 1.\n.5, -1., 1.\n"
    "START, -1., 0.\nLINE, 2., 0.\n*RIGID BODY, ANALYTICAL SURFACE=rigid, REF NODE=900\n",
}


@pytest.mark.parametrize("motion", ["*BOUNDARY\n900, 3, 3, -1e-4", "*CLOAD\n900, 3, -21."])
@pytest.mark.parametrize("which", PLATES)
def test_a_rigid_plate_presses(which, motion, tmp_path):
    """Pressed by E h u / h it goes down by u: the plate follows its reference node, held by contact alone if a force
    acts on it; that was refused, also of solid bodies that are rigid as a whole."""
    tables_of(tmp_path, BLOCK + PLATES[which] + STEP.format(motion))
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.valid
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(21.0, rel=1e-9)
    assert solution.rigid_faces[0].translation[2] == pytest.approx(-1e-4, rel=1e-9)


def test_sides_of_rigid_elements_are_read(tmp_path):
    """Of the side that faces away from the block there is nothing to touch."""
    away = PLATES["towards the block"].replace("SPOS", "SNEG")
    tables_of(tmp_path, BLOCK + away + STEP.format("*BOUNDARY\n900, 3, 3, -1e-4"))
    with pytest.raises(ValueError, match="opposite"):
        read_case(tmp_path / "deck.inp").problem().solve()


PROFILE = "START, {0}, 0.\nCIRCL, 0., -{0}, 0., 0.\n"


def test_analytical_surfaces_are_where_they_are_given(tmp_path):
    """A ball about an axis of its instance, and a roll across the model and beyond, from their sides to their lowest
    places: at their radius, outwards, with their area."""
    text = BLOCK + "*PART, NAME=ball\n*SURFACE, NAME=half, TYPE=REVOLUTION\n" + PROFILE.format(5.0)
    text += (
        "*NODE\n31, 0., 0., 0.\n*NSET, NSET=ref\n31\n*RIGID BODY, ANALYTICAL SURFACE=half, REF NODE=ref\n*END PART\n"
    )
    text += "*INSTANCE, NAME=b, PART=ball\n.5, .5, 7.\n.5, .5, 7., 1.5, .5, 7., 90.\n*END INSTANCE\n"
    text += "*SURFACE, NAME=roll, TYPE=CYLINDER\n0., 0., 3., 1., 0., 3.\n0., 1., 3.\n" + PROFILE.format(2.0)
    (tmp_path / "deck.inp").write_text(text + "*RIGID BODY, ANALYTICAL SURFACE=roll, REF NODE=900\n")
    deck = read_geometry(str(tmp_path / "deck.inp"))
    for name, centre, radius, across in (("HALF", [0.5, 0.5, 7.0], 5.0, [0, 1]), ("ROLL", [0.0, 0.0, 3.0], 2.0, [0])):
        (line,) = deck.surfaces[name].lines
        r = deck.points[corners_of_sides(deck, deck.solids, *line)] - centre
        normal = np.cross(r[:, 2] - r[:, 0], r[:, 3] - r[:, 1]) / 2.0
        triangle = np.all(r[:, 2] == r[:, 3], axis=1)
        normal[triangle] = np.cross(r[triangle, 1] - r[triangle, 0], r[triangle, 2] - r[triangle, 0]) / 2.0
        length = np.ptp(r[..., 1])
        area = 2.0 * np.pi * radius**2 if name == "HALF" else np.pi / 2.0 * radius * length
        r = r[..., [*across, 2]]
        assert np.allclose(np.linalg.norm(r, axis=-1), radius) and length > 3.0 and np.all(r[..., -1] < 1e-9)
        inwards = np.einsum("fi,fi->f", normal[:, [*across, 2]], r.mean(axis=1))  # as corners of sides go round
        assert np.all(inwards < 0.0)
        assert np.linalg.norm(normal, axis=1).sum() == pytest.approx(area, rel=2e-3)


@pytest.mark.parametrize("kind", ["SEGMENTS", "R2D2"])
def test_a_rigid_line_of_a_section(kind, tmp_path):
    """Plane strain: E h u / (h (1 - nu^2)) times the thickness."""
    line = "*SURFACE, NAME=rigid, TYPE=SEGMENTS\nSTART, 2., 1.\nLINE, -1., 1.\n*RIGID BODY, ANALYTICAL SURFACE=rigid, "
    if kind == "R2D2":
        line = "*NODE\n21, 2., 1.\n22, -1., 1.\n*ELEMENT, TYPE=R2D2, ELSET=line\n9, 21, 22\n*SURFACE, NAME=rigid\n"
        line += "line, SPOS\n*RIGID BODY, ELSET=line, "
    text = (
        "*NODE\n1, 0, 0\n2, 1, 0\n3, 1, 1\n4, 0, 1\n900, 0, 3\n*ELEMENT, TYPE=CPE4, ELSET=all\n1, 1, 2, 3, 4\n"
        "*SURFACE, NAME=slave\n1, S3\n*MATERIAL, NAME=m\n*ELASTIC\n210000., .3\n*SOLID SECTION, ELSET=all, MATERIAL=m\n"
        f"{line}REF NODE=900\n*SURFACE INTERACTION, NAME=si\n*CONTACT PAIR, INTERACTION=si\nslave, rigid\n"
        "*BOUNDARY\n1, 2\n2, 2\n1, 1\n4, 1\n900, 1\n900, 6\n"
    )
    tables_of(tmp_path, text + STEP.format("*BOUNDARY\n900, 2, 2, -1e-4"))
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.valid
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(21.0 / 0.91, rel=1e-9)


@pytest.mark.parametrize(
    ("rigid", "said"),
    [
        (PLATES["a plane"].split("*RIGID")[0], "is analytical: it needs a \\*RIGID BODY, ANALYTICAL SURFACE"),
        (PLATES["a plane"].replace("SURFACE=rigid", "SURFACE=rigit"), "no analytical \\*SURFACE 'rigit'.* 'rigid'"),
        (PLATES["a plane"].replace("LINE, 2.", "PARAB, 2."), "START, LINE and CIRCL are read .* not PARAB"),
        (PLATES["a plane"].replace("0.\nLINE", "0.\nCIRCL, 1., 0., 3., 0.\nLINE"), "not equally far from its centre"),
        (PLATES["a plane"].replace("TYPE=", "FILLET RADIUS=1., TYPE="), "give the fillets as arcs"),
        (PLATES["a plane"].replace("LINE, 2., 0.", "LINE, 2."), "LINE needs 2 numbers, not 1"),
        (PLATES["a plane"].replace(".5, -1., 1.\n", ""), "needs the points a, b and c, nine numbers"),
        (PLATES["triangles"].split("*RIGID")[0], "elements of type R3D3 of which no \\*RIGID BODY has the ELSET"),
        (PLATES["triangles"].replace("REF", "TIE NSET=top, REF"), r"nodes \('top'\) beside elements"),
    ],
)
def test_wrong_rigid_surfaces_are_named(rigid, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        tables_of(tmp_path, BLOCK + rigid + STEP.format("*BOUNDARY\n900, 3, 3, -1e-4")).refuse("deck.inp")


def test_free_sides_of_tetrahedra(tmp_path):
    """Two that share a side have six others: that side was taken for two free ones."""
    nodes = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n5, 1, 1, 1\n"
    (tmp_path / "deck.inp").write_text(f"{nodes}*ELEMENT, TYPE=C3D4, ELSET=all\n1, 1, 2, 3, 4\n2, 2, 5, 3, 4\n")
    deck = read_geometry(str(tmp_path / "deck.inp"))
    sides = corners_of_sides(deck, deck.solids, None, "")
    assert len(sides) == 6 and {1, 2, 3} not in [set(row) for row in sides.tolist()]
