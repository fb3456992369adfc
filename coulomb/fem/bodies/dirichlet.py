"""DOLFINx's boundary conditions as held directions with prescribed displacements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from .. import compat_forms
from ..geometry import first_place, on_all_ranks
from .constraints import prescribed_rows


class DirichletConditions:
    """Boundary conditions on a space of displacements or its components; where they meet, the later one applies.

    Args:
        bcs: The conditions.
        x: Coordinates of this rank's nodes in metres, shape (k, 3).
        dofs: Number of degrees of freedom of this rank, ghosts included.
        comm: The ranks.

    Attributes:
        rows: The rows d . u = value; the number of a support is that of its condition.
    """

    def __init__(self, bcs: Sequence[Any], x: FloatArray, dofs: int, comm: MPI.Comm):
        self._bcs, self._x, self._dofs, self._comm = tuple(bcs), x, dofs, comm
        self.rows = prescribed_rows(len(x), [self._directions(bc) for bc in bcs])

    @property
    def count(self) -> int:
        """Number of conditions."""
        return len(self._bcs)

    def prescribed(self) -> FloatArray:
        """The displacements that they prescribe now, 0 elsewhere, metres, shape (k, 3); collective.

        Raises:
            ValueError: On every rank, if one is not finite.
        """
        values = np.zeros(self._dofs)
        for bc in self._bcs:
            compat_forms.set_values(bc, values)
        nodal = values[: self._x.size].reshape(-1, 3)
        held = np.zeros_like(self._x)
        held[self.rows.held.components] = nodal[self.rows.held.components]

        def finite() -> FloatArray:
            if not np.all(np.isfinite(held)):
                place = first_place(self._x, ~np.all(np.isfinite(held), axis=1))
                raise ValueError(f"a prescribed displacement is not finite (first seen at x = {place})")
            return held

        return on_all_ranks(finite, "Body: bcs", self._comm)

    def words(self) -> list[dict[str, Any]]:
        """Kind, face and what it holds of every condition; collective."""
        entries = []
        for bc in self._bcs:
            mine = self._held(bc)
            nodes = self._comm.allreduce(int(np.sum(np.any(mine, axis=1))), op=MPI.SUM)
            along = self._comm.allreduce(np.any(mine, axis=0).astype(int), op=MPI.SUM)
            letters = ", ".join(letter for letter, held in zip("xyz", along, strict=True) if held)
            entries.append({"kind": "dirichlet", "face": None, "holds": f"{letters or 'nothing'} of {nodes} nodes"})
        return entries

    def _held(self, bc: Any) -> npt.NDArray[np.bool_]:
        """Which components of this rank's nodes a condition holds, shape (k, 3)."""
        held = np.zeros(self._x.size, dtype=bool)
        dofs = np.asarray(bc.dof_indices()[0])
        held[dofs[dofs < self._x.size]] = True
        return held.reshape(-1, 3)

    def _directions(self, bc: Any) -> tuple[npt.NDArray[np.int64], FloatArray]:
        held = self._held(bc)
        nodes = np.flatnonzero(np.any(held, axis=1))
        return nodes, held[nodes][:, :, None] * np.eye(3)
