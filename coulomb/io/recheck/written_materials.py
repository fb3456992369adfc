"""Materials in summary.json, compared with the constants of the cells in solution.xdmf."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...arrays import FloatArray
from ...fem.bodies import EXPANSION, ISOTROPIC, ORTHOTROPIC, ORTHOTROPIC_EXPANSION
from ...fem.meshes import SEPARATOR
from ..run_files import WrittenRun
from ..written_bodies import WrittenBody
from .comparison import Comparison


def in_body(name: str, body: WrittenBody) -> str:
    """A field of solution.xdmf in messages, with the name of its body if there are several."""
    return f"solution.xdmf: {name}{f' of {body.name}' if body.name else ''}"


def compare_materials(run: WrittenRun, found: Comparison) -> None:
    """Check that the materials in summary.json are those of the cells; bodies of the user's forms have none."""
    given = run.summary.get("material")
    listed: Any = given if isinstance(given, list) else []
    matches = [_matches(body, _of_body(listed, body)) for body in run.body.parts if body.elastic is not None]
    if not all(matches):
        found.fault("summary.json.material: is not that of the cells in solution.xdmf")


def _of_body(listed: Any, body: WrittenBody) -> list[Any]:
    """The entries of one body: their cells are called "body" or "body:cells"."""
    if not body.name:
        return list(listed)
    named = [(entry, entry.get("cells") if isinstance(entry, Mapping) else None) for entry in listed]
    return [entry for entry, cells in named if isinstance(cells, str) and cells.partition(SEPARATOR)[0] == body.name]


def _matches(body: WrittenBody, given: list[Any]) -> bool:
    """Whether the constants of the cells of a body are those listed."""
    directional = ORTHOTROPIC[0] in body.on_cells
    names = [*(ORTHOTROPIC[:3] if directional else ISOTROPIC)]
    names += [name for name in (EXPANSION, ORTHOTROPIC_EXPANSION) if name in body.on_cells]
    cells = np.column_stack([body.on_cells[name] for name in names])
    heated = len(names) > (3 if directional else 2)
    try:
        rows = [_constants(entry, directional, heated) for entry in given]
        listed = np.array(rows).reshape(-1, cells.shape[1])
    except (KeyError, TypeError, ValueError):
        listed = np.empty((0, cells.shape[1]))
    kinds = np.unique(np.round(cells / np.maximum(np.abs(cells).max(axis=0), 1e-300), 12), axis=0, return_index=True)[1]

    def among(one: FloatArray, others: FloatArray) -> bool:
        return bool(np.any(np.all(np.abs(others - one) <= 1e-9 * np.abs(one), axis=1)))

    known = all(among(cells[k], listed) for k in kinds)
    return bool(len(listed) and known and all(among(entry, cells) for entry in listed))


def _constants(entry: Mapping[str, Any], directional: bool, heated: bool) -> list[float]:
    """The constants of a material as in a row of the cells."""
    young, poisson = entry["young"], entry["poisson"]
    last = [entry["expansion"]] if heated else []
    if not directional:
        return [float(young), float(poisson), *map(float, last)]
    shear = entry["shear"] if "shear" in entry else young / (2.0 * (1.0 + poisson))
    return [value for part in (young, poisson, shear, *last) for value in np.broadcast_to(part, 3).astype(float)]
