"""[auto_contact] of a case: pairs of faces found by themselves become its contacts."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from case_texts import body
from conftest import run_coulomb
from mesh_files import BoxFile
from mpi4py import MPI
from report_pages import page_without_pictures

from coulomb.case.case import Case, read_case
from coulomb.case.record import case_text

STACK = """
clamp = [{ face = "base:bottom" }]
traction = [{ face = "lid:top", value = [1e6, 0.0, -1e7] }]
output = { picture = false }
[auto_contact]
distance = 1e-4
friction = 0.3
"""
STACK += body("base", (1.2, 0.6, 0.4), (4, 2, 2), young=2.1e11)
STACK += """\
[[body]]
name = "pad"
file = "pad.msh"
translate = [0.2, 0.1, 0.4]
material = { young = 1e10, poisson = 0.3 }
"""
STACK += body("lid", (0.8, 0.4, 0.2), (5, 3, 1), (0.2, 0.1, 0.6), 7e10, 0.33)
"""A pad, whose mesh has no named faces but one, between two boxes."""

BY_HAND = """
contact = [
    { face = "base:top", against = "pad:bottom", friction = 0.3 },
    { face = "pad:top", against = "lid:bottom", friction = 0.3 },
]
"""


@pytest.fixture(autouse=True)
def stack(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pad = BoxFile((0.8, 0.4, 0.2), (3, 2, 1))
    pad.write(Path("named.msh"))
    pad.faces = {"right": pad.faces["right"]}
    pad.write(Path("pad.msh"))
    Path("case.toml").write_text(STACK)


def resolved(*changes):
    return read_case("case.toml", changes).resolved(MPI.COMM_WORLD)


def contacts(*changes):
    """Faces and law of every contact."""
    tables = resolved(*changes).contacts.values()
    return [(one.face, one.against, one.friction) for one in tables]


FOUND = [("base:top", "pad:facing_base", 0.3), ("pad:facing_lid", "lid:bottom", 0.3)]


def test_pairs_become_contacts():
    """Of two steps, no more than once; and the same when the case is read from the results."""
    case = resolved()
    assert contacts() == FOUND and case.resolved(MPI.COMM_WORLD) is case
    assert list(case.contacts) == ["contact.0", "contact.1"]
    assert case.made_faces == ("pad:facing_base", "pad:facing_lid")
    assert [pair.area for _, pair in case.found] == pytest.approx([0.32, 0.32])
    again = Case.model_validate_json(case_text(case))
    assert again.contacts == case.contacts == again.resolved(MPI.COMM_WORLD).contacts


@pytest.mark.parametrize(
    ("pair", "expected"),
    [
        ("{ of = ['pad', 'base'], friction = 0.5 }", [(*FOUND[0][:2], 0.5), FOUND[1]]),
        ("{ of = ['l*', 'pad:facing*'], friction = 'x' }", [FOUND[0], (*FOUND[1][:2], "x")]),
        ("{ of = ['pad', 'base'], leave_out = true }", FOUND[1:]),
        ("{ of = ['*', '*'], friction = 0.1 }, { of = ['lid', 'pad'], friction = 0.2 }",
         [(*FOUND[0][:2], 0.1), (*FOUND[1][:2], 0.2)]),
        ("{ of = ['lid', 'pad'], slave = true }", [FOUND[0], ("lid:bottom", "pad:facing_lid", 0.3)]),
    ],
)  # fmt: skip
def test_some_pairs_differ(pair, expected):
    assert contacts(f"auto_contact.pair=[{pair}]") == expected


def test_keys_of_all_pairs_and_of_some():
    case = resolved("auto_contact.smooth=true", "auto_contact.pair=[{of=['base','pad'], adjust=1e-5, smooth=false}]")
    assert [(one.smooth, one.adjust) for one in case.contacts.values()] == [(False, 1e-5), (True, 0.0)]
    rate = "auto_contact.friction={static=0.3, kinetic=0.2, decay_speed=0.1}"
    assert all(one.friction.kinetic == 0.2 for one in resolved(rate).contacts.values())


def test_what_is_given_is_not_found_again():
    given = "contact=[{face='pad:facing_base', against='base:top', friction=0.7}]"
    assert contacts(given) == [("pad:facing_base", "base:top", 0.7), FOUND[1]]
    assert contacts("tie=[{face='lid:bottom', against='pad:facing_lid'}]") == FOUND[:1]
    alone = "contact={face='base:right', friction=0.7}"
    assert contacts(alone) == [("base:right", None, 0.7), *FOUND]


def test_the_slave_is_chosen_by_hand():
    chosen = {}
    for slave in ("false", "true"):
        pair = f"{{face='base:top', against='pad:facing_base', friction=0.3, slave={slave}}}"
        problem = read_case("case.toml", [f"contact=[{pair}]"]).problem()
        chosen[slave] = (problem.contacts[0].face, problem.body.chosen[0])
    assert chosen["false"][0] == "pad:facing_base" and "finer mesh" in chosen["false"][1]
    assert chosen["true"][0] == "base:top" and "given as the slave" in chosen["true"][1]


def forces(out):
    """Of each contact on its slave, and of every body."""
    summary = json.loads(Path(out, "summary.json").read_text())
    return np.array([*(one["force"] for one in summary["faces"]), *(one["contact_force"] for one in summary["bodies"])])


def test_a_run_is_that_of_the_contacts_given_by_hand():
    """The faces that are made are those that have names in the other file, whole; and files of the run are checked."""
    tight = ("--set", "solver.tolerance=1e-11")
    head, _, bodies = STACK.partition("[auto_contact]")
    by_hand = head + BY_HAND + bodies.partition("friction = 0.3")[2].replace("pad.msh", "named.msh")
    Path("hand.toml").write_text(by_hand)
    run_coulomb("run", "hand.toml", "--output", "hand", *tight)
    for ranks, out in ((2, "ranks"), (None, "auto")):
        done = run_coulomb("run", "case.toml", "--output", out, *tight, ranks=ranks)
        shown = [line for line in done.stdout.splitlines() if line.startswith("found")]
        assert "'base:top' against 'pad:facing_base': 0.32 m^2 face each other, gap 0 m" in shown[0] and len(shown) == 2
        assert np.abs(forces(out) - forces("hand")).max() <= 1e-10 * np.abs(forces("hand")).max()
    done = run_coulomb("check", "ranks")
    assert "files agree" in done.stdout, done.stdout + done.stderr
    run_coulomb("run", "case.toml", "--output", "ranks", *tight)
    other = run_coulomb("run", "case.toml", "--output", "auto", "--keep", "--set", "auto_contact.friction=0.2", code=2)
    assert "auto" in other.stderr, other.stderr


def test_a_load_history_is_continued_with_the_same_pairs():
    steps = "[history]\ntimes = [1.0, 2.0, 3.0]\n"
    traction = "value = [1e6, 0.0, -1e7], amplitude = [[0, 0], [1, 1], [3, 2]] }"
    Path("case.toml").write_text(STACK.replace("value = [1e6, 0.0, -1e7] }", traction) + steps)
    run_coulomb("run", "case.toml", "--output", "whole")
    kept = json.loads(Path("whole/case.json").read_text())
    assert [one["against"] for one in kept["contact"]] == ["pad:facing_base", "lid:bottom"]
    whole = forces("whole/steps/0003")
    shutil.rmtree("whole/steps/0003")
    done = run_coulomb("resume", "whole")
    assert "1 steps in this run" in done.stdout, done.stdout + done.stderr
    assert np.abs(forces("whole/steps/0003") - whole).max() <= 1e-7 * np.abs(whole).max()
    run_coulomb("check", "whole")


def test_pairs_are_printed_as_tables():
    """With which the case is the same; those that are given are not printed."""
    done = run_coulomb("contacts", "case.toml")
    assert "# 'base:top' against 'pad:facing_base': 0.32 m^2 face each other, gap 0 m" in done.stdout
    assert "has made 'pad:facing_base', 'pad:facing_lid' of facets without a name" in done.stdout
    Path("pasted.toml").write_text(f"{STACK}\n{done.stdout}")
    pasted = read_case("pasted.toml")
    assert pasted.contacts == resolved().contacts == pasted.resolved(MPI.COMM_WORLD).contacts
    assert "[[contact]]" in done.stdout and "[[contact]]\n" not in run_coulomb("contacts", "pasted.toml").stdout
    rate = "auto_contact.friction={static='0.3+x', kinetic=0.2, decay_speed=0.1}"
    printed = run_coulomb("contacts", "case.toml", "--set", rate).stdout
    Path("pasted.toml").write_text(f"{STACK}\n{printed}")
    assert [one.friction.static for one in read_case("pasted.toml").contacts.values()] == ["0.3+x"] * 2


def test_components_of_one_mesh_in_several_pairs():
    """Faces by the groups of their cells; neither the end of the run nor the report has a force on all of them."""
    parts = [BoxFile((1.0, 1.0, 0.5), cells) for cells in ((2, 2, 1), (3, 3, 1), (2, 3, 1))]
    first, whole = np.cumsum([0, *(len(part.points) for part in parts)]), parts[0]
    groups = np.split(np.arange(19), np.cumsum([len(part.cells) for part in parts])[:-1])
    faces = {"held": parts[0].faces["bottom"], "pressed": parts[2].faces["top"] + first[2]}
    whole.cells = np.concatenate([part.cells + start for part, start in zip(parts, first, strict=False)])
    above = [part.points + np.array([0.0, 0.0, 0.5001 * k]) for k, part in enumerate(parts)]
    whole.points, whole.faces = np.concatenate(above), faces
    whole.cell_groups = dict(zip(("rubber", "steel", "cork"), groups, strict=True))
    whole.write(Path("three.msh"))
    of = "material=[{cells='rubber', young=1e9, poisson=0.3}, {cells='steel', young=2e11, poisson=0.3}"
    changes = [
        "mesh.file='three.msh'",
        f"{of}, {{cells='cork', young=1e8, poisson=0.1}}]",
        "clamp=[{face='held'}]",
        "pressure=[{face='pressed', value=1e5}]",
        "auto_contact={distance=1e-3, friction=0.3, pair=[{of=['st*', 'rubber'], friction=0.6}]}",
        "output.picture=false",
    ]
    Path("case.toml").write_text("")
    done = run_coulomb("run", "case.toml", "--output", "out", *(word for one in changes for word in ("--set", one)))
    normal = dict(re.findall(r"(\w+): normal ([\d.]+ \w+), friction", done.stdout))
    assert normal == {"steel_facing_rubber": "100 kN", "cork_facing_steel": "100 kN"}
    assert "Coulomb friction 0.6" in next(
        line for line in done.stdout.splitlines() if "contact  'steel_facing_rubber" in line
    )
    assert "normal force of cork_facing_steel" in page_without_pictures("out")
    run_coulomb("check", "out")


def test_it_may_be_the_only_contact_or_none():
    assert "contact: is missing" in said("auto_contact")
    assert "friction" in said("friction = 0.3")


def said(line):
    """The message about the case without a line or table."""
    text = STACK.replace("[auto_contact]\ndistance = 1e-4\nfriction = 0.3\n", "") if line == "auto_contact" else ""
    Path("case.toml").write_text(text or STACK.replace(f"{line}\n", ""))
    with pytest.raises(ValueError) as fault:
        read_case("case.toml")
    return str(fault.value)
