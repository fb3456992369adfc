"""Outer loops of one's own: the demo, what is kept between solves, and a loop that takes the steps of a history."""

import re

import numpy as np
import ufl
from conftest import ROOT, run_script
from mpi4py import MPI
from user_forms import Script, strain

import coulomb
from coulomb import Contact, ContactProblem, LoadHistory

comm = MPI.COMM_WORLD


def test_the_demo_runs(tmp_path):
    """Each example beside its formula."""
    done = run_script(ROOT / "demos" / "outer_loops.py", comm.bcast(tmp_path))
    ratios = re.findall(r"(\w+): ([\d.]+) of the formula(?:, (\d+))?", done.stdout)
    assert [name for name, *_ in ratios] == ["plasticity"] * 3 + ["viscoelasticity"] * 4 + ["heat", "tool"]
    assert all(abs(float(ratio) - 1.0) < 1e-6 for _, ratio, _ in ratios)
    assert all(float(one) < 1e-7 for one in re.findall(r"([\d.e-]+) of the (?:force|lever)", done.stdout))
    assert [int(count) for name, _, count in ratios if name == "plasticity"] <= [3, 15, 3]


def rubbed():
    """A block that is pressed by its top, and rubbed there and back, with a stress of its own in L."""
    script = Script(coulomb.box((1.0, 1.0, 0.5), (4, 4, 2)), 1)
    top, own = script.function(), script.constant(0.0)
    a, L = script.elasticity(100.0, 0.3), own * ufl.tr(strain(script.v)) * ufl.dx

    def update(time):
        press, rub = 0.01 * min(time, 1.0), 0.01 * np.interp(time, [1.0, 2.0, 4.0], [0.0, 1.0, -1.0])
        top.x.array.reshape(-1, 3)[:] = [rub, 0.0, -press]

    body = coulomb.Body(a, L, [script.bc(top, "top")], faces=script.mesh, update=update)
    return ContactProblem(body, Contact("bottom", 0.3)), own


def test_a_loop_takes_the_steps_of_a_history():
    """With other values of the coefficients tried in between, and a step that is given up."""
    times = [0.5, 1.0, 1.5, 2.0, 3.0]
    expected = [step.solution.force_on_body for step in LoadHistory(times, tolerance=1e-11).steps(rubbed()[0])]
    problem, own = rubbed()
    state, start = LoadHistory(times).beginning(problem), None
    for time, forces in zip(times, expected, strict=True):
        problem.at(time + 0.5, state).solve()
        posed = problem.at(time, state)
        for own.value in (0.5, 0.0):
            solution = posed.solve(1e-11, start=start)
            start = solution.contact_force
        state = problem.after(state, solution)
        size = comm.allreduce(np.abs(forces).max(initial=0.0), op=MPI.MAX)
        assert np.abs(solution.force_on_body - forces).max(initial=0.0) <= 1e-7 * size


def test_what_a_second_solve_keeps():
    """K, its inverse and A where L has changed, and with the last answer as start a third of the Newton steps."""
    problem, own = rubbed()
    posed = problem.at(2.0, LoadHistory([2.0]).beginning(problem))
    first = posed.solve()
    own.value = 1e-3
    second = posed.solve(start=first.contact_force)
    assert second.problem.linear.stiffness is first.problem.linear.stiffness and second.problem.A is first.problem.A
    assert second.certificate.passed and len(second.result.history) <= max(3, len(first.result.history) / 2)
    assert comm.allreduce(np.abs(second.contact_force - first.contact_force).max(initial=0.0), op=MPI.MAX) > 0.0
