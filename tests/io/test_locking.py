"""First-order cells that lock in bending and near incompressibility: their error bars, and what is said of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import run_coulomb
from shared_problems import ring_mesh

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    Plane,
    PrescribedDisplacement,
    Pressure,
    SymmetryPlane,
    Traction,
    box,
    join,
    moved,
)
from coulomb.io.answer import answer_of
from coulomb.io.error_bars import ComparisonHistories
from coulomb.io.locking import remarks_on_locking
from coulomb.io.other_meshes import NoErrorBars

STEEL = Material(2.1e11, 0.3)
LENGTH, WIDTH, LOAD = 0.2, 0.05, 1e4


def cantilever(height, cells=(16, 4, 1), cell="tetrahedron", degree=1, gap=1.0, **others):
    """Under a pressure; its end turns towards a stop."""
    mesh, stop = box((LENGTH, WIDTH, height), cells, cell, degree=degree), Plane((LENGTH + gap, 0, 0), (-1, 0, 0))
    load = Pressure("top", LOAD, **others)
    return ContactProblem(mesh, STEEL, [Clamp("left")], Contact("right", 0.0, foundation=stop), [load])


def deflection(height):
    """Of a beam: q l^4 / 8 E I."""
    return LOAD * WIDTH * LENGTH**4 / (8.0 * STEEL.young * WIDTH * height**3 / 12.0)


def largest(bars):
    bar = bars["maximum.displacement"]
    return bar.value[0], bar.bar[0]


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("layers", [1, 2])
def test_the_bars_of_a_thin_plate_contain_the_deflection_of_a_beam(cell, layers):
    bars = cantilever(0.004, (16, 4, layers), cell).solve().error()
    value, bar = largest(bars)
    assert value < 0.3 * deflection(0.004) and 0.9 * deflection(0.004) < value + bar < 3.0 * deflection(0.004)
    assert [one.order for one in bars.answers] == [1, 1, 1, 2]
    (said,) = bars.warnings
    assert "the first-order cells are far too stiff, as they lock in bending" in said and "degree = 2 in [mesh]" in said
    assert bars.entry()["warnings"] == [said]


def test_a_single_layer_is_compared_with_second_order():
    """Coarser meshes have one too: they tend to an answer that is 12 % too stiff.  Second order has no such error."""
    value, bar = largest(cantilever(0.02, (40, 10, 1), "hexahedron").solve().error())
    exact = largest(cantilever(0.02, (20, 5, 1), "hexahedron", 2).solve().error())[0]
    assert 0.8 * exact < value < 0.9 * exact < exact < value + bar < 1.3 * exact


def test_a_refinement_does_not_end_with_bars_that_do_not_see_the_layer():
    found = cantilever(0.02, (10, 3, 1), "hexahedron").refine(0.3, ["maximum.displacement"], unknowns=1200)
    value, bar = largest(found.bars)
    assert found.bars.answers[-1].order == 2 and value + bar > 0.9 * deflection(0.02)


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("pushed", [False, True])
def test_a_pad_near_incompressibility(cell, pushed):
    """Under a pressure it gives way too little, and where it is pushed it resists too much; hexahedra do not."""

    def solution(cells, kind, degree):
        mesh, rubber = box((0.1, 0.1, 0.03), cells, kind, degree=degree), Material(5e6, 0.499)
        held = [PrescribedDisplacement("top", (1e-4, 0.0, -1e-4))] if pushed else [Clamp("top")]
        floor = Contact("bottom", 0.8) if pushed else Contact("bottom", 0.8, foundation=Plane((0, 0, -1), (0, 0, 1)))
        loads = [] if pushed else [Traction("bottom", (0.0, 2e4, 3e5))]
        return ContactProblem(mesh, rubber, held, floor, loads).solve()

    bars = solution((4, 4, 2), cell, 1).error()
    exact = answer_of(solution((6, 6, 3), "hexahedron", 2), 1e-8).totals
    for name in ("strain_energy", "maximum.displacement", *(["totals.normal_force"] if pushed else [])):
        assert np.all(np.abs(bars[name].value - exact[name][0]) <= bars[name].bar), name
    locks = cell == "tetrahedron"
    assert 2 in [one.order for one in bars.answers] or not locks
    assert any("near incompressibility" in one for one in bars.warnings) == locks


def test_second_order_of_a_file_near_incompressibility_is_compared_with_smaller_cells():
    """First order on the same cells has a hundred times the force: with it bars would be ten times the value."""

    def solution(cells):
        mesh = replace(box((0.1, 0.1, 0.05), cells, "tetrahedron", degree=2), coarser=None, grid=None)
        held = [PrescribedDisplacement("top", (0.0, 0.0, -5e-4))]
        return ContactProblem(mesh, Material(1e6, 0.4999), held, Contact("bottom", 0.3)).solve()

    bars, exact = solution((3, 3, 2)).error(), solution((9, 9, 5)).forces["normal_force"]
    assert [one.order for one in bars.answers] == [2, 2] and not bars.warnings
    bar = bars["totals.normal_force"]
    assert abs(bar.value[0] - exact) < bar.bar[0] < 0.25 * exact


def test_where_nothing_locks_nothing_is_said_and_no_second_order_is_solved():
    load = Traction("top", (0.0, 1e7, -4e7))
    blocks = [
        ContactProblem(box((3.0, 1.0, 1.0), (9, 3, 3), cell), STEEL, [Clamp("left")], Contact("bottom", 0.3), [load])
        for cell in ("tetrahedron", "hexahedron")
    ]
    for block in blocks:
        answer = block.solve()
        bars = answer.error()
        assert [one.order for one in bars.answers] == [1, 1, 1] and not bars.warnings and not remarks_on_locking(answer)


def test_what_is_bent_is_told_from_what_is_pulled_without_a_comparison():
    """A plate of one layer in its plane, and the same that is bent."""
    mesh = box((LENGTH, WIDTH, 0.004), (16, 4, 1), "tetrahedron")
    held = [Clamp("left", "x"), SymmetryPlane("front"), SymmetryPlane("bottom")]
    pulled = ContactProblem(mesh, STEEL, held, Contact("top", 0.0), [Traction("right", (1e6, 0.0, 0.0))]).solve()
    assert not remarks_on_locking(pulled)
    for layers in (1, 2):
        (said,) = remarks_on_locking(cantilever(0.004, (16, 4, layers)).solve())
        assert "seem far too stiff, as they lock in bending" in said and "(degree = 2 in [mesh])" in said
    assert not remarks_on_locking(cantilever(0.004, (8, 2, 1), degree=2).solve())


@pytest.mark.parametrize(("cell", "cells"), [("hexahedron", (1, 6)), ("tetrahedron", (1, 8))])
def test_chords_of_a_pin_in_a_lug_are_no_lock(cell, cells):
    """Half of a pin with a clearance of 20 um: polygons touch at a few points, and nothing is bent."""
    rows, around = cells
    lug = ring_mesh(0.01, 0.02, (rows, around, 1), np.pi, 0.01, cell)
    pin = ring_mesh(0.003, 0.00998, (rows, around + 1, 1), np.pi, 0.01, cell)
    held = [SymmetryPlane(f"{body}:{face}") for body in ("lug", "pin") for face in ("front", "back", "bottom")]
    contact, load = Contact("pin:right", 0.1, against="lug:left"), Traction("pin:left", (0.0, 8e7, 0.0))
    bodies = join(lug=lug, pin=pin)
    answer = ContactProblem(bodies, STEEL, [Clamp("lug:right"), *held], contact, [load], small_strain="warn").solve()
    assert answer.small_strain.chord > 5.0 and not remarks_on_locking(answer)
    if cell == "hexahedron":
        said = answer.error().warnings
        assert len(said) == 2 and all("their chords leave gaps of 736% of the approach" in one for one in said)


def test_a_run_says_it(tmp_path):
    case = tmp_path / "case.toml"
    case.write_text(
        f"[mesh]\nbox = [{LENGTH}, {WIDTH}, 0.004]\ncells = [8, 2, 1]\n[material]\nyoung = 2.1e11\npoisson = 0.3\n"
        f'[[clamp]]\nface = "left"\n[[pressure]]\nface = "top"\nvalue = {LOAD}\n[contact]\nface = "right"\n'
        'friction = 0.0\n[contact.foundation]\nshape = "plane"\npoint = [0.3, 0, 0]\nnormal = [-1, 0, 0]\n'
        "[output]\npicture = false\n"
    )
    done = run_coulomb("run", case, "--output", tmp_path / "out", "--error", code=None)
    assert "warning: the first-order cells are far too stiff, as they lock in bending" in done.stderr.replace("\n", " ")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert "degree = 2" in summary["error"]["warnings"][0] and any("seem far too" in one for one in summary["remarks"])
    run_coulomb("check", tmp_path / "out")


def test_a_load_history_is_compared_with_second_order_from_its_start():
    """The load grows; the second step needs both steps of second order."""
    problem = cantilever(0.004, (8, 2, 1), amplitude=lambda t: t)
    history = LoadHistory([0.5, 1.0])
    compared = ComparisonHistories(problem, history, 1e-8)
    for step in history.steps(problem):
        bars = compared.error_of(step)
        value, bar = largest(bars)
        assert value < step.state.time * deflection(0.004) < 1.1 * (value + bar)
        assert bars.answers[-1].order == 2 and "degree = 2" in bars.warnings[0]


def test_without_the_comparison_the_bars_are_said_to_be_too_short(monkeypatch):
    thin, history = cantilever(0.004, (8, 2, 1)), LoadHistory([1.0])
    coarse = thin.on(box((LENGTH, WIDTH, 0.004), (4, 1, 1), "tetrahedron")).solve()
    assert "second order, which would show it, has no answer: give one" in thin.solve().error(coarse).warnings[0]
    from coulomb.io import error_bars, other_meshes

    def too_large(problem):
        if problem.body.elasticity.members[0].body.degree == 2:
            raise NoErrorBars("too large")

    for module in (error_bars, other_meshes):
        monkeypatch.setattr(module, "refuse_too_large", too_large)
    compared = ComparisonHistories(thin, history, 1e-8)
    for bars in (thin.solve().error(), *map(compared.error_of, history.steps(thin))):
        assert (
            "bars may be far too short: first-order cells may lock" in bars.warnings[0]
            and "too large" in bars.warnings[0]
        )


def test_contact_that_all_meshes_miss_is_in_the_bars():
    """The end turns towards the stop by less than the gap on all meshes that are compared, of second order too, but by
    more if the plate bends as a beam does, and then the stop presses."""
    turn = LOAD * WIDTH * LENGTH**3 / (6.0 * STEEL.young * WIDTH * 0.004**3 / 12.0)
    stopped = cantilever(0.004, (8, 2, 1), gap=0.85 * turn * 0.002)
    bars = stopped.solve().error()
    assert "nothing touches on 'right', but a displacement within its error bar would close a gap" in bars.warnings[-1]
    true = stopped.on(box((LENGTH, WIDTH, 0.004), (16, 4, 2), degree=2)).solve().at_nodes.totals()["normal_force"]
    bar = bars["totals.normal_force"]
    assert not any(np.any(value) for value in bar.values) and 0.0 < true < bar.contact[0] < 10.0 * true
    free = cantilever(0.004, (8, 2, 1), gap=50.0 * turn * 0.002).solve().error()
    assert "nothing touches" not in str(free.warnings) and free["totals.normal_force"].contact[0] == 0.0


def test_contact_that_one_face_misses_is_in_the_bars_while_others_touch():
    turn = LOAD * WIDTH * LENGTH**3 / (6.0 * STEEL.young * WIDTH * 0.004**3 / 12.0)
    plate, block = box((LENGTH, WIDTH, 0.004), (8, 2, 1), "tetrahedron"), box((0.1, 0.1, 0.1), (1, 1, 1))
    stop = Plane((LENGTH + 0.85 * turn * 0.002, 0.0, 0.0), (-1.0, 0.0, 0.0))
    bars = (
        ContactProblem(
            join(plate=plate, block=moved(block, translate=(0.0, 1.0, 0.0))),
            STEEL,
            [Clamp("plate:left")],
            [Contact("plate:right", 0.0, foundation=stop), Contact("block:bottom", 0.3)],
            [Pressure("plate:top", LOAD), Pressure("block:top", LOAD)],
        )
        .solve()
        .error()
    )
    assert "nothing touches on 'plate:right'" in bars.warnings[-1] and "block" not in bars.warnings[-1]
    missed, pressed = (bars[f"faces.{name}.normal_force"] for name in ("plate:right", "block:bottom"))
    assert missed.value[0] == 0.0 and missed.contact[0] > 156.0  # of 16 x 4 x 2 cells of second order
    assert pressed.value[0] == pytest.approx(0.01 * LOAD) and pressed.bar[0] < 1e-3 * LOAD
