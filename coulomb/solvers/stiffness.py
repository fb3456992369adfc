"""K^-1: the stiffness matrix factorised (MUMPS Cholesky), or solved by CG with smoothed-aggregation multigrid."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Protocol

from petsc4py import PETSc

_prefixes = (f"coulomb_{number}_" for number in itertools.count())


class StiffnessSolver(Protocol):
    """Solves K u = rhs; `name` is what the summary calls it."""

    name: str

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec) -> None: ...

    def destroy(self) -> None: ...


@contextmanager
def _options(prefix: str, values: Mapping[str, object]) -> Iterator[None]:
    """PETSc options under a prefix of their own, gone again afterwards."""
    database = PETSc.Options(prefix)
    for key, value in values.items():
        database[key] = value
    try:
        yield
    finally:
        for key in values:
            database.delValue(key)


def _ksp(K: PETSc.Mat, ksp_type: str, values: Mapping[str, object]) -> PETSc.KSP:
    prefix = next(_prefixes)
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K)
    ksp.setType(ksp_type)
    ksp.setErrorIfNotConverged(True)
    ksp.setOptionsPrefix(prefix)
    with _options(prefix, values):
        ksp.setFromOptions()
        ksp.setUp()
    return ksp


class DirectSolver:
    """Cholesky factorisation by MUMPS, on all ranks.

    Args:
        K: Symmetric positive definite, assembled.
    """

    name = "direct (MUMPS Cholesky)"

    def __init__(self, K: PETSc.Mat):
        # ICNTL(14): room for the fill that pivot delays and parallel fronts add to the estimate, in per cent.
        self._ksp = _ksp(
            K,
            "preonly",
            {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_14": 60},
        )

    @property
    def factor(self) -> PETSc.Mat:
        """The factored matrix, for many right-hand sides at once (MatMatSolve)."""
        return self._ksp.getPC().getFactorMatrix()

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec) -> None:
        self._ksp.solve(rhs, u)

    def destroy(self) -> None:
        self._ksp.destroy()


class IterativeSolver:
    """CG with PETSc's GAMG on the rigid body modes that K carries as its near-nullspace.

    Args:
        K: Symmetric positive definite, assembled, block size 3, with a near-nullspace.
        tolerance: |K u - rhs| / |rhs|, well under the tolerances of the CG that uses A = B K^-1 B^T.

    Raises:
        PETSc.Error: From solve, where 1000 iterations are not enough.
    """

    name = "iterative (CG, GAMG)"

    def __init__(self, K: PETSc.Mat, tolerance: float = 1e-11):
        self.tolerance = tolerance
        self._ksp = _ksp(
            K,
            "cg",
            {
                "ksp_rtol": tolerance,
                "ksp_atol": 0.0,
                "ksp_max_it": 1000,
                "ksp_norm_type": "unpreconditioned",
                "pc_type": "gamg",
                "pc_gamg_threshold": 0.02,
                "mg_levels_ksp_type": "chebyshev",
                "mg_levels_pc_type": "jacobi",
            },
        )

    def solve(self, rhs: PETSc.Vec, u: PETSc.Vec) -> None:
        self._ksp.solve(rhs, u)

    def destroy(self) -> None:
        self._ksp.destroy()
