"""Decks through the command line: the table of cards, results as .frd, import; those of ../shared beside CalculiX."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, run_coulomb
from test_deck_tables import COLUMN, CUBES, STEP

from coulomb import LoadHistory
from coulomb.case.case import read_case
from coulomb.io import other_formats
from coulomb.io.field_files import read_grids

DECKS = ROOT.parent / "shared" / "decks"

PUSHED = CUBES + STEP.format("*DLOAD\n2, P2, 10.\n*NODE PRINT, NSET=all\nU")


def blocks_of(path):
    """Rows of numbers of the results of an .frd file by name, of the last time."""
    found, rows = {}, None
    for line in path.read_text().splitlines():
        if line.startswith(" -4"):
            rows = found[line[5:13].strip()] = {}
        elif line.startswith(" -3"):
            rows = None
        elif rows is not None and line.startswith(" -1"):
            rows[int(line[3:13])] = [float(line[k : k + 12]) for k in range(13, len(line), 12)]
    return found


def test_a_deck_runs_and_its_results_have_its_numbers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("deck.inp").write_text(PUSHED)
    done = run_coulomb("run", "deck.inp", "--set", "output.picture=false")
    cards = [line.split() for line in done.stdout.splitlines() if line.startswith("card")]
    assert ["card", "2", "x", "*NSET", "used"] in cards
    assert ["card", "*NODE", "PRINT", "not", "needed", "here;", "all", "results", "are", "written"] in cards
    blocks = blocks_of(tmp_path / "results" / "deck" / "results.frd")
    (grid,) = read_grids(tmp_path / "results" / "deck" / "solution.xdmf").values()
    fields = grid.fields
    numbers = fields["node_number"].astype(int).tolist()
    assert sorted(numbers) == [*range(1, 9), *range(11, 19)]
    assert np.allclose([blocks["DISP"][n] for n in numbers], fields["displacement"], rtol=1e-4, atol=1e-12)
    assert np.sum(list(blocks["FORC"].values()), axis=0) == pytest.approx([0.0, 0.0, 10.0], abs=1e-4)
    assert blocks["STRESS"][17][2] == pytest.approx(-10.0, rel=1e-2)  # szz at the top
    pressures = {n: row[3] for n, row in blocks["CONTACT"].items() if row[3] > 0.0}
    assert set(pressures) == {11, 12, 13, 14} and np.mean(list(pressures.values())) == pytest.approx(10.0)


def test_nodes_of_a_cut_keep_their_numbers(tmp_path, monkeypatch):
    """Those of one side of a bolt's section do, those of the other get new ones: all are where the deck has them."""
    monkeypatch.chdir(tmp_path)
    bolt = "*PRE-TENSION SECTION, SURFACE=section, NODE=99\n" + STEP.format("*CLOAD\n99, 1, 10.\ntop, 3, -1.")
    Path("deck.inp").write_text(CUBES + COLUMN + bolt)
    run_coulomb("run", "deck.inp", "--set", "output.picture=false")
    nodes = (CUBES + COLUMN).partition("*NSET")[0] + COLUMN.partition("*ELEMENT")[0]
    rows = [line.split(",") for line in nodes.splitlines() if line[:1].isdigit() and line.count(",") == 3]
    places = {int(n): tuple(map(float, x)) for n, *x in rows if int(n) != 99}
    text = Path("results/deck/results.frd").read_text().partition("    2C")[2].partition("\n -3")[0]
    written = [line for line in text.splitlines() if line.startswith(" -1")]
    found = {int(line[3:13]): tuple(float(line[k : k + 12]) for k in (13, 25, 37)) for line in written}
    assert len(found) == len(places) + 4 and {n: found[n] for n in places} == places


def test_directions_of_contact_in_frd():
    """On a master with the normal z the second direction is y, as CalculiX writes it of two blocks; shear is that on
    the master."""
    own = {"normal": [[0.0, 0.0, -1.0]], "gap": [0.0], "slip": [[1.0, 2.0, 0.0]], "pressure": [3.0]}
    own["friction_traction"] = [[-4.0, -5.0, 0.0]]
    found = other_formats._contact({name: np.array(values) for name, values in own.items()})
    assert found.tolist() == [[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]]


def test_an_imported_deck_is_the_same_case(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    Path("in/deck.inp").write_text(PUSHED)
    done = run_coulomb("import", "in/deck.inp", "case.toml")
    assert "case.toml written; next: coulomb run case.toml" in done.stdout
    written, given = (read_case(path) for path in ("case.toml", "in/deck.inp"))
    assert written.model_dump() == given.model_dump()
    run_coulomb("import", "in/deck.inp", "case.toml", code=2)
    other = run_coulomb("import", "case.toml", code=2)
    assert "ends in .inp" in other.stderr


def test_motions_of_a_deck_in_steps_that_are_too_large_for_small_strains(tmp_path, monkeypatch):
    """Two cubes that overlap by 0.6 of their edge, put together in the second step, with ADJUST: solved again as large
    ones, by St. Venant-Kirchhoff's law without lateral strain: N = E A s (1 - s^2) / 2 of the stretch s = 0.7."""
    monkeypatch.chdir(tmp_path)
    change = "*MODEL CHANGE, TYPE=CONTACT PAIR, {}\nslave, master"
    text = CUBES.replace("210000., .3", "210000., 0.").replace("top, 1, 2", "top, 1, 3")
    text = text.replace("TYPE=SURFACE TO", "ADJUST=.001, TYPE=SURFACE TO")
    text += "*CLEARANCE, SLAVE=slave, MASTER=master, VALUE=-.6\n"
    text += (STEP.format(change.format("REMOVE")) + STEP.format(change.format("ADD"))).replace("*STEP", "*STEP, NLGEOM")
    Path("deck.inp").write_text(text)
    done = run_coulomb("run", "deck.inp", "--set", "output.picture=false")
    assert "motions are too large for the theory of small strains: solved again as large ones" in done.stdout
    forces = [
        json.loads(Path(f"results/{of}/steps/0003/summary.json").read_text())["totals"]["normal_force"]
        for of in ("deck.previous", "deck")
    ]
    assert forces == pytest.approx([210000.0 * 0.3, 210000.0 * 0.7 * (1.0 - 0.7**2) / 2.0], rel=1e-6)


def test_faces_that_meet_in_large_motions(tmp_path, monkeypatch):
    """A cube beside a smaller one is moved above it and presses it to the stretch s = 0.999: faces that are not
    opposite before deformation were refused with NLGEOM, as they are without."""
    monkeypatch.chdir(tmp_path)
    text = CUBES.replace("210000., .3", "210000., 0.").replace("top, 1, 2\n", "").replace("*FRICTION\n.2, 1.E6\n", "")
    places = {"x": (1.4, 2.6), "y": (-0.1, 1.1), "z": (0.0, 1.1, 2.1)}
    for node in range(11, 19):
        given = text.split(f"\n{node}, ")[1].split("\n")[0]
        moved = ", ".join(str(of[int(x)]) for of, x in zip(places.values(), given.split(", "), strict=True))
        text = text.replace(f"\n{node}, {given}\n", f"\n{node}, {moved}\n", 1)
    text += "*NSET, NSET=upper, GENERATE\n11, 18\n"
    step = STEP.format(".1, 1.\n*BOUNDARY\nupper, 1, 1, -1.5\nupper, 2, 2\nupper, 3, 3, -.101")
    Path("small.inp").write_text(text + step)
    assert "no part of it is opposite to" in run_coulomb("run", "small.inp", code=2).stderr
    Path("deck.inp").write_text(text + step.replace("*STEP", "*STEP, NLGEOM"))
    done = run_coulomb("run", "deck.inp", "--set", "output.picture=false")
    assert "; solved as large motions, in which they may meet" in done.stdout
    last = sorted(Path("results/deck/steps").iterdir())[-1] / "summary.json"
    force = json.loads(last.read_text())["totals"]["normal_force"]
    assert force == pytest.approx(210000.0 * 0.999 * (1.0 - 0.999**2) / 2.0, rel=1e-6)


def test_a_refused_card_stops_the_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("deck.inp").write_text(PUSHED + "*CREEP\n1., 2., 3.\n")
    done = run_coulomb("run", "deck.inp", code=2)
    assert "*CREEP: deck.inp, line" in done.stderr and not Path("results").exists()
    run_coulomb("run", "deck.inp", "--ignore", "creep", "--set", "output.picture=false", "--quiet")


VERTICAL_FORCES = {"contact5": 25.0, "contactenergy": 4.0, "cubes": 25.0, "friction1": 25.0, "moved": 1000.0} | {
    "punch1": 14.6444,
    "testmortar": 25.0,
}
"""Of CalculiX, or of the pressure by the area."""

LOWEST = {"friction1": -3.99e-4, "testmortar": -3.573e-4, "contactenergy": -1.142857e-4}
"""Displacements along z of CalculiX with penalties 100 times stiffer, of decks of 8-node hexahedra."""


@pytest.mark.skipif(not DECKS.is_dir(), reason="needs ../shared/decks")
@pytest.mark.parametrize("name", VERTICAL_FORCES)
def test_decks_of_calculix(name):
    solution = read_case(DECKS / f"{name}.inp").problem().solve()
    assert solution.certificate.passed
    assert solution.at_nodes.totals()["force"][2] == pytest.approx(VERTICAL_FORCES[name], rel=1e-4)
    if name in LOWEST:
        assert solution.displacement[:, 2].min() == pytest.approx(LOWEST[name], rel=2e-2)


@pytest.mark.skipif(not DECKS.is_dir(), reason="needs ../shared/decks")
def test_a_loop_of_friction_with_equations():
    """F N to both sides, but for the cosine of the directions in which the block twists a little as one node pulls it;
    CalculiX, with its penalties: -0.8001, 0.8003, -0.8001."""
    case = read_case(DECKS / "fricloop.inp")
    steps = LoadHistory(case.history.ends).steps(case.problem())
    forces = [step.solution.at_nodes.totals()["force"][1] for step in steps]
    assert forces[1:] == pytest.approx([-0.8, 0.8, -0.8], rel=1e-5)


@pytest.mark.skipif(not DECKS.is_dir(), reason="needs ../shared/decks")
def test_the_shear_of_two_cubes_and_a_wrong_assembly():
    problem = read_case(DECKS / "contact5.inp").problem()
    shear = np.array(problem.solve().at_nodes.totals()["force"][:2])
    assert np.allclose(shear, [0.388, 0.776], rtol=2e-2)  # CalculiX with penalties 100 times stiffer
    with pytest.raises(ValueError, match="no part of it is opposite"):  # both cubes at one place
        read_case(DECKS / "unmoved.inp").problem()


def test_summary_of_a_deck_in_steps(tmp_path, monkeypatch):
    """Pressed, then pushed: friction is at its bound in the second step."""
    monkeypatch.chdir(tmp_path)
    text = CUBES.replace("base, 1, 3\ntop, 1, 2", "base, 1, 3")
    text += STEP.format("*DLOAD\n2, P2, 10.\n*BOUNDARY\ntop, 1, 2") + STEP.format("*BOUNDARY\ntop, 1, 1, 0.01")
    Path("deck.inp").write_text(text)
    run_coulomb("run", "deck.inp", "--set", "output.picture=false", "--quiet")
    contents = json.loads(Path("results/deck/steps/0002/summary.json").read_text())
    assert contents["totals"]["force"][0] == pytest.approx(-2.0, rel=1e-6)
