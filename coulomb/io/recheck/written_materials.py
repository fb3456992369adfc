"""Materials in summary.json, compared with the constants of the cells in solution.xdmf."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...arrays import FloatArray
from ...fem.cell_materials import EXPANSION, ISOTROPIC, ORTHOTROPIC, ORTHOTROPIC_EXPANSION
from ..run_files import WrittenRun
from .comparison import Comparison


def compare_materials(run: WrittenRun, found: Comparison) -> None:
    """Check that the materials in summary.json are those of the cells."""
    directional = ORTHOTROPIC[0] in run.on_cells
    names = [*(ORTHOTROPIC[:3] if directional else ISOTROPIC)]
    names += [name for name in (EXPANSION, ORTHOTROPIC_EXPANSION) if name in run.on_cells]
    cells = np.column_stack([run.on_cells[name] for name in names])
    heated = len(names) > (3 if directional else 2)
    given = run.summary.get("material")
    try:
        rows = [_constants(entry, directional, heated) for entry in given or []]
        listed = np.array(rows).reshape(-1, cells.shape[1])
    except (KeyError, TypeError, ValueError):
        listed = np.empty((0, cells.shape[1]))
    kinds = np.unique(np.round(cells / np.maximum(np.abs(cells).max(axis=0), 1e-300), 12), axis=0, return_index=True)[1]

    def among(one: FloatArray, others: FloatArray) -> bool:
        return bool(np.any(np.all(np.abs(others - one) <= 1e-9 * np.abs(one), axis=1)))

    known = all(among(cells[k], listed) for k in kinds)
    if not (len(listed) and known and all(among(entry, cells) for entry in listed)):
        found.fault("summary.json.material: is not that of the cells in solution.xdmf")


def _constants(entry: Mapping[str, Any], directional: bool, heated: bool) -> list[float]:
    """The constants of a material as in a row of the cells."""
    young, poisson = entry["young"], entry["poisson"]
    last = [entry["expansion"]] if heated else []
    if not directional:
        return [float(young), float(poisson), *map(float, last)]
    shear = entry["shear"] if "shear" in entry else young / (2.0 * (1.0 + poisson))
    return [value for part in (young, poisson, shear, *last) for value in np.broadcast_to(part, 3).astype(float)]
