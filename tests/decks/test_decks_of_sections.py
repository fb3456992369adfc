"""Decks of elements in 2D: CAX, CPE and CPS become slices."""

from pathlib import Path

import numpy as np
import pytest
from conftest import run_coulomb
from test_decks_run import blocks_of

import coulomb
from coulomb.case.case import read_case

E, NU = 210000.0, 0.3

DECK = """*NODE
1, 0., 0.
2, 1., 0.
3, 1., 1.
4, 0., 1.
5, .5, 0.
6, 1., .5
7, .5, 1.
8, 0., .5
11, 0., 1.
12, 1., 1.
13, 1., 2.
14, 0., 2.
15, .5, 1.
16, 1., 1.5
17, .5, 2.
18, 0., 1.5
*ELEMENT, TYPE={kind}, ELSET=LOW
{low}
*ELEMENT, TYPE={kind}R, ELSET=UP
{up}
*NSET, NSET=BOTTOM
1, 2, 5
*NSET, NSET=LEFT
1, 4, 8, 11, 14, 18
*NSET, NSET=CORNERS
13, 14
*NSET, NSET=MIDDLE
17
*SURFACE, NAME=SLAVE
{slave}, S1
*SURFACE, NAME=MASTER
{master}, {side}
*MATERIAL, NAME=STEEL
*ELASTIC
210000., 0.3
*SOLID SECTION, ELSET=LOW, MATERIAL=STEEL
{thickness}
*SOLID SECTION, ELSET=UP, MATERIAL=STEEL
{thickness}
*SURFACE INTERACTION, NAME=I
*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD
*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE
SLAVE, MASTER
*BOUNDARY
BOTTOM, 2, 2
LEFT, 1, 1
*STEP
*STATIC
{load}
*END STEP
"""
PRESSURE = "*DLOAD\n{}, P3, 10."
QUADS = {"4": ("1, 1,2,3,4", "2, 11,12,13,14"), "8": ("1, 1,2,3,4,5,6,7,8", "2, 11,12,13,14,15,16,17,18")}
TRIANGLES = {"3": ("1, 1,2,3\n3, 3,4,1", "2, 11,12,13\n4, 13,14,11")}


def answer_of(tmp_path, kind, thickness="", load=PRESSURE):
    low, up = {**QUADS, **TRIANGLES}[kind[-1]]
    top = "4" if kind[-1] == "3" else "2"
    load = load.format(top).replace("P3", "P1" if kind[-1] == "3" else "P3")
    path = tmp_path / "deck.inp"
    path.write_text(
        DECK.format(
            kind=kind,
            low=low,
            up=up,
            slave="2",
            master="3" if kind[-1] == "3" else "1",
            side="S1" if kind[-1] == "3" else "S3",
            thickness=thickness,
            load=load,
        )
    )
    case = read_case(path)
    problem = case.problem()
    return case, problem, problem.solve()


@pytest.mark.parametrize(
    ("kind", "thickness", "area", "modulus"),
    [
        ("CAX4", "", np.pi, E),
        ("CAX8", "", np.pi, E),
        ("CAX3", "", np.pi, E),
        ("CPE8", "0.5", 0.5, E / (1 - NU**2)),
        ("CPS4", "0.25", 0.25, E),
    ],
)
def test_two_blocks_under_pressure(tmp_path, kind, thickness, area, modulus):
    _, problem, answer = answer_of(tmp_path, kind, thickness)
    assert answer.valid
    assert answer.forces["normal_force"] == pytest.approx(10.0 * area, rel=1e-5)
    # second-order nodes on the axis are no contact points, and others take their part
    assert answer.at_nodes.pressure == pytest.approx(10.0, rel=3e-4 if kind == "CAX8" else 2e-5)
    top = problem.elasticity.x[:, 1] > 1.999
    assert answer.displacement[top, 1] == pytest.approx(-2.0 * 10.0 / modulus, rel=2e-5)


@pytest.mark.parametrize(
    ("kind", "thickness", "area", "side", "down"),
    [
        ("CAX4", "", np.pi, NU / E, 1.0 / E),
        ("CAX8", "", np.pi, NU / E, 1.0 / E),
        ("CAX3", "", np.pi, NU / E, 1.0 / E),
        ("CPE8", "0.5", 0.5, NU * (1 + NU) / E, (1 - NU**2) / E),
    ],
)
def test_results_are_those_of_the_section(tmp_path, monkeypatch, kind, thickness, area, side, down):
    """results.frd has the deck's nodes and elements in their plane, in uniform stress; forces of 360 degrees or of the
    thickness."""
    answer_of(tmp_path, kind, thickness)
    monkeypatch.chdir(tmp_path)
    run_coulomb("run", "deck.inp", "--quiet", "--set", "output.picture=false")
    text = Path("results/deck/results.frd").read_text()
    blocks, nodes = blocks_of(Path("results/deck/results.frd")), text.partition("    2C")[2].partition("\n -3")[0]
    rows = [line for line in nodes.splitlines() if line.startswith(" -1")]
    x = {int(line[3:13]): [float(line[k : k + 12]) for k in range(13, 49, 12)] for line in rows}
    given = {int(n) for n in (line.split(",")[0] for line in DECK.splitlines()[1:17])}
    corners = {n for n in given if n % 10 < 5}
    assert (given if kind[-1] == "8" else corners) <= x.keys()
    if kind[-1] != "3":  # triangles are cut into quadrilaterals
        assert len(x) == (16 if kind[-1] == "8" else 8)
        assert f" -1{1:10d}{10 if kind[-1] == '8' else 9:5d}" in text
    expected = np.array([[10.0 * side * r, -10.0 * down * y, 0.0] for r, y, _ in x.values()])
    assert np.all(np.array(list(x.values()))[:, 2] == 0.0)
    assert np.allclose(list(blocks["DISP"].values()), expected, rtol=0.0, atol=2e-4 * np.abs(expected).max())
    assert np.sum(list(blocks["FORC"].values()), axis=0)[1] == pytest.approx(10.0 * area, rel=1e-4)


def test_loads_at_nodes_are_those_of_360_degrees(tmp_path):
    """Of CAX8 the nodes of an edge on the axis have 0, 2/3 and 1/3 of a uniform pressure: r dr from 0 to 1."""
    load = "*CLOAD\n17, 2, -60.\n13, 2, -30."
    case, _, answer = answer_of(tmp_path, "CAX8", load=load)
    assert answer.forces["normal_force"] == pytest.approx(90.0, rel=1e-6)
    assert answer.at_nodes.pressure == pytest.approx(90.0 / np.pi, rel=3e-4)
    assert "axisymmetric: concentrated loads and totals are for 360 degrees" in case.deck.notes


def test_a_section_is_no_mesh_of_a_volume(tmp_path):
    path = tmp_path / "deck.inp"
    path.write_text(
        DECK.format(
            kind="CPE4", low=QUADS["4"][0], up=QUADS["4"][1], slave=2, master=1, side="S3", thickness=1, load=""
        )
    )
    with pytest.raises(ValueError, match="2 surface elements, but no solid ones: for a plane or axisymmetric problem"):
        coulomb.read_mesh(path)
    mesh = coulomb.slice(path, "plane strain", only="LOW")
    assert mesh.domain.topology.index_map(3).size_global == 1 and {"MASTER", "LEFT", "BOTTOM"} <= {*mesh.faces}


def test_elements_of_generalised_plane_strain_are_refused_with_the_slice(tmp_path):
    with pytest.raises(ValueError, match=r"type CPEG4: their front may turn.*generalised plane strain"):
        answer_of(tmp_path, "CPEG4")
