"""K factorised or multigrid by the first solution, on one rank."""

import pytest
from conftest import ROOT, make_block, run_coulomb
from mpi4py import MPI

import coulomb
from benchmarks.real_parts import PARTS
from benchmarks.two_blocks import two_blocks
from coulomb import Clamp, Elasticity, Material
from coulomb.case.case import read_case
from coulomb.case.record import case_record
from coulomb.cli.preparation import prepared
from coulomb.linalg.compliance.predicted_cost import (
    EXPLICIT_UP_TO,
    PREDICTED_UP_TO,
    chosen,
    fits,
    patience,
    undecided,
    worth,
)
from coulomb.linalg.factors import multifrontal
from coulomb.linalg.factors.multifrontal import Work, predicted_work, symbolic
from coulomb.model import contact_stiffness
from coulomb.model.conditioning import ill_conditioned
from coulomb.solvers import DirectSolver, IterativeSolver

MEASURED = {  # operations, bytes; unknowns; iterations; single precision; whether direct: once, over 8 load steps
    "block, p = 12": ((1.0e10, 8.2e7), (18_252, 1404), 13, True, True, True),
    "block, p = 16": ((5.2e10, 2.5e8), (41_616, 2448), 13, True, False, True),
    "block of 27-node hexahedra": ((5.0e10, 2.4e8), (41_616, 2448), 18, True, True, True),
    "block, nu = 0.49": ((5.2e10, 2.5e8), (41_616, 2448), 47, True, True, True),
    "two blocks, p = 16": ((3.4e10, 2.0e8), (44_445, 3906), 13, True, False, True),
    "clip of 20 118 unknowns": ((1.6e10, 1.38e8), (20_118, 2916), 17, False, False, True),
    "half ring": ((2.8e10, 1.42e8), (16_899, 3915), 13, False, False, False),
    "plate, whose contact face is wide": ((1.4e11, 3.9e8), (18_597, 7137), 19, False, False, False),
}


@pytest.mark.parametrize("name", MEASURED)
def test_the_faster_method_where_both_were_measured(name):
    """Once, and over load steps: over 48 all want factors."""
    work, unknowns, taken, single, direct, steps = MEASURED[name]
    assert (worth(Work(*work), *unknowns, single=single) < taken) is direct
    later = unknowns[0] > 50_000 and single
    assert (worth(Work(*work), *unknowns, 8, later) < taken) is steps
    assert worth(Work(*work), *unknowns, 48, later) < taken


def test_what_factors_are_worth():
    """More with more to factorise, on wider faces, in double precision and on ranks; less over load steps, with more
    unknowns of multigrid, and of bodies that nothing but contact holds.  Where A is not formed every step factorises
    anew, whatever the contact."""
    work, more, sizes = Work(1e10, 1e8), Work(1e11, 1e8), (20_000, 1000)
    least = worth(work, *sizes)
    for larger in (worth(more, *sizes), worth(work, 20_000, 3000), worth(work, *sizes, single=False)):
        assert larger > 1.1 * least
    assert least < worth(work, *sizes, ranks=2) < 2.0 * least
    assert worth(work, *sizes, 24) < worth(work, *sizes, 2) < least
    assert worth(work, 40_000, 1000) < 0.6 * least and worth(work, *sizes, unheld=True) < 0.7 * least
    condensed = worth(Work(2.4e9, 2e8), 109_800, 36_600, single=False, formed=False)
    assert condensed == worth(Work(2.4e9, 2e8), 109_800, 3, single=False, formed=False)


def test_patience():
    """Twice the expected iterations, and as long as factors take where these take longer."""
    assert patience(20.0, 30.0) == patience(20.0, 0.0) == 20.0 * 2.0 * 20.0
    assert patience(20.0, 100.0) == 20.0 * 100.0


def test_what_fits_into_the_memory():
    work = Work(1e10, 1e8)
    assert fits(work, True, 1e8) and not fits(work, True, 0.9e8)
    assert fits(work, False, 2e8) and not fits(work, False, 1.9e8)
    assert not fits(Work(1e8, 1e6), True, 1.9e6)  # so small that it is factorised in double precision
    assert fits(work, False, 4e8, formed=False) and not fits(work, False, 3.9e8, formed=False)


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
    """With the fronts of this body; the factorisation takes them, and path following the multigrid of the first
    solution."""
    asked, given = [], make_block(3, linear_solver=DirectSolver, explicit=True)
    fronts = symbolic(given.elasticity.K, given.elasticity.x, given.surface.nodes_in_rows)

    def stub(*arguments):
        asked.append(arguments)
        return 0.0 if direct else 50.0

    monkeypatch.setattr(contact_stiffness, "undecided", lambda *given: given[2:] == (None, None))
    monkeypatch.setattr(contact_stiffness, "worth", stub)
    monkeypatch.setattr(contact_stiffness, "symbolic", lambda *_: fronts)
    monkeypatch.setattr(contact_stiffness, "first_room", lambda _: 7e9)
    monkeypatch.setattr(multifrontal, "_fronts_of", lambda *_: pytest.fail("dissected again"))
    problem = make_block(3)
    assert not asked  # the number of load steps is not yet known
    problem.body.stiffness.expect_load_steps(8)
    assert problem.body.stiffness.explicit is direct
    n, m = problem.unknowns["displacement"], problem.body.stiffness.interface
    assert asked == [(predicted_work(fronts), n, m, 8, False, True, 1, False)]
    assert problem.body.stiffness.linear_solver is (DirectSolver if direct else IterativeSolver)
    solver = problem.body.stiffness.solver
    assert (solver.iterations > 0) is not direct  # of the first solution
    assert problem.solve().certificate.passed and problem.linear.stiffness.solver is solver
    assert not make_block(3, linear_solver=IterativeSolver).body.stiffness.explicit and len(asked) == 1


def test_materials_far_apart():
    """A foot of rubber and steel is ill-conditioned."""
    foot = read_case(PARTS / "foot.toml", [f'mesh.file="{ROOT / "demos" / "foot.msh"}"']).problem().elasticity
    blocks = two_blocks(2).elasticity
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
    monkeypatch.setattr(contact_stiffness, "worth", lambda *given: asked.append(given[4]) or 1e3)
    for length, steps in ((0.5, 1), (0.3, 1), (0.5, 8)):
        beam = coulomb.box((length, 0.1, 0.1), (4, 2, 2))
        body = coulomb.ContactProblem(beam, Material(2e11, 0.3), [Clamp("left")], coulomb.Contact("bottom", 0.3)).body
        body.stiffness.expect_load_steps(steps)
        assert not body.stiffness.explicit
    assert asked == [False, True, False]
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
    monkeypatch.setattr(contact_stiffness, "worth", lambda *given: asked.append(given[3]) or 0.0)
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
    monkeypatch.setattr(contact_stiffness, "worth", lambda *given: asked.append(given[3]) or 0.0)
    done = run_coulomb("export", ROOT / "demos" / "block.toml", tmp_path / "x.hdf5", "--set", "mesh.cells=[6,2,2]")
    assert asked == [54], done.stderr
