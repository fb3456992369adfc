"""Every contact by its own compliance and force: what is stiff beside what is soft has errors of its own.

One mean compliance and one norm of all forces hide a node of steel beside nodes of foam: its compliance is a millionth
of theirs, and an error of its whole force changes their residual by 1e-8.  So at contact i, with the entries a_n and
a_t (the mean of two) of diag(A) there,

    left_i = x_i - P(x_i - w_i / (a_n, a_t, a_t)),   residual = max_i |left_i| / s_i,
    s_i = max(|x_i|, 1e-2 of the largest force on the same body, or of a part of its loads b/a).

Open contacts keep forces of 1e-14 of the largest, and grazing ones (x = w = 0) the square root of the path's theta: by
their own force alone they would never be right, hence the second term.  A body without contact forces has only loads.

Contacts of different compliance that belong to one body, or to bodies that touch, act on each other: an error e of the
force of a soft one, which its own residual says to be small, moves a stiff one s times stiffer by up to e/sqrt(s).  So
the errors left_i are carried on: |A left|_i / a_i is what they do at contact i (one product).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from ..arrays import FloatArray
from ..linalg.reductions import Reductions

SHARE: Final = 1e-2
"""No contact is judged by less than this part of the largest force on its body."""

_LOADS: Final = (1e-3, 1e-6)
"""No force on a body counts as the largest below these parts of the smallest and the largest load |b|/a on it: of a
body that touches nothing the smallest is the force that would close its gap."""

_NOTHING: Final = 1e-8
"""A body whose sqrt(a) f is less than this part of the largest of a body has no forces beside rounding errors of the
others, and is judged by that one's energy a f^2."""

_MIXED: Final = 100.0
"""Largest over smallest compliance from which on contacts are told apart."""


@dataclass(frozen=True, eq=False)
class ContactScales:
    """Compliances of contacts and the bodies to which they belong; this rank's part.

    Attributes:
        compliance: a_n, a_t, a_t of every contact, metres per newton, shape (m, 3).
        body: Number of the body of every contact, from 0, the same on all ranks, shape (m,).
        over: Reductions over the ranks.
        group: Likewise of the bodies that contacts join, between which forces go on; None: the bodies themselves.
    """

    compliance: FloatArray
    body: npt.NDArray[np.int64]
    over: Reductions
    group: npt.NDArray[np.int64] | None = None

    @classmethod
    def of(
        cls,
        diagonal: FloatArray,
        body: npt.NDArray[np.int64] | None,
        over: Reductions,
        group: npt.NDArray[np.int64] | None = None,
    ) -> ContactScales:
        """From diag(A), shape (3 m,); along tangents without compliance, where friction moves nothing, that of n."""
        d = diagonal.reshape(-1, 3)
        t = 0.5 * (d[:, 1] + d[:, 2])
        t = np.where(t > 0.0, t, d[:, 0])
        body = np.zeros(len(d), dtype=np.int64) if body is None else body
        return cls(np.column_stack([d[:, 0], t, t]), body, over, group)

    @property
    def of_groups(self) -> ContactScales:
        """Of what contacts join in place of single bodies."""
        return self if self.group is None else ContactScales(self.compliance, self.group, self.over)

    @cached_property
    def bodies(self) -> int:
        """Number of bodies, over all ranks."""
        return 1 + int(max(self.over.max(self.body.astype(np.float64)), 0.0))

    @cached_property
    def mixed(self) -> bool:
        """Whether compliances differ so much that errors of soft contacts matter at stiff ones."""
        a = self.compliance[:, 0]
        return self.over.max(a) > _MIXED * self.over.min(a)

    def largest(self, sizes: FloatArray) -> FloatArray:
        """Largest of the sizes (m,) on every body, 0 without any, shape (bodies,)."""
        largest = np.zeros(self.bodies)
        np.maximum.at(largest, self.body, sizes)
        return self.over.largest(largest)

    def norms(self, vectors: FloatArray) -> FloatArray:
        """Norm of vectors (m, 3) on every body, shape (bodies,)."""
        size = sizes(vectors)
        unit = self.over.max(np.append(size, 0.0))
        if not 0.0 < unit < math.inf:
            return np.full(self.bodies, unit)
        return unit * np.sqrt(self.sums((size / unit) ** 2))

    def sums(self, values: FloatArray) -> FloatArray:
        """Sum of the values (m,) on every body, shape (bodies,)."""
        sums = np.asarray(np.bincount(self.body, values, self.bodies), dtype=np.float64)
        return self.over.total(sums)

    def of_bodies(self, x: FloatArray, loads: FloatArray) -> FloatArray:
        """Force of every body in newtons, shape (bodies,): its largest contact force, or a part of its loads.

        Args:
            x: Contact forces in newtons, shape (3 m,).
            loads: What they close in metres, shape (3 m,).
        """
        felt, forces = sizes(loads.reshape(-1, 3) / self.compliance), sizes(x.reshape(-1, 3))
        least: FloatArray = np.full(self.bodies, -np.inf)
        np.maximum.at(least, self.body, -felt)
        least = np.maximum(-self.over.largest(least), 0.0)
        loaded = np.maximum(_LOADS[0] * np.where(least < np.inf, least, 0.0), _LOADS[1] * self.largest(felt))
        return self.no_less(np.maximum(self.largest(forces), loaded), 0.0)

    def no_less(self, forces: FloatArray, part: float) -> FloatArray:
        """Forces f of the bodies in newtons, of which sqrt(a) f is at least a part of the largest, shape (bodies,)."""
        if self.bodies == 1:
            return forces
        root = np.sqrt(self._mean)
        most = float(np.max(root * forces))
        return np.maximum(forces, np.where(root * forces > _NOTHING * most, part, 1.0) * most / root)

    @cached_property
    def _mean(self) -> FloatArray:
        """Mean compliance of the contacts of every body along n, of all for one without, shape (bodies,)."""
        sums, count = self.sums(self.compliance[:, 0]), self.sums(np.ones(len(self.compliance)))
        of_all = float(np.sum(sums)) / max(float(np.sum(count)), 1.0)
        mean = np.where(count > 0.0, sums / np.maximum(count, 1.0), of_all)
        return np.where(mean > 0.0, mean, of_all if of_all > 0.0 else 1.0)

    def moved(self, change: FloatArray, x: FloatArray) -> float:
        """Largest change of a force, (m, 3), over the largest of the forces x (m, 3) on its body; collective."""
        most = self.largest(sizes(x))[self.body]
        return self.over.max(np.append(relative(change, np.where(most > 0.0, most, math.inf)), 0.0))

    def of_contacts(self, x: FloatArray, loads: FloatArray) -> FloatArray:
        """s_i in newtons, shape (m,); arguments as of `of_bodies`."""
        return np.maximum(sizes(x.reshape(-1, 3)), SHARE * self.of_bodies(x, loads)[self.body])


def sizes(vectors: FloatArray) -> FloatArray:
    """Norms of vectors (m, 3), whose squares may overflow or vanish; shape (m,)."""
    unit = float(np.max(np.abs(vectors), initial=0.0))
    if not 0.0 < unit < math.inf:
        return np.max(np.abs(vectors), axis=1, initial=0.0)
    v = vectors / unit
    return unit * np.sqrt(np.einsum("ij,ij->i", v, v))


def relative(left: FloatArray, scale: FloatArray) -> FloatArray:
    """Sizes of vectors (m, 3) over scales (m,), 0 where they vanish; shape (m,)."""
    size = sizes(left)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(size == 0.0, 0.0, size / scale)
