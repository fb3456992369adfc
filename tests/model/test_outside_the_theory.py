"""Answers outside the theory although the equations are solved: exit code, terminal, summary, report.

Conversely, a failed certificate is not overruled by a solver that has converged.
"""

import csv
import html
import json
import logging
import re
from dataclasses import replace

import numpy as np
import pytest
import typer.testing
from conftest import ROOT, STEEL, make_block
from report_pages import page_without_pictures
from sections import rectangle, write

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, PrescribedDisplacement, Sphere
from coulomb.cli import app as cli
from coulomb.fem.contact.body_boundary import depths_below, in_tetrahedra
from coulomb.linalg.reductions import Reductions
from coulomb.model import load_history, stopping_criterion
from coulomb.model.certificate_scales import deformations
from coulomb.model.small_strain import CHORD, GAP_ERROR, GRADIENT, TURN, SmallStrain, known_mode
from coulomb.model.state import Energy

BLOCK, HISTORY, HERTZ = (
    *(ROOT / "demos" / name for name in ("block.toml", "history.toml")),
    ROOT / "coulomb" / "templates" / "hertz.toml",
)
SMALL = {BLOCK: "mesh.cells=[12,4,4]", HISTORY: "mesh.cells=[4,4,2]", HERTZ: "mesh.cells=[8,8,4]"}
INSIDE = "contact.foundation={shape='plane', point=[0,0,0], normal=[-0.5,0,1]}"


def run(target, case, *changes, more=()):
    """Exit code, standard output and standard error of a run in this process."""
    sets = [part for change in (SMALL[case], "output.picture=false", *changes) for part in ("--set", change)]
    done = invoke("run", case, *sets, "--output", target, *more)
    return done.exit_code, done.stdout, done.stderr


def invoke(*arguments):
    done = typer.testing.CliRunner().invoke(cli.app, list(map(str, arguments)))
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


def summary_of(directory):
    return json.loads((directory / "summary.json").read_text())


def words_of(directory):
    """The text of the report, and the class of its header."""
    text = page_without_pictures(directory)
    body = re.sub(r"<(style|script|svg).*?</\1>", " ", text, flags=re.DOTALL)
    words = re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " ", body)))
    return words, re.search(r'<header class="(\w+)">', text).group(1)


ABSURD = [
    (BLOCK, "material.young=210.0"),  # GPa, given as Pa
    (BLOCK, INSIDE),
    (HERTZ, "prescribed_displacement.0.value=[1.0,0,-0.0001]"),  # away from where gaps and normals were evaluated
    (HERTZ, "contact.foundation.centre=[0.02,0.02,-0.15]"),
]


@pytest.mark.parametrize(("case", "change"), ABSURD, ids=[change for _, change in ABSURD])
def test_answers_with_huge_strains_do_not_count(tmp_path, case, change):
    code, said, complaint = run(tmp_path, case, change)
    contents = summary_of(tmp_path)
    assert code == 1 and "certificate passed" in said
    assert re.search(r'error: outside the theory: .* small_strain = "warn" in the case', complaint)
    assert complaint.count("outside the theory") == 1 and "small-strain theory" not in complaint  # the library's words
    assert contents["certificate"]["passed"] and not contents["valid"] and contents["small_strain"]["violations"]
    words, kind = words_of(tmp_path)
    assert kind == "failed" and re.search(r"OUTSIDE THE THEORY All \d+ conditions hold", words)
    assert "do not describe the behaviour of the body" in words


@pytest.mark.parametrize("how", ["case", "force"])
def test_small_strain_warn_accepts_the_answer(tmp_path, how):
    if how == "case":
        code, _, complaint = run(tmp_path, BLOCK, "material.young=210.0", "small_strain='warn'")
    else:
        code, _, complaint = run(tmp_path, BLOCK, "material.young=210.0", more=("--force",))
    contents = summary_of(tmp_path)
    assert code == 0 and "warning: displacement gradients reach" in complaint and "error" not in complaint
    assert contents["valid"] and contents["small_strain"]["violations"] and contents["small_strain"]["accepted"]
    words, kind = words_of(tmp_path)
    assert kind == "passed" and "Warning displacement gradients reach" in words and "OUTSIDE" not in words


@pytest.mark.parametrize(
    ("case", "changes"),
    [
        (HERTZ, ("prescribed_displacement.0.value=[0,0,-0.001]",)),
        (HISTORY, ("prescribed_displacement.0.value=[0,0,-0.004]", "history={times=[1.0, 2.0]}")),
    ],
)
def test_rubber_at_a_tenth_is_a_warning(tmp_path, case, changes):
    code, _, complaint = run(tmp_path, case, *changes)
    contents = summary_of(tmp_path)
    assert code == 0 and "displacement gradients reach" in complaint and "error" not in complaint and contents["valid"]
    gradient = contents.get("last", contents)["small_strain"]["gradient"]
    assert GRADIENT.warn < 0.06 < gradient < 0.15 < GRADIENT.refuse
    assert words_of(tmp_path)[1] == "passed"


def test_every_step_of_a_history_counts(tmp_path):
    """The plate goes down by half the height in the middle of the history, and back."""
    table = "prescribed_displacement.0.amplitude=[[0,0], [1,1], [2,50], [3,1]]"
    code, said, complaint = run(tmp_path, HISTORY, table, "history={times=[1.0, 2.0, 3.0]}")
    contents = summary_of(tmp_path)
    assert code == 1 and contents["certificate"]["passed"] and contents["history"]["certified_steps"] == 3
    assert not contents["valid"] and contents["last"]["valid"] and contents["history"]["outside"]["steps"] == 1
    assert contents["history"]["valid_steps"] == 2
    assert "1 of 3 load steps, the first is step 2: displacement gradients reach" in complaint
    assert said.count("OUTSIDE THE THEORY") == 1
    assert said.splitlines()[-1] == "all 3 load steps certified, 1 outside the theory"
    with (tmp_path / "history.csv").open() as file:
        assert [row["valid"] for row in csv.DictReader(file)] == ["True", "False", "True"]
    words, kind = words_of(tmp_path)
    assert kind == "failed" and "OUTSIDE THE THEORY" in words and "first is step 2" in words
    assert invoke("resume", tmp_path).exit_code == 1  # no steps remain, and the result is the same
    assert invoke("resume", tmp_path, "--force").exit_code == 1  # the written steps were not accepted


def with_failing_certificates(monkeypatch):
    """The next certificates fail in one condition; the solver's status is unchanged."""
    honest = load_history.judge

    def judge(*arguments):
        certificate = honest(*arguments)
        first, *others = certificate.checks
        return replace(certificate, checks=(replace(first, value=2.0 * first.limit), *others))

    for module in (stopping_criterion, load_history):
        monkeypatch.setattr(module, "judge", judge)


LOOSE = "solver.tolerance=1e-7"  # the solver does not ask for the certificate


def test_a_converged_run_without_its_certificate_exits_1(tmp_path, monkeypatch):
    assert run(tmp_path, BLOCK, LOOSE)[0] == 0
    with_failing_certificates(monkeypatch)
    code, said, complaint = run(tmp_path, BLOCK, LOOSE)
    contents = summary_of(tmp_path)
    assert code == 1 and "converged" in said and "certificate FAILED" in said and "error" not in complaint
    assert "warning: the tolerance 1e-07 is reached, but these conditions fail: " in complaint
    assert contents["status"] == "converged" and not contents["certificate"]["passed"] and not contents["valid"]
    words, kind = words_of(tmp_path)
    assert kind == "failed" and "NOT CERTIFIED 1 of" in words


def test_a_converged_history_without_its_certificates_exits_1(tmp_path, monkeypatch):
    changes = ("history={times=[0.5, 1.0]}", LOOSE)
    assert run(tmp_path / "good", HISTORY, *changes)[0] == 0
    with_failing_certificates(monkeypatch)
    code, said, complaint = run(tmp_path / "bad", HISTORY, *changes)
    assert code == 1 and said.count("certificate FAILED") == 2 and "error" not in complaint
    assert said.splitlines()[-1] == "0 of 2 load steps certified"
    contents = summary_of(tmp_path / "bad")
    assert contents["last"]["status"] == "converged" and not contents["certificate"]["passed"] and not contents["valid"]
    assert contents["history"]["certified_steps"] == 0
    assert words_of(tmp_path / "bad")[1] == "failed"


def test_python_returns_the_answer_and_logs_the_warning(caplog):
    inside = coulomb.Plane((0.0, 0.0, 0.0), (-0.5, 0.0, 1.0))  # from the clamped edge on
    problem = make_block(3, foundation=inside)
    with caplog.at_level(logging.INFO, "coulomb"):
        answer = problem.solve()
    assert answer.certificate.passed and not answer.valid and answer.outside == answer.small_strain.violations != ()
    assert [(r.levelname, r.message.split(":")[0]) for r in caplog.records] == [("WARNING", "outside the theory")]
    accepted = make_block(3, foundation=inside, small_strain="warn").solve()
    assert accepted.valid and accepted.outside == () and accepted.small_strain.violations
    assert make_block(3).solve().valid
    with pytest.raises(ValueError, match="small_strain must be 'enforce' or 'warn', but is 'ignore'"):
        known_mode("ignore")


@pytest.mark.parametrize(
    ("name", "bound"),
    [("gap_error", GAP_ERROR), ("turn", TURN), ("gradient", GRADIENT), ("chord", CHORD)],
    ids=lambda v: str(v)[:9],
)
def test_a_measure_just_inside_and_just_outside(name, bound):
    quiet = SmallStrain(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert not quiet.warnings and not quiet.violations
    for value, warnings, violations in (
        (0.999 * bound.warn, 0, 0),
        (1.001 * bound.warn, 1, 0),
        (0.999 * bound.refuse, 1, 0),
        (1.001 * bound.refuse, 1, 1),
        (np.inf, 1, 1),
        (np.nan, 1, 1),  # nan is not small
    ):
        strain = replace(quiet, **{name: value})
        assert (len(strain.warnings), len(strain.violations)) == (warnings, violations)
        assert len(strain.mere_warnings) == warnings - violations
    assert 3.0 * bound.warn < bound.refuse


def test_a_foundation_that_ends_where_the_body_goes_is_outside():
    """The foundation's function is undefined there: no crash, and the measures are not small."""

    def distance(x):
        if np.any(x[0] > 3.3):
            raise ArithmeticError("the table ends")
        return x[2] + 1e-9 * x[0] ** 2

    foundation = coulomb.SignedDistance(distance)
    problem = make_block(3, foundation=foundation)
    assert problem.solve().valid
    dragged = ContactProblem(
        problem.mesh, STEEL, [PrescribedDisplacement("left", (0.5, 0.0, 0.0))],
        Contact("bottom", 0.3, foundation=foundation),
        [coulomb.Traction("top", (0.0, 0.0, -4e7))],
    ).solve()  # fmt: skip
    assert dragged.certificate.passed and not dragged.valid and np.isnan(dragged.small_strain.gap_error)


def test_a_foundation_that_moves_past_takes_its_normals_along():
    """A ball rolls along the body by many cells: normals are those at its present position, and the answer is valid."""
    ball = Sphere((0.2, 0.1, -15.0), 15.0)
    mesh = coulomb.box((0.4, 0.2, 0.1), (16, 8, 4))
    contact = Contact("bottom", 0.1, foundation=ball, motion=[(0, 0, 0, 0), (1, 0, 0, 2e-4), (3, 0.1, 0, 2e-4)])
    problem = ContactProblem(mesh, STEEL, [Clamp("top")], contact)
    for step in LoadHistory([1.0, 2.0, 3.0]).steps(problem):
        answer, strain = step.solution, step.solution.small_strain
        surface = answer.problem.surface
        pressing = answer.contact_force[0::3] > 1e-6 * answer.contact_force.max()
        along = surface.components(answer.displacement[surface.nodes])[pressing, 1:]
        expected = np.max(np.linalg.norm(along, axis=1) / np.sqrt(surface.area[pressing]))
        assert strain.slip_over_cell == pytest.approx(expected, rel=1e-9) and not strain.warnings
    assert answer.problem.motions[0, 0] == 0.1  # four cells


@pytest.mark.parametrize(
    ("case", "changes"),
    [
        (BLOCK, ("contact.foundation={shape='plane', point=[0,0,-1.0], normal=[0,0,1]}",)),
        (HISTORY, ("prescribed_displacement.0.value=[0,0,0.001]", "history={times=[1.0, 2.0]}")),
    ],
)
def test_nothing_touches(tmp_path, case, changes):
    code, _, complaint = run(tmp_path, case, *changes)
    assert code == 0 and complaint.count("warning: nothing touches") == 1 and "(scale)" in complaint
    contents = summary_of(tmp_path)
    remarks = contents.get("history", contents)["remarks"]
    assert len(remarks) == 1 and remarks[0].startswith("nothing touches")
    words, kind = words_of(tmp_path)
    assert kind == "passed" and "Warning nothing touches" in words


def test_the_smallest_gap_is_reported(tmp_path):
    below = "contact.foundation={shape='plane', point=[0,0,-0.25], normal=[0,0,1]}"
    code, _, complaint = run(tmp_path / "open", BLOCK, "traction=[]", below)
    assert code == 0 and "the smallest gap is 250 mm" in complaint
    assert run(tmp_path / "closed", BLOCK)[2] == "" and summary_of(tmp_path / "closed")["remarks"] == []


def test_a_large_energy_imbalance_is_a_warning(tmp_path):
    """Deep indentation in one step: the dissipated energy uses the friction at the end of the step only."""
    code, said, complaint = run(
        tmp_path, HISTORY, "prescribed_displacement.0.value=[0,0,-0.004]", "history={times=[1.0, 2.0, 3.0]}"
    )
    contents = summary_of(tmp_path)
    error = float(re.search(r"time-stepping error (\S+)", said).group(1))
    dissipated = float(re.search(r"friction (\S+),", said).group(1))
    assert code == 0 and abs(error) > 0.25 * dissipated
    assert "warning: the energies do not add up, by" in complaint and "more load steps" in complaint
    assert any("energies do not add up" in text for text in contents["history"]["remarks"])
    assert "Warning the energies do not add up" in words_of(tmp_path)[0]


def test_imbalance_just_inside_and_just_outside():
    slid = Energy(prescribed=10.0, elastic=2.0, dissipated=8.0)
    assert slid.imbalance == 0.0 and not slid.warning()
    inside, outside = (replace(slid, dissipated=value) for value in (10.6, 10.7))  # 10.67 is off by a quarter of it
    assert not inside.warning() and outside.warning() and not outside.warning(rounding=2.8)
    stuck = Energy(prescribed=10.0, elastic=10.0, dissipated=0.0)
    assert not replace(stuck, elastic=10.009).warning() and replace(stuck, elastic=10.02).warning()
    assert replace(stuck, elastic=np.nan).warning()


def test_a_place_on_a_surface_is_not_before_it():
    """A node that slides on a face is outside of the cell by a rounding error, however far it has come."""
    corners = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])
    place = np.array([[[0.3, 0.3, -5e-10]]])
    point, _, weights, columns = in_tetrahedra(place, corners, np.array([[0, 1, 2, 3]]))
    was = weights @ corners[0, columns[0]]
    assert len(point) == 1 and was[0, 2] < 0.0
    surface = corners[:, [0, 2, 1]]  # outward normal -z
    hit, depth, _ = depths_below(was, np.array([0.01]), surface, np.array([0]))
    assert len(hit) == 1 and depth[0] == 0.0
    assert not len(depths_below(was - (0.0, 0.0, 1e-6), np.array([0.01]), surface, np.array([0]))[0])


@pytest.mark.parametrize("young, way", [(1e9, -5e-2), (1e3, -1e-3), (1e13, -1e-6)])
def test_the_theory_does_not_see_a_body_that_stands_apart(young, way):
    """A block on a ball of coarse facets: deformation, approach and largest force beside it are those of others."""

    def measures(beside):
        bodies, materials = {"block": coulomb.box((1.0, 1.0, 1.0), (4, 4, 4))}, {"block": coulomb.Material(1e9, 0.3)}
        supports = [PrescribedDisplacement("block:top", (2e-2, 0.0, -2e-3))]
        contacts = [Contact("block:bottom", friction=0.1, foundation=Sphere((0.5, 0.5, -2.0), 2.0))]
        if beside:
            bodies["other"] = coulomb.moved(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)), translate=(5.0, 0.0, 0.0))
            materials["other"] = coulomb.Material(young, 0.3)
            supports.append(PrescribedDisplacement("other:top", (0.0, 0.0, way)))
            contacts.append(Contact("other:bottom", friction=0.3))
        found = ContactProblem(coulomb.join(**bodies), materials, supports, contacts).solve().small_strain
        return np.array([found.gap_error, found.turn, found.slip_over_cell, found.between, found.chord])

    alone = measures(False)
    assert np.all(alone > 0.0)
    assert measures(True) == pytest.approx(alone, rel=1e-4)


@pytest.mark.parametrize("nodes", [4, 9])
def test_measures_of_a_plane_slice_are_those_of_any_thickness(tmp_path, nodes):
    section = write(tmp_path / "section.msh", rectangle((0.0, 0.0), (1.0, 1.0), (4, 4), nodes))
    round_ = coulomb.Cylinder((0.5, -2.0, 0.0), (0.0, 0.0, 1.0), 2.0)

    def measures(thickness):
        mesh = coulomb.slice(section, "plane strain", thickness=thickness)
        held, contact = PrescribedDisplacement("top", (0.3, -2e-3, 0.0)), Contact("bottom", 0.1, foundation=round_)
        problem = ContactProblem(mesh, coulomb.Material(1e9, 0.3), [held], contact, small_strain="warn")
        return problem.solve().small_strain

    thin, thick = measures(1e-3), measures(1.0)
    assert thin.gap_error > 0.0 and thin.chord > 0.0
    assert thin.slip_over_cell == pytest.approx(0.3 * 4 * (nodes == 4) or 0.3 * 8, rel=0.5)
    for name in ("gap_error", "turn", "slip_over_cell", "chord"):
        assert getattr(thick, name) == pytest.approx(getattr(thin, name), rel=1e-3)


def test_planes_of_a_wedge_do_not_make_the_deformation_smaller(tmp_path):
    """A thin ring under inner pressure widens by p R^2/(E t); the pressure is all that acts on it."""
    section = write(tmp_path / "ring.msh", rectangle((0.99, 0.0), (1.01, 0.02), (2, 1)))
    mesh = coulomb.slice(section, "axisymmetric")
    far = Contact("right", 0.1, foundation=coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.1, hollow=True))
    material, pressure = coulomb.Material(1e9, 0.0), coulomb.Pressure("left", 1e4)
    found = ContactProblem(mesh, material, [coulomb.SymmetryPlane("bottom")], far, [pressure]).solve().evidence
    assert deformations(found, Reductions(found.comm))[1] == pytest.approx([2.0 * 1e4 / 1e9 / 0.02], rel=0.02)
