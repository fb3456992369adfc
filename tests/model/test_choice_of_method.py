"""K factorised or multigrid by predicted seconds, on one rank."""

import math

import numpy as np
import pytest
from conftest import ROOT, make_block, run_coulomb
from mpi4py import MPI

import coulomb
from benchmarks.real_parts import PARTS
from benchmarks.two_blocks import two_blocks
from coulomb import Clamp, Elasticity, Material, Spring
from coulomb.case.case import read_case
from coulomb.case.record import case_record
from coulomb.cli.preparation import prepared
from coulomb.linalg.compliance.predicted_cost import (
    EXPLICIT_UP_TO,
    PREDICTED_UP_TO,
    Measures,
    Precision,
    chosen,
    factorise,
    seconds_direct,
    seconds_multigrid,
    undecided,
)
from coulomb.linalg.factors import multifrontal
from coulomb.linalg.factors.multifrontal import Work, predicted_work, symbolic
from coulomb.model import contact_stiffness
from coulomb.model.conditioning import ill_conditioned, on_soft_springs, slenderness_of
from coulomb.solvers import DirectSolver, IterativeSolver

ONCE, TWICE = Precision.SINGLE, Precision.REPEATED
CELLS = {"tetrahedra": True}
HELD_BY_CONTACT = {"tetrahedra": True, "unheld": True}
MEASURED = {  # operations, bytes; measures; expected precision; whether direct is faster: once, over 8 load steps
    "block, p = 10": ((3.8e9, 4.1e7), Measures(10_890, 990, 1.7), ONCE, True, True),
    "block, p = 16": ((5.2e10, 2.49e8), Measures(41_616, 2448, 1.7), ONCE, False, True),
    "two blocks, p = 14": ((1.7e10, 1.12e8), Measures(30_885, 3039, 0.9), ONCE, True, True),
    "wedge of 12 351 unknowns": ((7.6e9, 6.3e7), Measures(12_351, 1743, 2.4, **HELD_BY_CONTACT), ONCE, True, True),
    "clip of 20 118 unknowns": ((1.6e10, 1.38e8), Measures(20_118, 2916, 3.8, 0.23, **CELLS), TWICE, False, True),
    "half ring": ((2.8e10, 1.42e8), Measures(16_899, 3915, 6.4, 0.044, **CELLS), TWICE, False, False),
    "plate, whose contact face is wide": ((1.4e11, 3.9e8), Measures(18_597, 7137, 21.7, **CELLS), TWICE, False, False),
}


@pytest.mark.parametrize("name", MEASURED)
def test_the_faster_method_where_both_were_measured(name):
    """Once, and over load steps: over 48 all want factors."""
    work, measures, precision, direct, steps = MEASURED[name]
    assert factorise(Work(*work), measures, precision=precision) is direct
    later = Precision.DOUBLE if measures.displacement <= 50_000 else ONCE
    assert factorise(Work(*work), measures, 8, precision=later) is steps
    assert factorise(Work(*work), measures, 48, precision=later)


def test_what_decides_the_iterations():
    """More for tetrahedra, bodies that contact alone holds, slender ones, flat cells, strips, and materials that keep
    their volume; fewer on faces that hardly touch."""
    body = Measures(20_000, 1000, 1.7)
    for name, value in (("aspect", 8.0), ("elongation", 20.0), ("poisson", 0.4999), ("second_order", True)):
        assert body._replace(**{name: value}).iterations > 1.5 * body.iterations, name
    held = body._replace(tetrahedra=True)
    harder = (body, held, held._replace(unheld=True), held._replace(unheld=True, slenderness=44.0))
    numbers = [measures.iterations for measures in harder]
    assert numbers == sorted(numbers) and len(set(numbers)) == len(numbers)
    assert body._replace(slenderness=0.5).iterations == body.iterations > body._replace(near=0.0).iterations


def test_measures_of_a_problem():
    """A wedge that nothing but contact holds, and a half ring of which a strip can touch a plane."""
    body, x = make_block(3).body, make_block(3).surface.x
    elongation = np.sum(np.ptp(x, axis=0) ** 2) / (8.0 / 3.0 + 1.0 / 6.0)  # the row of the clamp has no contact nodes
    n, m = body.unknowns["displacement"], body.stiffness.interface
    slender = slenderness_of(make_block(3).surface, make_block(3).elasticity)
    expected = Measures(n, m, slender, elongation=elongation, poisson=0.277)
    assert body.stiffness.measures == pytest.approx(expected, rel=1e-12)
    foot = read_case(PARTS / "foot.toml", [f'mesh.file="{ROOT / "demos" / "foot.msh"}"']).problem().body
    measures = foot.stiffness.measures
    assert measures[3:7] == (1.0, True, True, False) and measures.aspect == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("drop", "near"), [(0.0, 1.0), (1e-3, 1.0), (2e-3, 0.5), (0.1, 0.01)])
def test_the_part_of_a_face_that_is_near(drop, near):
    """A plane inclined by `drop` in all, under a face of length 1 of a block with diagonal sqrt(1.02)."""
    block = coulomb.box((1.0, 0.1, 0.1), (1000, 1, 1))
    plane = coulomb.Plane((0.0, 0.0, -0.3), (drop, 0.0, 1.0))
    problem = coulomb.ContactProblem(
        block, Material(2e11, 0.3), [Clamp("left")], coulomb.Contact("bottom", 0.3, foundation=plane)
    )
    assert problem.body.stiffness.measures.near == pytest.approx(
        near * math.sqrt(1.02) if drop > 1e-3 else near, abs=2e-3
    )


def test_what_decides():
    work, body = Work(1e10, 1e8), Measures(25_000, 1000, 1.7)
    assert factorise(work, body) and factorise(work, body, room=1e8)
    assert not factorise(work, body, room=0.9e8)  # does not fit into the memory
    assert not factorise(work, body, 8, precision=Precision.DOUBLE, room=1.9e8)
    assert not factorise(Work(1e8, 1e6), Measures(1000, 30, 1.7), room=1.9e6)  # in double precision twice as much
    assert not factorise(work._replace(operations=1e12), body)
    assert factorise(
        work._replace(operations=5e10), body._replace(slenderness=3000.0)
    )  # long by multigrid: a thin body
    assert not factorise(work, body._replace(contact=10_000))  # the Schur complement of wide contact faces is expensive
    slow = work._replace(operations=1e12)
    assert factorise(slow, body, soft=True) and not factorise(slow, body, soft=True, room=1.9e8)
    assert not factorise(slow, body, 8) and factorise(slow, body, 80)
    assert seconds_direct(work, 1000) > 1e-11 * 1e10


def test_wide_contact_faces():
    """Where A is not formed, every step factorises anew, whatever the contact; a sheet of 110 000 unknowns wants that,
    a block that lies on its face does not."""
    work, thin = Work(2.4e9, 2e8), Measures(109_800, 36_600, 178.0, second_order=True, aspect=3.3)
    given = {"precision": TWICE, "formed": False}
    condensed = seconds_direct(work, 36_600, **given)
    assert condensed == seconds_direct(work, 3, **given) < 0.2 * seconds_direct(work, 36_600, precision=TWICE)
    assert factorise(work, thin, **given)
    assert factorise(work, thin, **given, room=8e8) and not factorise(work, thin, **given, room=7.9e8)
    assert factorise(work, thin, precision=TWICE, soft=True, room=4e8)  # A formed, there is one set of factors
    assert not factorise(Work(6e10, 6.5e8), Measures(153_900, 17_100, 3.0), formed=False)


def test_costs_of_load_steps_and_ranks():
    work, body = Work(1e10, 1e8), Measures(20_000, 1000, 1.7)
    later = [seconds_direct(work, 1000, steps) for steps in (1, 2, 24)]
    assert later[2] - later[0] == pytest.approx(23 * (later[1] - later[0]))
    seconds = [seconds_direct(work, 1000, 1, precision) for precision in (ONCE, Precision.DOUBLE, TWICE)]
    assert seconds == sorted(seconds) and seconds[0] < seconds[1] < seconds[2]
    assert seconds_direct(work, 1000, 8, Precision.DOUBLE) < later[0] + 7 * (later[1] - later[0])
    one, two, many = (seconds_multigrid(body, steps) for steps in (1, 2, 24))
    assert many - one == pytest.approx(23 * (two - one)) and later[1] - later[0] < 0.5 * (two - one)
    one, two = (seconds_multigrid(Measures(10**9, 1, 1.7), ranks=ranks) for ranks in (1, 2))
    assert 1.0 < one / two <= 2.0 + 1e-3


def test_where_the_size_leaves_it_open():
    assert undecided(20_000, 3_000, None, None)
    assert undecided(5_000, 4_000, None, None) and undecided(300_000, EXPLICIT_UP_TO + 1, None, None)
    for numbers in ((12_000, 3_000), (PREDICTED_UP_TO + 1, 3_000)):
        assert not undecided(*numbers, None, None)
    assert not undecided(20_000, 3_000, DirectSolver, None)
    assert not undecided(20_000, 3_000, None, False)
    wide = (40_000, EXPLICIT_UP_TO + 2)  # A is too large to be formed, and on several ranks solves wait for each other
    assert chosen(*wide, 1, None, None) == (DirectSolver, False) and chosen(*wide, 2, None, None)[0] is IterativeSolver


@pytest.mark.parametrize("direct", [True, False])
def test_the_choice_is_made_once(monkeypatch, direct):
    """With the fronts of this body; the factorisation takes them."""
    asked, given = [], make_block(3, linear_solver=DirectSolver, explicit=True)
    fronts = symbolic(given.elasticity.K, given.elasticity.x, given.surface.nodes_in_rows)

    def stub(*arguments):
        asked.append(arguments)
        return direct

    monkeypatch.setattr(contact_stiffness, "undecided", lambda *given: given[2:] == (None, None))
    monkeypatch.setattr(contact_stiffness, "factorise", stub)
    monkeypatch.setattr(contact_stiffness, "symbolic", lambda *_: fronts)
    monkeypatch.setattr(contact_stiffness, "first_room", lambda _: 7.0)
    monkeypatch.setattr(multifrontal, "_fronts_of", lambda *_: pytest.fail("dissected again"))
    problem = make_block(3)
    assert not asked  # the number of load steps is not yet known
    problem.body.stiffness.expect_load_steps(8)
    assert problem.body.stiffness.explicit is direct
    assert asked == [
        (predicted_work(fronts), problem.body.stiffness.measures, 8, False, Precision.DOUBLE, 7.0, 1, True)
    ]
    assert problem.body.stiffness.linear_solver is (DirectSolver if direct else IterativeSolver)
    assert problem.solve().certificate.passed
    assert not make_block(3, linear_solver=IterativeSolver).body.stiffness.explicit and len(asked) == 1


@pytest.mark.parametrize(
    ("stiffness", "clamps", "soft"), [(1e6, "", True), (1e6, "y", True), (1e6, "xyz", False), (1e11, "", False)]
)
def test_bodies_on_soft_springs(stiffness, clamps, soft):
    """Those that can move, as a whole or along some directions, against springs only."""
    held = [Clamp("left", clamps)] if clamps else []
    supports = {"clamps": held, "springs": [Spring("top", stiffness)]}
    block = Elasticity(coulomb.box((0.1, 0.04, 0.02), (4, 2, 1)), Material(2.1e11, 0.3), **supports)
    assert on_soft_springs(block) is soft
    assert not on_soft_springs(Elasticity(coulomb.box((0.1, 0.04, 0.02), (4, 2, 1)), Material(2.1e11, 0.3), []))


def test_materials_far_apart():
    """A foot of rubber and steel that contact alone holds is ill-conditioned, but not slow by multigrid."""
    foot = read_case(PARTS / "foot.toml", [f'mesh.file="{ROOT / "demos" / "foot.msh"}"']).problem().elasticity
    blocks = two_blocks(2).elasticity
    assert not on_soft_springs(foot) and not on_soft_springs(blocks)
    assert ill_conditioned(foot) and not ill_conditioned(blocks)


@pytest.mark.parametrize(
    ("lengths", "ill"), [((0.3, 0.1, 0.1), False), ((0.4, 0.1, 0.1), False), ((0.5, 0.1, 0.1), True)]
)
def test_bodies_that_bend_are_ill_conditioned(lengths, ill):
    """Wherever they are: those whose diagonal cubed is more than 25 volumes."""
    far = coulomb.box(lengths, (4, 2, 2))
    far.domain.geometry.x[:] += 7.0
    body = Elasticity(far, Material(2.1e11, 0.3), [Clamp("left")])
    assert ill_conditioned(body) is ill


def test_the_precision_that_is_expected(monkeypatch):
    """A body that bends is factorised twice, in a load history in double precision from the beginning."""
    asked = []
    monkeypatch.setattr(contact_stiffness, "undecided", lambda *_: True)
    monkeypatch.setattr(contact_stiffness, "factorise", lambda *given: asked.append(given[4]) or False)
    for length, steps in ((0.5, 1), (0.3, 1), (0.5, 8)):
        beam = coulomb.box((length, 0.1, 0.1), (4, 2, 2))
        body = coulomb.ContactProblem(beam, Material(2e11, 0.3), [Clamp("left")], coulomb.Contact("bottom", 0.3)).body
        body.stiffness.expect_load_steps(steps)
        assert not body.stiffness.explicit
    assert asked == [TWICE, ONCE, Precision.DOUBLE]
    monkeypatch.setattr(contact_stiffness, "_DOUBLE_UP_TO", 50)
    assert body.unknowns["displacement"] > 50 and not body.stiffness.in_double


@pytest.mark.parametrize(("steps", "exact"), [(7, False), (8, True)])
def test_many_load_steps_want_factors_in_double_precision(monkeypatch, steps, exact):
    """Once: a stiffness that changes from step to step is not kept for many."""
    monkeypatch.setattr(multifrontal, "SINGLE_FROM", 0.0)
    problem = make_block(3)
    next(coulomb.LoadHistory([float(k) for k in range(1, steps + 1)]).steps(problem))
    assert problem.body.stiffness.solver.exact is exact
    assert not problem.body.stiffness.of(make_block(3).elasticity).solver.exact


def test_a_history_declares_its_load_steps(monkeypatch, tmp_path):
    """By itself, by its case, and the steps that are left when it is resumed; the choice is made after that."""
    asked = []
    monkeypatch.setattr(contact_stiffness, "undecided", lambda *_: True)
    monkeypatch.setattr(contact_stiffness, "factorise", lambda *given: asked.append(given[2]) or True)
    history = coulomb.LoadHistory([float(k) for k in range(1, 10)])
    steps = history.steps(make_block(2))
    next(steps)
    assert asked == [9]
    case = ROOT / "demos" / "history.toml"
    small = ["mesh.cells=[4,4,2]", "output.picture=false"]
    assert read_case(case, small).problem().body.stiffness.explicit and asked == [9, 24]
    settings = read_case(case, small)
    files = coulomb.HistoryFiles(tmp_path / "out", case=case_record(settings, MPI.COMM_WORLD))
    settings.load_history().run(settings.problem(), files, on_step=lambda step: step.state.number == 2)
    for resume in (True, False):
        _, problem = prepared(settings, tmp_path / "out", force=False, resume=resume)
        assert problem.body.stiffness.explicit
    assert asked == [9, 24, 24, 22, 24]


def test_an_exported_matrix_wants_factors(monkeypatch, tmp_path):
    """All of A takes a product per contact unknown, as many as many load steps."""
    asked = []
    monkeypatch.setattr(contact_stiffness, "undecided", lambda *_: True)
    monkeypatch.setattr(contact_stiffness, "factorise", lambda *given: asked.append(given[2]) or True)
    done = run_coulomb("export", ROOT / "demos" / "block.toml", tmp_path / "x.hdf5", "--set", "mesh.cells=[6,2,2]")
    assert done.returncode == 0 and asked == [54], done.stderr
