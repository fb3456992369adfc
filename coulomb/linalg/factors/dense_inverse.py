"""Products with the inverse of a symmetric matrix that is known by its lower triangle."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg.blas import dsymv

from ...arrays import FloatArray

_FEW = 1.0 / 3.0
"""Part of the numbers of a vector up to which a product by the columns of those that are not 0 reads less memory than
one by the triangle."""


class DenseInverse:
    """A symmetric matrix whose products with vectors of many zeros read only the columns that these need.

    At most contact nodes of a wide face there is often no force: of a plate with a hole 90 % of the products in a load
    history have less than a third of the forces.  The columns are gathered from the triangle as they are needed, and
    kept, since the forces of the next product are mostly at the same nodes.

    Args:
        lower: The lower triangle, shape (n, n), Fortran order; entries above the diagonal are undefined.

    Attributes:
        size: n.
    """

    def __init__(self, lower: FloatArray):
        self._lower = lower
        self.size = n = len(lower)
        self._columns: FloatArray = np.empty((n, int(_FEW * n)), order="F")  # memory is taken as columns are filled
        self._place: npt.NDArray[np.int64] = np.full(n, -1)
        self._count = 0

    def __matmul__(self, z: FloatArray) -> FloatArray:
        """The product with z, shape (n,)."""
        room = self._columns.shape[1]
        if np.count_nonzero(z) > room:
            product: FloatArray = dsymv(1.0, self._lower, z, lower=1)
            return product
        needed = np.flatnonzero(z)
        new = needed[self._place[needed] < 0]
        if self._count + len(new) > room:  # forget those of earlier forces
            self._place[:], self._count, new = -1, 0, needed
        if len(new):
            self._gather(new)
        few = np.zeros(self._count)
        few[self._place[needed]] = z[needed]
        product = self._columns[:, : self._count] @ few
        return product

    def _gather(self, new: npt.NDArray[np.integer[Any]]) -> None:
        here = slice(self._count, self._count + len(new))
        self._columns[:, here] = self._lower[new].T
        for at, column in zip(range(self._count, here.stop), new, strict=True):
            self._columns[column:, at] = self._lower[column:, column]
        self._place[new] = np.arange(here.start, here.stop)
        self._count = here.stop
