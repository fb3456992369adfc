"""PETSc's own factors (MUMPS) and multigrid (GAMG) in place of ours, for whole contact problems."""

from __future__ import annotations

import math

from petsc4py import PETSc

from coulomb.linalg.compliance import DirectSolver

_GAMG: dict[str, object] = {
    "ksp_type": "cg",
    "pc_type": "gamg",
    "ksp_norm_type": "unpreconditioned",
    "ksp_guess_type": "fischer",  # each solve starts from the last 20, as ours does
    "ksp_guess_fischer_model": "1,20",
}


class Mumps(DirectSolver):
    """K^-1 by MUMPS, with a solve in each product by A: being another class, it is not replaced by our factors."""


class Gamg(DirectSolver):
    """K^-1 by CG and GAMG on the rigid body modes."""

    name = "CG, GAMG"
    exact = False

    def __init__(self, K: PETSc.Mat):
        super().__init__(K, _GAMG)
        self.tolerance = 1e-11

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec, tolerance: float = 0.0) -> None:
        if rhs.norm() == 0.0:
            u.set(0.0)
            return
        self._ksp.setTolerances(rtol=max(tolerance, self.tolerance), atol=0.0, divtol=math.inf, max_it=1000)
        super().solve(rhs, u)
        self.iterations += self._ksp.getIterationNumber()


PETSC: dict[str, type[DirectSolver]] = {"mumps": Mumps, "gamg": Gamg}
"""By their names as methods of benchmarks."""
