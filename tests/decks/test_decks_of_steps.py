"""What goes on, and what ends, from step to step: amplitudes in total time, and reference nodes."""

import numpy as np
import pytest
from test_deck_tables import CUBES, STEP, tables_of

from coulomb.case.case import read_case
from coulomb.decks.steps import value_at


def steps(*texts):
    return "".join(STEP.format(text) for text in texts)


COUPLED = CUBES.replace("top, 1, 2\n", "900, 1, 2\n900, 4, 6\n") + (
    "*NODE\n900, .5, .5, 3\n*SURFACE, NAME=head\n2, S2\n"
    "*COUPLING, REF NODE=900, SURFACE=head, CONSTRAINT NAME=c\n*KINEMATIC\n1, 3\n"
)


def test_an_amplitude_in_total_time_goes_on(tmp_path):
    """It is followed in steps that do not give the load again, and with OP=NEW it is gone at once (CalculiX 2.20:
    normal forces of 15, 30 and 24 times the face at 1, 2 and 3 s)."""
    curve = "*AMPLITUDE, NAME=a, TIME=TOTAL TIME\n0., 0., 1., .5, 2., 1., 3., .8\n"
    first, other = "*DLOAD, AMPLITUDE=a\n2, P2, 30.\n", "*CLOAD\n15, 3, -1."
    (load,) = tables_of(tmp_path, CUBES + curve + steps(first, other, other)).tables["pressure"]
    rows = tuple(map(tuple, load["amplitude"]))
    assert [load["value"] * value_at(rows, time) for time in (0.5, 1.0, 1.5, 3.0)] == [7.5, 15.0, 22.5, 24.0]
    ended = tables_of(tmp_path, CUBES + curve + steps(first, "*DLOAD, OP=NEW\n1, P3, 0.", other))
    rows = tuple(map(tuple, ended.tables["pressure"][0]["amplitude"]))
    assert np.allclose([value_at(rows, time) for time in (1.0, 1.001, 3.0)], [1.0, 0.0, 0.0])


@pytest.mark.parametrize("period", [1.0, 1e-8])
def test_a_jump_of_an_amplitude_is_kept(period, tmp_path):
    """Two rows of one time: what is before the jump was lost; in short steps so was what is after one."""
    rows = np.array([[0.0, 0.0], [0.5, 1.0], [0.5, 0.2], [1.0, 0.2]]) * (period, 1.0)
    curve = "*AMPLITUDE, NAME=a\n" + ", ".join(map(repr, rows.ravel().tolist())) + "\n"
    one = f"*STEP\n*STATIC\n1., {period!r}\n*DLOAD, AMPLITUDE=a\n2, P2, 30.\n*END STEP\n"
    other = one.replace("*STEP", "*STEP, AMPLITUDE=STEP", 1).replace(", AMPLITUDE=a\n2, P2, 30.", "\n2, P2, 90.")
    tables = tables_of(tmp_path, CUBES + curve + one + other).tables
    (load,) = tables["pressure"]
    at = [
        load["value"] * value_at(tuple(map(tuple, load["amplitude"])), time * period) for time in (0.5, 0.51, 1, 1.1, 2)
    ]
    assert np.allclose(at, [30.0, 6.0, 6.0, 90.0, 90.0])
    assert np.allclose(tables["history"]["times"], np.array([0.5, 1.0, 2.0]) * period)
    with pytest.raises(ValueError, match=r"line \d+: \*AMPLITUDE: times must not go back"):
        tables_of(tmp_path, CUBES + "*AMPLITUDE, NAME=a\n0., 0., 1., 1., .5, 0.\n" + one)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("*CHANGE FRICTION, INTERACTION=s\n*FRICTION\n.1", r"\*CHANGE FRICTION: there is no .* 's'; .* 'SI'"),
        ("*CHANGE SURFACE BEHAVIOR, INTERACTION=s\n*SURFACE BEHAVIOR", "there is no .* 's'; .* 'SI'"),
        ("*CHANGE FRICTION, INTERACTION=si, RESET", "is read with INTERACTION alone"),
        ("*CHANGE FRICTION, INTERACTION=si\n*FRICTION, TAUMAX=1.\n.2", "another TAUMAX than before"),
        ("*CONTACT INTERFERENCE\nslave, master, .1", "is read with SHRINK alone, in the first step"),
        ("*FRICTION\n.1", r"\*FRICTION: stands in a step, but below no \*CHANGE card"),
        ("*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE\nmaster, slave", "no contact pair of master, slave; .* other way"),
        ("*MODEL CHANGE, TYPE=CONTACT PAIR, REMOVE\nslave, mister", "no contact pair of slave, mister$"),
        ("*BOUNDARY\ntop, 2, 1", "no degrees of freedom from 2 to 1"),
        ("*CLOAD\n99, 3, -1.", r"\*CLOAD: node 99 is not defined"),
    ],
)
def test_a_change_of_what_is_not_there_is_refused(wrong, said, tmp_path):
    """It was left out without a word."""
    with pytest.raises(ValueError, match=rf"deck.inp: line \d+: .*{said}"):
        tables_of(tmp_path, CUBES + steps("*CLOAD\ntop, 3, -1.", wrong))


def test_reference_nodes_move_by_components_in_their_own_time(tmp_path):
    """Down in the first step, to the side in the second, turned in the third."""
    moves = ("*BOUNDARY\n900, 3, 3, -1e-3", "*BOUNDARY\n900, 1, 1, 2e-3", "*BOUNDARY\n900, 6, 6, 1e-3")
    (face,) = tables_of(tmp_path, COUPLED + steps(*moves)).tables["rigid_face"]
    assert face["translation"] == {"x": 2e-3, "y": 0.0, "z": -1e-3}
    assert face["rotation"] == {"x": 0.0, "y": 0.0, "z": 1e-3}
    timed = {key.removesuffix("_amplitude"): face[key] for key in face if key.endswith("_amplitude")}
    assert timed == {
        "translation_x": [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]],
        "translation_z": [[0.0, 0.0], [1.0, 1.0]],
        "rotation_z": [[0.0, 0.0], [2.0, 0.0], [3.0, 1.0]],
    }


def test_new_loads_end_those_at_reference_nodes(tmp_path):
    """In the course of the step, as those at other nodes; a support that ends there is refused."""
    loads = "*CLOAD\n900, 3, -100.", "*CLOAD, OP=NEW\n900, 1, 5."
    forces = tables_of(tmp_path, COUPLED.replace("900, 1, 2\n", "") + steps(*loads)).tables["point_load"]
    assert [(one["force"], one["amplitude"]) for one in forces] == [
        ([0.0, 0.0, -100.0], [[0.0, -0.0], [1.0, 1.0], [2.0, -0.0]]),
        ([5.0, 0.0, 0.0], [[1.0, 0.0], [2.0, 1.0]]),
    ]
    with pytest.raises(ValueError, match="degree of freedom 1 of a reference node is held until 1"):
        tables_of(tmp_path, COUPLED + steps(loads[0], "*BOUNDARY, OP=NEW\nbase, 1, 3"))
    model = COUPLED + STEP.format("*BOUNDARY, OP=NEW\nbase, 1, 3\n900, 1, 3\n*CLOAD\n15, 3, -1.")
    assert tables_of(tmp_path, model).tables["rigid_face"][0].get("rotation") is None


BODIES = {"ELSET=upper": "*ELSET, ELSET=upper\n2\n", "NSET=above": "*NSET, NSET=above, GENERATE\n11, 18\n"}


@pytest.mark.parametrize("which", BODIES)
def test_a_body_that_is_rigid_as_a_whole(which, tmp_path):
    """Its surface is: all its nodes move with the reference node; a set of some of its elements is refused."""
    text = CUBES.replace("top, 1, 2", "900, 1, 3, 0.").replace("*FRICTION\n.2, 1.E6\n", "") + "*NODE\n900, .5, .5, 3\n"
    text += f"{BODIES[which]}*RIGID BODY, {which}, REF NODE=900, ROT NODE=901\n*NODE\n901, .5, .5, 3\n"
    found = tables_of(tmp_path, text + STEP.format("*BOUNDARY\n900, 3, 3, -1e-4\n901, 1, 3"))
    assert found.tables["rigid_face"][0]["face"] == which.partition("=")[2] + " skin"
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    u = solution.displacement.reshape(-1, 3)
    assert solution.valid and np.sum(np.all(np.abs(u - [0.0, 0.0, -1e-4]) < 1e-16, axis=1)) >= 8
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(-solution.rigid_faces[0].force[2], rel=1e-9)
    with pytest.raises(ValueError, match="elements outside of it share nodes with it"):
        joined = text.replace("2, 11, 12, 13, 14, 15", "2, 5, 6, 7, 8, 15")
        joined = joined.replace(f"BODY, {which}", "BODY, ELSET=upper").replace(
            "*RIGID", f"{BODIES['ELSET=upper']}*RIGID"
        )
        tables_of(tmp_path, joined + STEP.format("*CLOAD\n900, 3, -1."))


def test_what_is_loaded_twice_by_a_set_is_refused(tmp_path):
    """CalculiX 2.20 puts a load twice on nodes and sides that a set has twice, Abaqus once; and a set with nothing in
    it was loaded without a word, as one of the nodes of elements, which Abaqus reads."""
    load = STEP.format("*CLOAD\ntwice, 3, -1.\n*DLOAD\nit, P2, 1.")
    for wrong, said in (
        ("*NSET, NSET=twice\n15, 16, 15\n*ELSET, ELSET=it\n2\n", "\\*CLOAD: 'twice' has 15 twice"),
        ("*NSET, NSET=twice\n15\n*ELSET, ELSET=it\n2\n*ELSET, ELSET=it\n2\n", "\\*DLOAD: 'it' has 2 twice"),
        ("*NSET, NSET=twice\n*ELSET, ELSET=it\n2\n", "\\*CLOAD: the node set 'twice' is empty"),
    ):
        with pytest.raises(ValueError, match=rf"deck.inp: line \d+: {said}"):
            tables_of(tmp_path, CUBES + wrong + load)
    once = "*ELSET, ELSET=it\n2\n*NSET, NSET=twice, ELSET=it\n"
    (*forces,) = tables_of(tmp_path, CUBES + once + load).tables["nodal_force"]
    assert {tuple(one["force"]) for one in forces} == {(0.0, 0.0, -1.0)}
    assert sum(len({"top": range(4)}.get(str(one["nodes"]), one["nodes"])) for one in forces) == 8


def test_forces_of_single_nodes_are_one_load(tmp_path):
    """A force for each of many nodes, as of a pressure: more than 1000 cards were refused."""
    cards = "".join(f"{node}, {dof}, {node + 100 * dof}.\n" for node in (*range(11, 19), 11) for dof in (1, 3))
    once = tables_of(tmp_path, CUBES + STEP.format("*CLOAD\n" + cards)).tables["nodal_force"]
    (forces,) = once
    assert forces["nodes"] == list(range(11, 19)) and "amplitude" not in forces
    again = [2.0 if node == 11 else 1.0 for node in forces["nodes"]]
    expected = [[a * (node + 100), 0.0, a * (node + 300)] for node, a in zip(forces["nodes"], again, strict=True)]
    assert forces["force"] == expected


GROUND = "*NODE\n91, 0, 0, 3\n*ELEMENT, TYPE=SPRING2, ELSET=s\n101, 15, 91\n*SPRING, ELSET=s\n3, 3\n9.\n"


@pytest.mark.parametrize(
    ("model", "step", "said"),
    [
        (GROUND, "*BOUNDARY\n91, 3, 3, -.1", r"\*BOUNDARY: node 91 is of no solid element, and nothing .* follows it"),
        (GROUND, "*CLOAD\n91, 3, -.1", r"\*CLOAD: node 91 is of no solid element, and nothing .* follows it"),
        (GROUND, "*BOUNDARY\n91, 1, 2", r"\*SPRING: node 91 of a spring is of no solid element, and not held"),
        ("*TRANSFORM, NSET=top, TYPE=S\n0, 0, 0, 1, 0, 1\n", "*BOUNDARY\ntop, 1, 1", "TYPE=S is not read, R and C"),
    ],
)
def test_nodes_that_nothing_follows(model, step, said, tmp_path):
    """The far end of a spring was the ground, wherever it went (CalculiX 2.20: it pulls)."""
    load = "*CLOAD\ntop, 3, -1.\n"
    with pytest.raises(ValueError, match=rf"deck.inp: line \d+: .*{said}"):
        tables_of(tmp_path, CUBES + model + STEP.format(load + step))
    held = tables_of(tmp_path, CUBES + GROUND + STEP.format(load + "*BOUNDARY\n91, 3"))
    assert held.tables["spring"] == [{"nodes": [15], "stiffness": [0.0, 0.0, 9.0]}]


def test_an_overlap_that_shrinks_is_an_interference(tmp_path):
    """Cubes of 1 mm that overlap by 1 um between clamped ends: each is shortened by half of it, without sideways
    strain, as Poisson's ratio is 0: a pressure of E times 0.001 over 2.001."""
    deck = CUBES.replace("210000., .3", "210000., 0.").replace("top, 1, 2", "top, 1, 3")
    for corner in (11, 12, 13, 14):
        place = next(line for line in deck.splitlines() if line.startswith(f"{corner}, "))
        deck = deck.replace(place, place.removesuffix("1") + ".999", 1)
    shrinking = deck + STEP.format("*CONTACT INTERFERENCE, SHRINK\nslave, master")
    assert any("press each other apart" in note for note in tables_of(tmp_path, shrinking).notes)
    (tmp_path / "deck.inp").write_text(shrinking)
    solution = read_case(tmp_path / "deck.inp").problem().solve()
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(210000.0 * 0.001 / 2.001, rel=1e-6)
    with pytest.raises(ValueError, match=r"line \d+: .* in the first step, at whose end it has gone"):
        tables_of(tmp_path, deck + STEP.format("") + STEP.format("*CONTACT INTERFERENCE, SHRINK\nslave, master"))


@pytest.mark.parametrize(
    ("values", "said"),
    [((70.0,), ""), ((70.0, 70.0), ""), ((120.0, 70.0), "the end, 70"), ((120.0, 20.0), "the end, 20")],
)
def test_constants_by_temperature_are_those_of_one(values, said, tmp_path):
    """The run says so where load steps have other temperatures: their answers are those of other moduli."""
    own = "*ELASTIC\n1000., .3, 20.\n2000., .3, 120.\n*EXPANSION, ZERO=20.\n1.e-5\n"
    text = CUBES.replace("*ELASTIC\n210000., .3\n", own) + "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nall, 20.\n"
    found = tables_of(tmp_path, text + steps(*(f"*TEMPERATURE\nall, {value}" for value in values)))
    assert found.tables["material"]["young"] == 1000.0 + 10.0 * (values[-1] - 20.0)
    assert [note.split("those of ")[1] for note in found.notes if "by temperature" in note] == (
        [f"{said}, in all load steps"] if said else []
    )


def test_a_load_that_goes_up_and_down(tmp_path):
    """Abaqus' PERIODIC: A0 + A1 cos + B1 sin, at the time of the step; load steps end at its extremes."""
    curve = f"*AMPLITUDE, NAME=a, DEFINITION=PERIODIC\n1, {2.0 * np.pi:.16g}, 0., .5\n.3, .4\n"
    loaded = CUBES + curve + STEP.format("*CLOAD, AMPLITUDE=a\ntop, 3, -1.")
    tables = tables_of(tmp_path, loaded).tables
    (force,) = tables["nodal_force"]
    rows = np.array(force["amplitude"])
    t, own = rows[:, 0], rows[:, 1] * force["force"][2]
    assert np.allclose(own, -(0.5 + 0.3 * np.cos(2.0 * np.pi * t) + 0.4 * np.sin(2.0 * np.pi * t)), atol=1e-12)
    assert t[-1] == 1.0 and len(t) == 41
    peak = np.arctan2(0.4, 0.3) / (2.0 * np.pi)
    assert tables["history"]["times"] == pytest.approx([peak, peak + 0.5, 1.0], abs=0.5 / 40.0)
    for wrong, said in (
        (curve.replace(".3, .4", ".3"), "N pairs of coefficients"),
        (curve.replace("1, 6", "1, -6"), "N pairs of coefficients"),
        (curve.replace("1, 6.", "1, 6000."), "955 of its shortest periods in a step"),
    ):
        with pytest.raises(ValueError, match=rf"deck.inp: line \d+: \*AMPLITUDE: .*{said}"):
            tables_of(tmp_path, loaded.replace(curve, wrong))
