"""Materials of a body by groups of cells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from .body import Material
from .named_mesh import NamedMesh

Materials = Material | Mapping[str, Material]
"""A material for the whole body, or one per group of cells, by name."""


def material_of_cells(mesh: NamedMesh, materials: Materials) -> tuple[FloatArray, FloatArray]:
    """Young's modulus and Poisson's ratio of this rank's own cells, shapes (c,).

    Raises:
        ValueError: On every rank, if a group is unknown, or a cell of any rank is in no group given or in two.
    """
    young, poisson = np.zeros((2, mesh.domain.topology.index_map(3).size_local))
    times = np.zeros(len(young), dtype=np.int64)
    for material, cells in _with_cells(mesh, materials):
        young[cells], poisson[cells] = material.young, material.poisson
        times[cells] += 1
    for wrong, fault in ((times == 0, "without a material"), (times > 1, "in more than one of these groups")):
        bad = mesh.comm.allreduce(int(wrong.sum()), op=MPI.SUM)
        if bad and not isinstance(materials, Material):
            all_cells = mesh.comm.allreduce(len(young), op=MPI.SUM)
            raise ValueError(
                f"material: {bad} of {all_cells} cells are {fault}; materials are given for {', '.join(materials)}, "
                f"the mesh has the cell groups {', '.join(mesh.cells) or '(none)'}; every cell needs exactly one"
            )
    return young, poisson


def density_of_cells(mesh: NamedMesh, materials: Materials) -> FloatArray:
    """Density of this rank's own cells in kg/m^3, shape (c,).

    Raises:
        ValueError: On every rank, if a material has no density.
    """
    groups: list[tuple[str | None, Material]]
    groups = [(None, materials)] if isinstance(materials, Material) else list(materials.items())
    without = [name for name, material in groups if material.density is None]
    if without:
        of = "" if without == [None] else f" of {', '.join(map(str, without))}"
        raise ValueError(f"gravity needs the density of every material, but the material{of} has none: density, kg/m^3")
    density = np.zeros(mesh.domain.topology.index_map(3).size_local)
    for material, cells in _with_cells(mesh, materials):
        density[cells] = material.density
    return density


def _with_cells(mesh: NamedMesh, materials: Materials) -> Iterator[tuple[Material, slice | npt.NDArray[np.int32]]]:
    """Every material with this rank's own cells of it."""
    if isinstance(materials, Material):
        yield materials, slice(None)
        return
    for name, material in materials.items():
        yield material, mesh.group(name, "material")
