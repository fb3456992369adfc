"""Materials of a body by groups of cells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from .. import compat
from ..geometry import evaluate_vectors, on_all_ranks
from ..meshes import NamedMesh
from .body import Material
from .orthotropic import COORDINATE_AXES, CellMaterials, Directional, OrthotropicMaterial, perpendicular

AnyMaterial = Material | OrthotropicMaterial

Materials = AnyMaterial | Mapping[str, AnyMaterial]
"""A material for the whole body, or one per group of cells, by name."""

Cells = slice | npt.NDArray[np.int32]


def by_group(materials: Materials) -> list[tuple[str | None, AnyMaterial]]:
    """Every material with its group of cells; None is the whole body."""
    return list(materials.items()) if isinstance(materials, Mapping) else [(None, materials)]


def material_of_cells(mesh: NamedMesh, materials: Materials, heated: bool = False) -> CellMaterials:
    """Elastic constants of this rank's own cells, and thermal expansion if the body has a temperature; collective.

    Raises:
        ValueError: On every rank, if a group is unknown, or a cell of any rank is in no group given or in two; if
            directions of place have no values; or if a temperature is given, and a material has no expansion.
    """
    count = mesh.domain.topology.index_map(3).size_local
    for _, given in by_group(materials):
        if not isinstance(given, AnyMaterial):
            raise ValueError(
                "material must be a Material, an OrthotropicMaterial, or a mapping of cell groups to these, but is "
                f"{given!r}"
            )
    _refuse_wrong_cells(mesh, materials, count)
    if heated:
        _refuse_without(materials, "expansion", "a temperature needs the thermal expansion", "expansion, 1/K")
    young, poisson = np.zeros((2, count))
    directional = any(isinstance(material, OrthotropicMaterial) for _, material in by_group(materials))
    young3, poisson3, shear3 = np.zeros((3, count, 3))
    of_cells = Directional(young3, poisson3, shear3, np.zeros((count, 3, 3)))
    expansion = np.zeros((count, 3))
    for material, cells in _with_cells(mesh, materials):
        of_cells.young[cells], of_cells.poisson[cells] = material.young, material.poisson
        of_cells.shear[cells] = _shear(material)
        young[cells], poisson[cells] = of_cells.young[cells, 0], of_cells.poisson[cells, 0]
        expansion[cells] = 0.0 if material.expansion is None else material.expansion
        if directional:
            of_cells.axes[cells] = _axes(mesh, material, cells)
    along = expansion if directional else expansion[:, 0]
    return CellMaterials(young, poisson, of_cells if directional else None, along if heated else None)


def density_of_cells(mesh: NamedMesh, materials: Materials) -> FloatArray:
    """Density of this rank's own cells in kg/m^3, shape (c,); ValueError on every rank if a material has none."""
    _refuse_without(materials, "density", "gravity needs the density", "density, kg/m^3")
    density = np.zeros(mesh.domain.topology.index_map(3).size_local)
    for material, cells in _with_cells(mesh, materials):
        density[cells] = material.density
    return density


def _refuse_wrong_cells(mesh: NamedMesh, materials: Materials, count: int) -> None:
    times = np.zeros(count, dtype=np.int64)
    for _, cells in _with_cells(mesh, materials):
        times[cells] += 1
    for wrong, fault in ((times == 0, "without a material"), (times > 1, "in more than one of these groups")):
        bad = mesh.comm.allreduce(int(wrong.sum()), op=MPI.SUM)
        if bad and isinstance(materials, Mapping):
            all_cells = mesh.comm.allreduce(count, op=MPI.SUM)
            raise ValueError(
                f"material: {bad} of {all_cells} cells are {fault}; materials are given for {', '.join(materials)}, "
                f"the mesh has the cell groups {', '.join(mesh.cells) or '(none)'}; every cell needs exactly one"
            )


def _refuse_without(materials: Materials, name: str, needs: str, key: str) -> None:
    without = [group for group, material in by_group(materials) if getattr(material, name) is None]
    if without:
        of = "" if without == [None] else f" of {', '.join(map(str, without))}"
        raise ValueError(f"{needs} of every material, but the material{of} has none: {key}")


def _shear(material: AnyMaterial) -> float | tuple[float, float, float]:
    if isinstance(material, OrthotropicMaterial):
        return material.shear
    return material.young / (2.0 * (1.0 + material.poisson))


def _axes(mesh: NamedMesh, material: AnyMaterial, cells: Cells) -> FloatArray:
    """Rows d1, d2, d3 at the midpoints of cells, shape (c, 3, 3); collective."""
    given = material.directions if isinstance(material, OrthotropicMaterial) else COORDINATE_AXES
    x = midpoints(mesh.domain)[: mesh.domain.topology.index_map(3).size_local][cells]
    first, second = (evaluate_vectors(direction, x, "material: directions", mesh.comm) for direction in given)
    return on_all_ranks(lambda: perpendicular(first, second, x), "", mesh.comm)


def midpoints(domain: object) -> FloatArray:
    """Mean of the nodes of every cell of this rank, ghosts included, metres, shape (c, 3)."""
    middle: FloatArray = domain.geometry.x[compat.cell_geometry(domain)].mean(axis=1)  # type: ignore[attr-defined]
    return middle


def _with_cells(mesh: NamedMesh, materials: Materials) -> Iterator[tuple[AnyMaterial, Cells]]:
    for name, material in by_group(materials):
        yield material, slice(None) if name is None else mesh.group(name, "material")
