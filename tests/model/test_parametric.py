"""Answers as functions of parameters, also of other frameworks: each with its framework's own test of gradients."""

import re

import numpy as np
import pytest
import ufl
from conftest import ROOT

import coulomb
from coulomb.fem import compat
from coulomb.parametric import ParametricAnswer

SECTION = (
    (ROOT / "docs/sensitivities.md").read_text().split("## In learning and optimisation loops")[1].split("\n## ")[0]
)
POSED, *EXAMPLES = re.findall(r"```python\n(.*?)```", SECTION, re.DOTALL)
MESH = coulomb.box((3.0, 1.0, 1.0), (4, 2, 2))


def pose(friction, young):
    """A pressed and pulled bar that slips in part; Young's modulus in 100 GPa, or a Function of DOLFINx in Pa."""
    return coulomb.ContactProblem(
        MESH,
        coulomb.Material(young if hasattr(young, "function_space") else 1e11 * float(young), 0.3),
        [coulomb.Clamp("left")],
        coulomb.Contact("bottom", friction=float(friction)),
        [coulomb.Traction("top", (0.0, 1e7, -4e7)), coulomb.Traction("right", (2e7, 0.0, 0.0))],
    )


def owed(gradient, friction, young):
    of_cells = gradient.young[""]
    of_field = hasattr(young, "function_space")
    return gradient.friction.sum(), of_cells / young.x.array[: len(of_cells)] if of_field else of_cells.sum() / young


def weights(answer):
    """Derivatives of a function of an answer of the order of 1 along contact forces and displacements."""
    return 1e-7 * np.sin(np.arange(answer.contact_force.size)), 1e3 * np.cos(answer.problem.elasticity.x)


def measured(answer):
    """A function of an answer, with its derivatives."""
    x, u = weights(answer)
    value = np.sum(x * answer.contact_force) + np.sum(u * answer.displacement**2)
    return value, x, 2.0 * u * answer.displacement


def in_framework(solve, array, total):
    """The same by the functions of a framework, of solves that it differentiates."""
    x, u = map(array, weights(pose(0.3, 2.0).solve()))

    def function(friction, young):
        forces, displacements = solve(friction, young)
        return total(x * forces) + total(u * displacements**2)

    return function


def documented(framework):
    """The names that an example of the docs for a framework makes."""
    names = {}
    (example,) = (one for one in EXAMPLES if f"coulomb.{framework} " in one)
    exec(POSED + example, names)
    return names


def test_the_adjoint_is_the_derivative():
    answer, at = ParametricAnswer(pose, owed, pose(0.3, 2.0), 1e-12), np.array([0.3, 2.0])
    found = answer.owed(at, *measured(answer.at(at))[1:])
    for one, way in zip(found, 1e-4 * np.eye(2), strict=True):
        more, less = (measured(answer.at(at + side * way))[0] for side in (1.0, -1.0))
        assert one == pytest.approx((more - less) / 2e-4, rel=1e-6)


def test_the_answer_for_its_adjoint_is_kept():
    answer, at = ParametricAnswer(pose, owed, pose(0.3, 2.0), 1e-8), np.array([0.3, 2.0])
    kept = answer.at(at)
    assert answer.at(at.copy()) is kept
    at[0] = 0.4  # in place
    assert answer.at(at) is not kept


def test_what_does_not_fit_is_refused():
    def finer(cells):
        return pose(0.3, 2.0).on(coulomb.box((3.0, 1.0, 1.0), (4, 2, cells)))

    with pytest.raises(ValueError, match="parameters may not change the mesh"):
        ParametricAnswer(lambda cells: finer(int(cells)), owed, finer(2), 1e-6).at([3])
    answer = ParametricAnswer(pose, lambda gradient, *_: [gradient.friction], pose(0.3, 2.0), 1e-6)
    with pytest.raises(ValueError, match=r"owed: there must be derivatives of shapes \[\(\), \(\)\]"):
        answer.owed([0.3, 2.0], *weights(answer.at([0.3, 2.0])))


def test_in_jax():
    jax = pytest.importorskip("jax")
    from jax.test_util import check_grads

    from coulomb.jax import solver

    jax.config.update("jax_enable_x64", False)
    with pytest.raises(ValueError, match="jax_enable_x64"):
        solver(pose, owed, pose(0.3, 2.0))
    jax.config.update("jax_enable_x64", True)
    solve = solver(pose, owed, pose(0.3, 2.0), tolerance=1e-12)
    function = jax.jit(in_framework(solve, jax.numpy.asarray, jax.numpy.sum))
    check_grads(function, (0.3, 2.0), order=1, modes=["rev"], atol=1e-6, rtol=1e-6, eps=1e-4)
    example = documented("jax")
    more, less = (example["misfit"](friction, 2.0) for friction in (0.3001, 0.2999))
    assert float(example["slopes"][0]) == pytest.approx(float(more - less) / 2e-4, rel=1e-4)


def test_in_torch():
    torch = pytest.importorskip("torch")
    from coulomb.torch import solver

    solve = solver(pose, owed, pose(0.3, 2.0), tolerance=1e-12)
    function = in_framework(solve, torch.from_numpy, torch.sum)
    at = [torch.tensor(one, dtype=torch.float64, requires_grad=True) for one in (0.3, 2.0)]
    assert torch.autograd.gradcheck(function, at, eps=1e-4, atol=1e-6, rtol=1e-6, nondet_tol=1e-9)
    function(single := torch.tensor(0.3, requires_grad=True), 2.0).backward()  # of single precision; and a number
    assert float(single.grad) == pytest.approx(float(torch.autograd.grad(function(*at), at[0])[0]), rel=1e-5)
    assert documented("torch")["logarithms"].exp().tolist() == pytest.approx([0.2, 2.1], rel=1e-4)


def test_in_pyadjoint():
    pyadjoint = pytest.importorskip("pyadjoint")
    from coulomb.pyadjoint import solver

    pyadjoint.set_working_tape(pyadjoint.Tape())
    pyadjoint.continue_annotation()
    solve = solver(pose, owed, pose(0.3, 2.0), measured, tolerance=1e-12)
    at = [pyadjoint.AdjFloat(one) for one in (0.3, 2.0)]
    J = solve(*at) * at[0] + solve(at[0], 3.0)
    reduced = pyadjoint.ReducedFunctional(J, [pyadjoint.Control(one) for one in at])
    along = [pyadjoint.AdjFloat(one) for one in (0.1, 0.3)]
    assert pyadjoint.taylor_test(reduced, at, along) == pytest.approx(2.0, abs=0.02)


def test_in_dolfinx_adjoint():
    """With Young's modulus of every cell, and a functional of UFL."""
    pyadjoint, dolfinx_adjoint = pytest.importorskip("pyadjoint"), pytest.importorskip("dolfinx_adjoint")
    from coulomb.pyadjoint import solver

    pyadjoint.set_working_tape(pyadjoint.Tape())
    pyadjoint.continue_annotation()
    per_cell = compat.functionspace(MESH.domain, 0, family="DG")
    friction, young, along = pyadjoint.AdjFloat(0.3), *(dolfinx_adjoint.Function(per_cell) for _ in range(2))
    young.x.array[:] = 2e11
    along.x.array[:] = 1e11 * np.sin(1.0 + np.arange(len(along.x.array)))
    u = solver(pose, owed, pose(0.3, young), tolerance=1e-12)(friction, young)
    J = dolfinx_adjoint.assemble_scalar(1e6 * ufl.inner(u, u) * ufl.dx + 1e-12 * young * ufl.dx)
    reduced = pyadjoint.ReducedFunctional(J, [pyadjoint.Control(one) for one in (friction, young)])
    rate = pyadjoint.taylor_test(reduced, [friction, young], [pyadjoint.AdjFloat(0.1), along])
    assert rate == pytest.approx(2.0, abs=0.02)
    example = documented("pyadjoint")
    more, less = (example["reduced"]([friction, 2.0]) for friction in (0.3001, 0.2999))
    assert example["slopes"][0] == pytest.approx((more - less) / 2e-4, rel=1e-4)
