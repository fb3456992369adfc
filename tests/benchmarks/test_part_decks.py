"""Parts as decks for coulomb and others: their mesh, surfaces and nodal forces; the table beside others."""

import numpy as np
import pytest
from conftest import ROOT
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.beside import SIZES, Row, draw
from benchmarks.decks import slave_bodies
from benchmarks.part_decks import DECKS, deck_of
from coulomb.decks.geometry import SIDES, Geometry


def made(tmp_path, mesh, cards):
    path = tmp_path / "part.inp"
    path.write_text(deck_of(ROOT / "demos" / mesh, cards))
    return Geometry(str(path))


@pytest.mark.parametrize(
    ("mesh", "face", "axis", "at"), [("foot.msh", "seat", 2, 28.0), ("pin_joint.msh", "base", 0, -45.0)]
)
def test_surfaces_and_nodal_forces(tmp_path, mesh, face, axis, at):
    """Of first and second order: the sides of a plane face, all its nodes, and the force and moment of a traction."""
    deck = made(tmp_path, mesh, f"*STEP\n*CLOAD\ntraction, {face}, 2., 0., -3.\n*END STEP")
    on_face = deck.tags[np.abs(deck.points[:, axis] - at) < 1e-9]
    np.testing.assert_array_equal(deck.node_sets.members(face), np.sort(on_face))
    (cells,) = deck.solids.values()
    row = {int(cell[0]): cell for cell in cells}
    sides = [row[cell][1:5][list(SIDES[4][int(side[1:]) - 1])] for cell, side in deck.surfaces[face.upper()].lines]
    x = deck.points[deck.places(np.array(sides).ravel())].reshape(-1, 3, 3)
    assert np.abs(x[:, :, axis] - at).max() < 1e-9
    area = 0.5 * np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
    (load,) = (card for card in deck.others if card.kind == "CLOAD")
    entries = np.array([card.split(",") for card in load.lines], dtype=float)
    force = np.zeros((len(deck.tags), 3))
    np.add.at(force, (deck.places(entries[:, 0].astype(int)), entries[:, 1].astype(int) - 1), entries[:, 2])
    whole = np.outer(area, [2.0, 0.0, -3.0])
    np.testing.assert_allclose(force.sum(axis=0), whole.sum(axis=0), rtol=1e-9)
    if cells.shape[1] == 11:  # second moments too: nothing at the corners
        y, middles = deck.points[:, 1], 0.5 * (x + np.roll(x, 1, axis=1))[:, :, 1]
        np.testing.assert_allclose(force[:, 0] @ y**2, whole[:, 0] @ (middles**2).mean(axis=1), rtol=1e-7)
    moment = np.cross(x.mean(axis=1), whole).sum(axis=0)
    np.testing.assert_allclose(np.cross(deck.points, force).sum(axis=0), moment, atol=1e-7 * np.abs(moment).max())


def test_bodies_of_the_first_pairs(tmp_path):
    deck = made(tmp_path, "pin_joint.msh", "*CONTACT PAIR, INTERACTION=DRY\nend, base\n*CONTACT PAIR\nbase, end")
    one, both = (slave_bodies(tmp_path / "part.inp", pairs) for pairs in (1, None))
    lug, clevis = (set(deck.node_sets.members(name)) for name in ("end", "base"))
    assert lug <= one and not clevis & one and lug | clevis <= both


def test_every_part_has_a_geometry_and_the_cards_of_its_names():
    for part in SIZES:
        cards = (DECKS / f"{part}.inp").read_text().lower()
        geometry = (DECKS / f"{part}.geo").read_text()
        for name in [line.split(",")[1].strip() for line in cards.splitlines() if line.startswith("traction,")]:
            assert f'surface("{name}")' in geometry.lower() or "include" in geometry.lower()


def test_picture_and_wrong_names(tmp_path):
    rows = [Row("hook", 2, 300, "coulomb", "solved", 2.0, 1.0), Row("hook", 2, 300, "CalculiX, mortar", "> 9 s", 9.0)]
    draw([row._asdict() for row in rows], tmp_path)
    assert (tmp_path / "beside.png").stat().st_size > 5000
    for arguments, said in ((["--peer", "Ansys"], "'Ansys'"), (["--peer", "GetFEM", "--part", "hok"], "'hok'")):
        done = CliRunner().invoke(app, ["parts", *arguments])
        assert done.exit_code == 2 and f"there is no {said} here; there are " in done.stderr
