"""Bodies of very different stiffness in one problem: each as right as alone, or refused with the place.

Run alone, or as `mpirun -n 2 python -m pytest tests/model/test_parallel_stiffness.py`.
"""

import weakref
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from ranks import by_place, everywhere

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    InteriorPoint,
    Material,
    NotConverged,
    Plane,
    PrescribedDisplacement,
    Spring,
    Tied,
    Traction,
    box,
    join,
    moved,
)
from coulomb.fem.bodies import diagonal_of
from coulomb.io.output import write
from coulomb.linalg.reductions import Reductions
from coulomb.model.certificate import judge
from coulomb.model.held_nodes import OtherNodes
from coulomb.recheck import check
from coulomb.solvers import CondensedSystem, IterativeSolver

SOFT, STIFF = 1e4, 2e11


def parts(young, x, name, strain):
    """Material, motion of the top and contact with a tilted plane of a block at x."""
    tilt = Plane((x + 0.05, 0.05, 0.0), (0.3 * strain, 0.2 * strain, 1.0))
    pull = PrescribedDisplacement(f"{name}top", (0.05 * strain, 0.02 * strain, -0.1 * strain))
    return Material(young, 0.3), pull, Contact(f"{name}bottom", friction=0.3, foundation=tilt)


def block(x, n, comm=MPI.COMM_WORLD):
    return moved(box((0.1, 0.1, 0.1), n, comm=comm), translate=(x, 0.0, 0.0))


def foam_beside_steel(comm=MPI.COMM_WORLD):
    """Two blocks that have nothing to do with each other, under forces alike."""
    strain = 1e-4, 1e-4 * SOFT / STIFF
    (a, pull_a, on_a), (b, pull_b, on_b) = parts(SOFT, 0, "a:", strain[0]), parts(STIFF, 1, "b:", strain[1])
    mesh = join(a=block(0, (4, 3, 3), comm), b=block(1, (3, 3, 2), comm))
    return ContactProblem(mesh, {"a": a, "b": b}, [pull_a, pull_b], [on_a, on_b])


def forces(solution, begin=-np.inf, end=np.inf):
    """Forces on the body between two x, by place, of all ranks."""
    x, found = everywhere(solution.problem.surface.x), everywhere(solution.force_on_body)
    here = (x[:, 0] >= begin) & (x[:, 0] < end)
    return by_place(x[here], found[here])


def test_foam_beside_steel_is_as_right_as_each_alone():
    solution = foam_beside_steel().solve()
    for k, (young, n) in enumerate(((SOFT, (4, 3, 3)), (STIFF, (3, 3, 2)))):
        material, pull, contact = parts(young, k, "", 1e-4 * SOFT / young)
        alone = forces(ContactProblem(block(k, n), material, [pull], contact).solve(tolerance=1e-11))
        assert np.abs(forces(solution, k - 0.5, k + 0.5) - alone).max() <= 1e-6 * np.abs(alone).max()


def test_the_certificate_judges_every_body_by_its_own_scale():
    """A hundredth of the steel's force less at one point: the displacements of the foam do not hide it."""
    problem = foam_beside_steel()
    solution = problem.solve()
    assert solution.certificate.passed
    for young, x_at_least in ((STIFF, 0.5), (SOFT, -1.0)):
        evidence = problem.evidence(solution.contact_force, solution.displacement)
        scale = 0.1 * 1e-4 * SOFT / young
        there = (evidence.place[:, 0] >= x_at_least) & (evidence.place[:, 0] < x_at_least + 1.4)
        gap = np.where(there, evidence.gap - 1e-4 * scale, evidence.gap)
        certificate = judge(replace(evidence, gap=gap))
        assert not certificate["penetration"].passed and not certificate["natural residual"].passed
        assert f"of '{'b' if young == STIFF else 'a'}:bottom'" in certificate["natural residual"].meaning


def beside_foam():
    """A block of steel, pressed onto a smooth floor, pulled against weak springs, and held at a side; foam beside."""
    a, pull_a, on_a = parts(SOFT, 0, "a:", 1e-2)
    mesh = join(a=block(0, (3, 3, 3), MPI.COMM_SELF), b=block(1, (3, 3, 2), MPI.COMM_SELF))
    return ContactProblem(
        mesh,
        {"a": a, "b": Material(STIFF, 0.3)},
        [pull_a, PrescribedDisplacement("b:front", (0.0, 0.0, 0.0), "yz")],
        [on_a, Contact("b:bottom", friction=0.0)],
        [Traction("b:top", (1e-2, 0.0, -100.0))],
        springs=[Spring("b:right", (1e5, 0.0, 0.0))],
        small_strain="warn",
    )


def test_free_motions_and_held_nodes_are_judged_by_their_own_body(monkeypatch):
    """Springs of the steel that carry a thousandth more than its load, and nodes held inside its floor by its whole
    displacement: less than a millionth of the displacement of the foam."""
    problem = beside_foam()
    solution = problem.solve()
    assert solution.certificate.passed
    further = solution.displacement + np.where(problem.elasticity.x[:, :1] > 0.5, (1e-10, 0.0, 0.0), 0.0)
    certificate = judge(problem.evidence(solution.contact_force, further))
    assert [check.name for check in certificate.checks if not check.passed] == ["rigid motion"]
    monkeypatch.setattr(OtherNodes, "remaining", lambda self, u: np.full(len(self.nodes), -1e-10))
    certificate = judge(problem.evidence(solution.contact_force, solution.displacement))
    assert [check.name for check in certificate.checks if not check.passed] == ["penetration"]


def test_rubber_on_steel():
    """Upper, stiffer or softer, on lower: forces of the pair, and of the lower one on the floor, balance the motion."""
    for young in ((1e6, STIFF), (STIFF, 1e6)):
        lower, upper = box((0.1, 0.1, 0.05), (3, 3, 2)), moved(box((0.1, 0.1, 0.05), (2, 2, 2)), translate=(0, 0, 0.05))
        problem = ContactProblem(
            join(lower=lower, upper=upper),
            {"lower": Material(young[0], 0.3), "upper": Material(young[1], 0.3)},
            [PrescribedDisplacement("upper:top", (0.0, 0.0, -1e-6))],
            [Contact("upper:bottom", friction=0.3, against="lower:top"), Contact("lower:bottom", friction=0.3)],
        )
        solution = problem.solve()
        assert solution.certificate.passed and solution.result.newton_steps <= 40
        part, over = problem.surface.part, Reductions(problem.comm)
        pressed = [np.abs(over.sum(solution.force_on_body[part == number, 2])) for number in (0, 1)]
        assert pressed[0] > 0.0 and pressed[0] == pytest.approx(pressed[1], rel=1e-8)


def test_what_rounding_leaves_of_steel_on_steel_on_a_pad():
    """Contact alone holds both, and their motions with the pad cancel between them: the softer it is, the larger."""
    pad, low, up = (
        box((0.1, 0.1, 0.05), (2, 2, 1)),
        box((0.06, 0.06, 0.04), (2, 2, 1)),
        box((0.05, 0.05, 0.03), (2, 2, 1)),
    )
    mesh = join(pad=pad, low=moved(low, translate=(0.02, 0.02, 0.05)), up=moved(up, translate=(0.025, 0.025, 0.09)))
    found = []
    for young in (1e5, 1e4):
        problem = ContactProblem(
            mesh,
            {"pad": Material(young, 0.4), "low": Material(STIFF, 0.3), "up": Material(STIFF, 0.3)},
            [PrescribedDisplacement("pad:bottom", (0.0, 0.0, 0.0))],
            [Contact("up:bottom", 0.3, against="low:top"), Contact("low:bottom", 0.5, against="pad:top")],
            [Traction("up:top", (1.5e5, 5e4, -1e6))],
            small_strain="warn",
        )
        with pytest.raises(NotConverged, match="rounding errors of displacements alone leave") as failure:
            problem.solve(solver=InteriorPoint(1e-12, max_iterations=30))
        posed, result = problem.friction_problem, failure.value.result
        found.append(posed.unresolved(result.x, result.gradient))
        reached = Reductions(problem.comm).max(posed.residuals(result.x, result.gradient))
        assert 0.1 * reached < found[-1] < 10.0 * reached
    assert found[1] == pytest.approx(10.0 * found[0], rel=0.01)


def test_pairs_and_ties_are_judged_by_their_own_scale():
    """A pair of foam, and one of steel whose gaps are off by a thousandth of the steel's displacement; the same of the
    jump of a tie."""
    strain = {"soft": 1e-3, "stiff": 1e-3 * SOFT / STIFF}
    meshes, materials, supports, contacts, ties = {}, {}, [], [], []
    for k, (name, young) in enumerate({"soft": SOFT, "stiff": STIFF}.items()):
        for j, at in enumerate(("a", "b", "c")):
            meshes[f"{name}_{at}"] = moved(box((0.1, 0.1, 0.1), (2, 2, 1)), translate=(float(k), 0.0, 0.1 * j))
            materials[f"{name}_{at}"] = Material(young, 0.3)
        supports += [PrescribedDisplacement(f"{name}_a:bottom", (0.0, 0.0, 0.0))]
        supports += [PrescribedDisplacement(f"{name}_c:top", (0.0, 0.0, -0.1 * strain[name]))]
        contacts.append(Contact(f"{name}_b:bottom", 0.3, against=f"{name}_a:top"))
        ties.append(Tied(f"{name}_c:bottom", f"{name}_b:top"))
    solution = ContactProblem(join(**meshes), materials, supports, contacts, ties=ties, small_strain="warn").solve()
    evidence = solution.problem.evidence(solution.contact_force, solution.displacement, None)
    assert judge(evidence).passed
    off = 1e-3 * 0.1 * strain["stiff"]
    foam, steel = evidence.pairs
    worst = steel.worst.copy()
    worst[0] = off, 1.0, 0.0, 0.1
    gaps = judge(replace(evidence, pairs=(foam, replace(steel, worst=worst))))
    assert [check.name for check in gaps.checks if not check.passed] == ["pair gap"]
    assert "'stiff_b:bottom' against 'stiff_a:top'" in gaps["pair gap"].meaning
    jump = np.where(evidence.x[:, :1] > 0.5, off, 0.0) * np.ones(3)
    assert [check.name for check in judge(replace(evidence, jump=jump)).checks if not check.passed] == ["ties"]


def test_a_body_without_load_has_a_scale():
    """A block that only touches the floor, beside foam that is pressed: no forces, and no refusal."""
    (a, pull, on_a), still = parts(SOFT, 0, "a:", 1e-4), PrescribedDisplacement("b:top", (0.0, 0.0, 0.0))
    mesh = join(a=block(0, (3, 3, 3)), b=block(1, (3, 3, 2)))
    for young in (SOFT, STIFF):
        problem = ContactProblem(
            mesh, {"a": a, "b": Material(young, 0.3)}, [pull, still], [on_a, Contact("b:bottom", 0.3)]
        )
        solution = problem.solve()
        assert solution.certificate.passed and solution.result.newton_steps <= 30
        on_b = problem.surface.x[:, 0] > 0.5
        assert np.abs(solution.force_on_body[on_b]).max(initial=0.0) <= 1e-8 * np.abs(forces(solution)).max()


def test_the_worst_contact_is_named_where_the_residual_is_not_reached():
    with pytest.raises(NotConverged, match=r"worst contact point at \(.*\) m of '(a|b):bottom': its residual is"):
        foam_beside_steel().solve(solver=InteriorPoint(max_iterations=2))


def test_the_check_has_the_same_scales(tmp_path):
    problem = foam_beside_steel(MPI.COMM_SELF)
    write(problem.solve(), tmp_path)
    findings = check(tmp_path, problem)
    assert findings.certificate.passed and not findings.faults


def test_multigrid_lets_go_of_the_matrix():
    """It is freed, assembled anew where it is asked for, and answers do without it."""
    held, load = [Clamp("left")], [Traction("top", (2e6, 0.0, -5e6))]
    on, multigrid = Contact("bottom", 0.3), {"linear_solver": IterativeSolver, "explicit": False}
    mesh = box((0.4, 0.2, 0.2), (6, 3, 3))
    problem, fresh = (ContactProblem(mesh, Material(STIFF, 0.3), held, on, load, **multigrid) for _ in range(2))
    matrix = weakref.ref(problem.elasticity.K)
    answer = problem.solve()
    assert matrix() is None and problem.elasticity.reduced.K is None
    assert answer.valid
    expected = fresh.elasticity.K
    assert problem.elasticity.reduced.diagonal == pytest.approx(diagonal_of(expected), rel=1e-15)
    assert problem.elasticity.reduced.vector().getSizes() == expected.createVecRight().getSizes()
    assert (problem.elasticity.K - expected).norm() <= 1e-15 * expected.norm()
    condensed = problem.solve(solver=InteriorPoint(newton=CondensedSystem()))
    assert np.abs(condensed.displacement - answer.displacement).max() <= 1e-6 * np.abs(answer.displacement).max()
