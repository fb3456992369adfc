"""Algorithm PF, step by step: the paper's method on its own problem, a steel block with Tresca friction.

    python -m demos.paper       # from the checkout, which has the folder benchmarks

R. Kucera, J. Machalova, H. Netuka, P. Zencak: Interior point method for 3D contact problems with friction.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.block import block
from benchmarks.conditioning import measure
from coulomb import InteriorPoint
from coulomb.solvers import KPRGP, AugmentedSystem, SchurComplementSystem

# The problem: min 1/2 x^T A x - b^T x subject to x_n >= 0, |x_t| <= g, at 330 contact nodes (Table 1's first line).
problem = block(p=10, friction=None)
qp = problem.friction_problem
print(f"{problem.unknowns['displacement']}/{problem.unknowns['contact']} unknowns")

# PF follows the central path nu_i z_i = theta to theta = 0.  Each step solves a Newton system by preconditioned CG,
# with a tolerance that depends on the last step; the step length is limited by the neighbourhood N(gamma, beta) of the
# path.
result = InteriorPoint(tolerance=1e-8, r_tol=0.1, c_fact=0.9).solve(qp)
print("step   theta     alpha   CG  residual")
for step in result.history:
    print(f"{step.iteration:4d}  {step.theta:.1e}  {step.alpha:6.3f}  {step.krylov:3d}  {step.residual:.1e}")

# The augmented system with P_AM and the Schur complement with P_SC have the same solution; since CG solves both to a
# tolerance only, the steps are similar, but not identical.
for newton in (AugmentedSystem(), SchurComplementSystem()):
    other = InteriorPoint(tolerance=1e-8, newton=newton).solve(qp)
    print(f"{type(newton).__name__}: {other.newton_steps} steps, {other.products} products by A")

# KPRGP, the active-set method to which the paper compares, needs many times the products for the same residual.
path, active = InteriorPoint(tolerance=1e-6).solve(qp), KPRGP(tolerance=1e-6).solve(qp)
print(f"to a residual of 1e-6: PF {path.products} products, KPRGP {active.products}")
assert np.linalg.norm(path.x - active.x) <= 1e-4 * np.linalg.norm(path.x)

# Theorem 1 on a smaller block: the preconditioned condition number stays bounded while that of J becomes infinite.
small = block(p=3, friction=None)
spectra = measure(small.friction_problem)
print(f"cond(J_AM) ends at {spectra[-1].cond_J_AM:.1e}, cond(P_AM^-1 J_AM) at {spectra[-1].cond_preconditioned_AM:.1e}")

print(problem.solution(result).certificate)

figure = Figure(figsize=(11, 8), layout="constrained")
(central, lengths), (inner, conditions) = figure.subplots(2, 2)
steps = [step.iteration for step in result.history]
central.semilogy(steps, [step.theta for step in result.history], "o-", label="theta")
central.semilogy(steps, [step.residual for step in result.history], "s-", label="natural residual")
central.set_title("the central path")
lengths.plot(steps, [step.alpha for step in result.history], "o-")
lengths.set_title("step length alpha")
inner.bar(steps, [step.krylov for step in result.history])
inner.set_title("CG iterations: products by A")
numbers = [s.iteration for s in spectra]
conditions.semilogy(numbers, [s.cond_J_AM for s in spectra], "s-", label="J_AM")
conditions.semilogy(numbers, [s.cond_J_SC for s in spectra], "o-", label="J_SC")
conditions.semilogy(numbers, [s.cond_preconditioned_AM for s in spectra], "k--", label="P_AM^-1 J_AM, P_SC^-1 J_SC")
conditions.set_title("condition numbers, p = 3")
for axis in (central, lengths, inner, conditions):
    axis.set_xlabel("step")
    axis.grid(alpha=0.3)
central.legend()
conditions.legend()
Path("results").mkdir(exist_ok=True)
figure.savefig("results/paper.png", dpi=110)
