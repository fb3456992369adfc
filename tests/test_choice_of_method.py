"""K factorised or multigrid by predicted seconds, on one rank."""

import pytest
from conftest import ROOT, make_block

import coulomb
from coulomb import Clamp, DirectSolver, Elasticity, IterativeSolver, Material, Spring
from coulomb.benchmarks.real_parts import PARTS
from coulomb.benchmarks.two_blocks import two_blocks
from coulomb.case.case import read_case
from coulomb.linalg import multifrontal
from coulomb.linalg.methods import EXPLICIT_UP_TO, PREDICTED_UP_TO, chosen, undecided
from coulomb.linalg.multifrontal import Work, predicted_work, symbolic
from coulomb.linalg.predicted_cost import factorise, seconds_direct, seconds_multigrid
from coulomb.model import contact_body
from coulomb.model.estimate import slenderness
from coulomb.model.slenderness import on_soft_springs

MEASURED = {  # operations, bytes, contact unknowns, entries of K, slenderness; the faster method (processor time)
    "block, p = 10": ((3.8e9, 4.1e7), 990, 7.9e5, 1.6, True),
    "block, p = 24": ((5.4e11, 1.2e9), 5400, 1.04e7, 1.6, False),
    "plate of 12 354 unknowns": ((5.3e10, 2.0e8), 5115, 4.3e5, 21.4, True),
    "wedge of 12 351 unknowns": ((7.6e9, 6.3e7), 1743, 4.9e5, 2.4, True),
    "clip of 20 118 unknowns": ((1.6e10, 1.38e8), 2916, 8.62e5, 3.77, False),
    "hook of 20 430 unknowns": ((9.2e9, 8.5e7), 2166, 7.93e5, 1.96, False),
    "block, p = 16": ((5.2e10, 2.49e8), 2448, 3.13e6, 1.7, True),
    "half ring of 16 899 unknowns": ((2.8e10, 1.4e8), 3915, 6.6e5, 6.4, False),
    "plate of 18 597 unknowns": ((1.4e11, 3.9e8), 7137, 6.6e5, 21.7, False),
    "half ring of 65 676 unknowns": ((5.1e11, 9.9e8), 10_353, 2.7e6, 6.3, False),
}


@pytest.mark.parametrize("name", MEASURED)
def test_the_faster_method_where_both_were_measured(name):
    work, contact, entries, thin, direct = MEASURED[name]
    assert factorise(Work(*work, work[0]), contact, entries, thin) is direct


def test_what_decides():
    work, entries = Work(1e10, 1e8, 1e10), 1e6
    assert factorise(work, 1000, entries, 1.7) and factorise(work, 1000, entries, 1.7, False, 1e8)
    assert not factorise(work, 1000, entries, 1.7, False, 0.9e8)  # does not fit into the memory
    assert not factorise(Work(1e8, 1e6, 1e8), 30, 1e4, 1.7, False, 1.9e6)  # in double precision it takes twice as much
    assert not factorise(work._replace(longest=1e12), 1000, entries, 1.7)
    assert factorise(work._replace(longest=3e11), 1000, entries, 100.0)  # multigrid takes long on a thin body
    assert not factorise(work, 10_000, entries, 1.7)  # the Schur complement of wide contact faces is expensive
    slow = work._replace(longest=1e12)
    assert factorise(slow, 1000, entries, 1.7, True) and not factorise(slow, 1000, entries, 1.7, True, 1.9e8)
    assert 0.5 * seconds_direct(work, 1000) < seconds_direct(work, 1000, 2) < seconds_direct(work, 1000)
    assert seconds_direct(work, 1000) > 1.2e-11 * 1e10
    assert seconds_multigrid(1000, entries, 0.5) == seconds_multigrid(1000, entries, 1.7)
    small = Work(0.0, 1e12, 0.0)  # where the constants are small: 1.7 and 1.4 times as fast on two ranks
    assert seconds_direct(small, 1) / seconds_direct(small, 1, 2) == pytest.approx(1.7, abs=0.03)
    assert seconds_multigrid(1, 1e12, 1.7) / seconds_multigrid(1, 1e12, 1.7, 2) == pytest.approx(1.4, abs=0.03)


def test_where_the_size_leaves_it_open():
    assert undecided(20_000, 3_000, None, None)
    assert undecided(5_000, 4_000, None, None)
    for numbers in ((12_000, 3_000), (20_000, EXPLICIT_UP_TO + 1), (PREDICTED_UP_TO + 1, 3_000)):
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

    monkeypatch.setattr(contact_body, "undecided", lambda *given: given[2:] == (None, None))
    monkeypatch.setattr(contact_body, "factorise", stub)
    monkeypatch.setattr(contact_body, "symbolic", lambda *_: fronts)
    monkeypatch.setattr(contact_body, "least_room", lambda _: 7.0)
    monkeypatch.setattr(multifrontal, "_fronts_of", lambda *_: pytest.fail("dissected again"))
    problem = make_block(3)
    entries = problem.elasticity.K.getInfo()["nz_used"]
    assert asked == [(predicted_work(fronts), problem.body.interface, entries, slenderness(problem), False, 7.0, 1)]
    assert problem.body.linear_solver is (DirectSolver if direct else IterativeSolver)
    assert problem.body.explicit is direct
    assert problem.solve().certificate.passed
    assert not make_block(3, linear_solver=IterativeSolver).body.explicit and len(asked) == 1


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


def test_materials_far_apart_do_not_decide():
    """A foot of rubber and steel that contact alone holds: by multigrid about as fast as others of its size."""
    foot = read_case(PARTS / "foot.toml", [f'mesh.file="{ROOT / "demos" / "foot.msh"}"']).problem()
    assert not on_soft_springs(foot.elasticity) and not on_soft_springs(two_blocks(2).elasticity)
