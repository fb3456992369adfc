"""K, B and f of a problem on its free displacements, for packages that take sparse matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse

from ...arrays import FloatArray
from ...model.problem import ContactProblem


def free_system(problem: ContactProblem) -> tuple[Any, Any, FloatArray, FloatArray]:
    """K, B and f without the clamped displacements (which are 0), and c: gap and zeros, shape (3 m,)."""
    if np.any(problem.elasticity.held.oblique):
        raise ValueError("the other packages take supports along the axes only: others are not rows of K to leave out")
    fixed = problem.elasticity.fixed.ravel()
    free = np.flatnonzero(~fixed)
    c = np.zeros((len(problem.surface.gap), 3))
    c[:, 0] = problem.surface.gap
    K, B = (_csr(matrix, len(fixed)) for matrix in (problem.elasticity.K, problem.surface.B))
    return K[free][:, free], B[:, free], problem.loading.load.ravel()[free], c.ravel()


def _csr(matrix: Any, columns: int) -> Any:
    indptr, indices, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, indices, indptr), shape=(len(indptr) - 1, columns))
