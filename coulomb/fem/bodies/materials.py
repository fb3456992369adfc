"""Isotropic and orthotropic linear elastic materials, and those of the groups of cells of a body.

Orthotropic ones have constants along three perpendicular directions.
Stresses and strains are written as six numbers in the order 11, 22, 33, 23, 13, 12 (Voigt), the shear strains doubled.
Along the directions of the material the compliance is

    S = [ 1/E1  -nu12/E1  -nu13/E1 ]
        [        1/E2     -nu23/E2 ]      and 1/G23, 1/G13, 1/G12 for the shear strains;
        [  symmetric       1/E3    ]

nu_ij is the contraction along j over the extension along i under a stress along i, so that nu_ji = nu_ij E_j/E_i.  The
strain energy is positive if |nu_ij| < sqrt(E_i/E_j), and the determinant of the block above is positive (Lempriere
1968).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np

from ...arrays import BoolArray, FloatArray, Int32Array, is_number, real_numbers, short
from .. import compat
from ..geometry import Coefficient, Field, evaluate_numbers, evaluate_vectors, first_place, of_place, on_all_ranks
from ..meshes import NamedMesh

ISOTROPIC = ("young", "poisson")
"""Fields of a body without orthotropic cells: numbers."""

ORTHOTROPIC = ("orthotropic_young", "orthotropic_poisson", "orthotropic_shear", "direction_1", "direction_2")
"""Fields of a body with orthotropic cells: three numbers along the directions; and these."""

EXPANSION, ORTHOTROPIC_EXPANSION = "expansion", "orthotropic_expansion"
"""Fields of a body with a temperature: a number, or with orthotropic cells three."""

VECTORS = (*ORTHOTROPIC, ORTHOTROPIC_EXPANSION)
"""Fields with three numbers per cell; the others have one."""

FIELDS = (*ISOTROPIC, EXPANSION, *VECTORS)


@dataclass(frozen=True, eq=False)
class Directional:
    """Orthotropic constants of c cells; isotropic cells have three equal ones.

    Attributes:
        young: E1, E2, E3 in pascals, shape (c, 3).
        poisson: nu12, nu13, nu23, shape (c, 3).
        shear: G12, G13, G23 in pascals, shape (c, 3).
        axes: The directions as rows, perpendicular unit vectors, shape (c, 3, 3).
    """

    young: FloatArray
    poisson: FloatArray
    shear: FloatArray
    axes: FloatArray


@dataclass(frozen=True, eq=False)
class CellMaterials:
    """Elastic constants of this rank's own c cells.

    Attributes:
        young: Young's modulus in pascals, shape (c,); of an orthotropic cell E1.
        poisson: Poisson's ratio, shape (c,); of an orthotropic cell nu12.
        directional: Orthotropic constants of all cells; None if no cell of any rank is orthotropic.
        expansion: Coefficient of thermal expansion in 1/K, shape (c,), or with orthotropic cells along their
            directions, shape (c, 3); None without a temperature.
    """

    young: FloatArray
    poisson: FloatArray
    directional: Directional | None = None
    expansion: FloatArray | None = None

    @property
    def stiffness(self) -> FloatArray | None:
        """The 21 constants of the stiffness in space, pascals, shape (c, 21); None without orthotropic cells."""
        given = self.directional
        return None if given is None else stiffness(given.young, given.poisson, given.shear, given.axes)

    def thermal_stress(self, constants: FloatArray | None) -> tuple[FloatArray, FloatArray] | None:
        """Stiffness times thermal strain, per kelvin, in Pa/K: the pressure, shape (c,), or with orthotropic cells, of
        the stiffness `constants`, the stress, shape (c, 6); and this times the thermal strain, J/(m^3 K^2), shape
        (c,).  None without a temperature."""
        if self.expansion is None:
            return None
        if self.directional is None or constants is None:
            pressure: FloatArray = self.young * self.expansion / (1.0 - 2.0 * self.poisson)
            return pressure, 3.0 * pressure * self.expansion
        strain = thermal_strain(self.expansion, self.directional.axes)
        stress = np.einsum("cij,cj->ci", symmetric(constants), strain)
        return stress, np.einsum("ci,ci->c", stress, strain)

    @property
    def fields(self) -> dict[str, FloatArray]:
        """As in solution.xdmf."""
        given = self.directional
        if given is None:
            fields = dict(zip(ISOTROPIC, (self.young, self.poisson), strict=True))
        else:
            values = (given.young, given.poisson, given.shear, given.axes[:, 0], given.axes[:, 1])
            fields = dict(zip(ORTHOTROPIC, values, strict=True))
        if self.expansion is not None:
            fields[EXPANSION if given is None else ORTHOTROPIC_EXPANSION] = self.expansion
        return fields

    @staticmethod
    def of_fields(fields: Mapping[str, FloatArray]) -> CellMaterials:
        """The constants from `fields`; KeyError if one is missing, ValueError if orthotropic ones have no positive
        strain energy, or directions are parallel."""
        if ORTHOTROPIC[0] not in fields:
            return CellMaterials(fields["young"], fields["poisson"], None, fields.get(EXPANSION))
        young, poisson, shear, first, second = (fields[name] for name in ORTHOTROPIC)
        if not (np.all(young > 0.0) and np.all(shear > 0.0)):
            raise ValueError("material: Young's and shear moduli must be positive")
        refuse_indefinite(young, poisson)
        given = Directional(young, poisson, shear, perpendicular(first, second))
        return CellMaterials(young[:, 0], poisson[:, 0], given, fields.get(ORTHOTROPIC_EXPANSION))


Triple = tuple[float, float, float]

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Indices of the six components of a symmetric tensor."""

UPPER = tuple((i, j) for i in range(6) for j in range(i, 6))
"""Indices of the 21 constants of a symmetric 6 x 6 matrix."""

_PARALLEL: Final = 1e-6
"""Sine of the angle between two directions below which they count as parallel."""

_ZERO: Final = 1e-12
"""Length of a direction over that of the longest at which it is a rounding error, as on the axis of a wound shaft."""

_AT_ONCE: Final = 50_000
"""Cells whose stiffness is rotated at a time, so that little memory is needed besides the result."""

COORDINATE_AXES: tuple[Triple, Triple] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


@dataclass(frozen=True)
class OrthotropicMaterial:
    """Orthotropic, linear elastic: three perpendicular directions, each with its own constants.

    Attributes:
        young: Young's moduli E1, E2, E3 along the directions in pascals, > 0.
        poisson: Poisson's ratios nu12, nu13, nu23; nu12 is the contraction along the second direction over the
            extension along the first, under a stress along the first.
        shear: Shear moduli G12, G13, G23 in pascals, > 0.
        directions: The first and the second direction: vectors, or functions of place x, shape (3, k), that return
            vectors, shape (3, k), evaluated at the midpoint of each cell.  Lengths do not matter; of the second the
            part perpendicular to the first is used; the third is perpendicular to both.
        density: Density in kg/m^3, 0 of parts whose weight is left out; only gravity needs it.
        expansion: Coefficient of thermal expansion in 1/K, one number or three along the directions; only a temperature
            needs it.
        conductivity: Thermal conductivity in W/(m K), > 0, the same in all directions; only heat needs it.

    Raises:
        ValueError: If a constant is outside its bounds, the strain energy is not positive for every strain (with the
            condition), or the directions are no vectors or parallel.
    """

    young: Triple
    poisson: Triple
    shear: Triple
    directions: tuple[Field, Field] = COORDINATE_AXES
    density: float | None = None
    expansion: float | Triple | None = None
    conductivity: float | None = None

    def __post_init__(self) -> None:
        _refuse_not_positive(self)
        for name, unit in (("young", "Young's moduli in pascals"), ("shear", "shear moduli in pascals")):
            if not np.all(three(getattr(self, name), f"material: {name}", unit) > 0.0):
                raise ValueError(f"material: {name} must be three positive {unit}, but is {short(getattr(self, name))}")
        three(self.poisson, "material: poisson", "Poisson's ratios")
        refuse_indefinite(np.array([self.young]), np.array([self.poisson]))
        if self.expansion is not None and not _finite(self.expansion):
            raise ValueError(
                f"material: expansion must be a finite number in 1/K, or three, but is {short(self.expansion)}"
            )
        if not isinstance(self.directions, Sequence) or len(self.directions) != 2:
            raise ValueError(
                f"material: directions must be two, the first and the second, each a vector or a function of place, "
                f"but are {self.directions!r}"
            )
        given = [direction for direction in self.directions if not of_place(direction)]
        vectors = [three(direction, "material: directions", "components each") for direction in given]
        if len(vectors) == 2:
            perpendicular(np.array([vectors[0]]), np.array([vectors[1]]))

    @property
    def constant(self) -> bool:
        """Whether the directions are the same everywhere."""
        return not any(of_place(direction) for direction in self.directions)


def three(given: object, what: str, unit: str) -> FloatArray:
    """Three finite numbers, shape (3,); ValueError if they are not."""
    try:
        values = real_numbers(given)
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise ValueError(f"{what} must be three finite {unit}, but is {short(given)}")
    return values


def refuse_indefinite(young: FloatArray, poisson: FloatArray) -> None:
    """ValueError, with the violated condition, unless the strain energy is positive for every strain; shapes (c, 3)."""
    for number, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        ratio, limit = np.abs(poisson[:, number]), np.sqrt(young[:, i] / young[:, j])
        wrong = ~(ratio < limit)
        if np.any(wrong):
            k, name = int(np.argmax(wrong)), f"nu{i + 1}{j + 1}"
            raise ValueError(
                f"material: poisson: {name} = {poisson[k, number]:g} gives a negative strain energy: |{name}| must be "
                f"below sqrt(E{i + 1}/E{j + 1}) = {limit[k]:.4g} ({name} is the contraction along {j + 1} over the "
                f"extension along {i + 1}; where nu{j + 1}{i + 1} is known, it is that times E{i + 1}/E{j + 1})"
            )
    determinant = _determinant(young, poisson)
    wrong = ~(determinant > 0.0)
    if np.any(wrong):
        k = int(np.argmax(wrong))
        raise ValueError(
            "material: poisson: the strain energy is not positive for every strain: 1 - nu12 nu21 - nu13 nu31 - nu23 "
            f"nu32 - 2 nu21 nu32 nu13 must be positive, but is {determinant[k]:.4g}, with nu_ji = nu_ij E_j/E_i and "
            f"(nu12, nu13, nu23) = ({', '.join(f'{value:g}' for value in poisson[k])})"
        )


def _determinant(young: FloatArray, poisson: FloatArray) -> FloatArray:
    """Of the compliance's upper left block, times E1 E2 E3; shape (c,)."""
    nu12, nu13, nu23 = poisson.T
    E1, E2, E3 = young.T
    nu21, nu31, nu32 = nu12 * E2 / E1, nu13 * E3 / E1, nu23 * E3 / E2
    return 1.0 - nu12 * nu21 - nu13 * nu31 - nu23 * nu32 - 2.0 * nu21 * nu32 * nu13


def perpendicular(first: FloatArray, second: FloatArray, x: FloatArray | None = None) -> FloatArray:
    """Rows d1, d2, d3 of right-handed perpendicular unit vectors, shape (c, 3, 3): d1 along the first directions (c,
    3), d2 along the part of the second that is perpendicular to it.

    Raises:
        ValueError: If a direction is zero, or both are parallel, with the first place in x (c, 3).
    """

    def refuse(wrong: BoolArray, fault: str) -> None:
        if np.any(wrong):
            place = "" if x is None else f", but are at x = {first_place(x, wrong)}"
            raise ValueError(f"material: directions: {fault}{place}")

    long, other = np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)
    zero = (long <= _ZERO * np.max(long, initial=0.0)) | (other <= _ZERO * np.max(other, initial=0.0))
    refuse(zero, "the two directions must not be zero")
    d1, d2 = first / long[:, None], second / other[:, None]
    d2 = d2 - np.einsum("ci,ci->c", d1, d2)[:, None] * d1
    sine = np.linalg.norm(d2, axis=1)
    refuse(sine < _PARALLEL, "the two directions must not be parallel")
    d2 = d2 / sine[:, None]
    return np.stack([d1, d2, np.cross(d1, d2)], axis=1)


def stiffness(young: FloatArray, poisson: FloatArray, shear: FloatArray, axes: FloatArray) -> FloatArray:
    """The 21 constants of the stiffness in space of every cell, pascals, in the order of `UPPER`, shape (c, 21);
    arguments as of `Directional`."""
    i, j = np.array(UPPER).T
    entries = np.empty((len(young), 21))
    for first in range(0, len(young), _AT_ONCE):
        here = slice(first, first + _AT_ONCE)
        T = strain_rotation(axes[here])
        entries[here] = (T.transpose(0, 2, 1) @ along_directions(young[here], poisson[here], shear[here]) @ T)[:, i, j]
    return entries


def along_directions(young: FloatArray, poisson: FloatArray, shear: FloatArray) -> FloatArray:
    """Stiffness along the directions of the material, pascals, shape (c, 6, 6); constants as for `stiffness`."""
    S = np.zeros((len(young), 6, 6))
    for k in range(3):
        S[:, k, k] = 1.0 / young[:, k]
        S[:, 3 + k, 3 + k] = 1.0 / shear[:, 2 - k]
    for number, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
        S[:, i, j] = S[:, j, i] = -poisson[:, number] / young[:, i]
    return np.linalg.inv(S)


def thermal_strain(expansion: FloatArray, axes: FloatArray) -> FloatArray:
    """Strain in space per kelvin, shape (c, 6), from expansion along the directions, rows of axes (c, 3, 3)."""
    strain = np.einsum("ck,cki,ckj->cij", expansion, axes, axes)
    return np.stack([(1.0 if i == j else 2.0) * strain[:, i, j] for i, j in PAIRS], axis=1)


def symmetric(constants: FloatArray) -> FloatArray:
    """The stiffness of cells by its 21 constants (c, 21), shape (c, 6, 6)."""
    i, j = np.array(UPPER).T
    full = np.empty((len(constants), 6, 6))
    full[:, i, j] = full[:, j, i] = constants
    return full


def strain_rotation(axes: FloatArray) -> FloatArray:
    """T with strain along the directions = T strain in space, shape (c, 6, 6); rows d1, d2, d3 in axes (c, 3, 3)."""
    i, j = np.array(PAIRS).T
    one, other = axes[:, i], axes[:, j]
    # a shear strain in space counts twice in the sum, and is doubled
    T = 0.5 * (one[:, :, i] * other[:, :, j] + one[:, :, j] * other[:, :, i])
    T[:, 3:] *= 2.0
    return T


def _finite(expansion: object) -> bool:
    try:
        values = real_numbers(expansion)
    except (TypeError, ValueError):
        return False
    return values.shape in ((), (3,)) and bool(np.all(np.isfinite(values)))


@dataclass(frozen=True)
class Material:
    """Isotropic, linear elastic.

    Attributes:
        young: Young's modulus in pascals, > 0; a number or, in small strains, a function of place, evaluated at the
            midpoint of each cell.
        poisson: Poisson's ratio, in (-1, 0.5).
        density: Density in kg/m^3, 0 of parts whose weight is left out; only gravity needs it.
        expansion: Coefficient of thermal expansion in 1/K; only a temperature needs it.
        conductivity: Thermal conductivity in W/(m K), > 0; only heat needs it.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    young: float | Any  # a Coefficient; computations with numbers are many
    poisson: float
    density: float | None = None
    expansion: float | None = None
    conductivity: float | None = None

    def __post_init__(self) -> None:
        _refuse_not_positive(self)
        if not (of_place(self.young) or (is_number(self.young) and self.young != 0.0)):
            raise ValueError(f"material: young must be a positive number of pascals, but is {short(self.young)}")
        if not (is_number(self.poisson, -1.0) and -1.0 < self.poisson < 0.5):
            raise ValueError(f"material: poisson must be a number in (-1, 0.5), but is {short(self.poisson)}")
        if self.expansion is not None and not is_number(self.expansion, -math.inf):
            raise ValueError(f"material: expansion must be a finite number in 1/K, but is {short(self.expansion)}")


AnyMaterial = Material | OrthotropicMaterial

Materials = AnyMaterial | Mapping[str, AnyMaterial]
"""A material for the whole body, or one per group of cells, by name."""

Cells = slice | Int32Array


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
        _refuse_without(materials, "expansion")
    directional = any(isinstance(material, OrthotropicMaterial) for _, material in by_group(materials))
    young, poisson, shear = np.zeros((3, count, 3))
    of_cells = Directional(young, poisson, shear, np.zeros((count, 3, 3)))
    expansion = np.zeros((count, 3))
    for material, cells in _with_cells(mesh, materials):
        modulus, poisson[cells] = _moduli(mesh, material, cells), material.poisson
        young[cells] = modulus
        if isinstance(material, OrthotropicMaterial):
            shear[cells] = material.shear
        else:
            shear[cells] = modulus / (2.0 * (1.0 + material.poisson))
        expansion[cells] = 0.0 if material.expansion is None else material.expansion
        if directional:
            of_cells.axes[cells] = _axes(mesh, material, cells)
    along = expansion if directional else expansion[:, 0]
    orthotropic = of_cells if directional else None
    return CellMaterials(young[:, 0], poisson[:, 0], orthotropic, along if heated else None)


def constant_of_cells(mesh: NamedMesh, materials: Materials, name: str) -> FloatArray:
    """The "density" in kg/m^3 or "conductivity" in W/(m K) of this rank's own cells, shape (c,); ValueError on every
    rank if a material has none."""
    _refuse_without(materials, name)
    values = np.zeros(mesh.domain.topology.index_map(3).size_local)
    for material, cells in _with_cells(mesh, materials):
        values[cells] = getattr(material, name)
    return values


def _refuse_not_positive(material: AnyMaterial) -> None:
    density, conductivity = material.density, material.conductivity
    if density is not None and not is_number(density):
        raise ValueError(f"material: density must be a number of kg/m^3, not below 0, but is {short(density)}")
    if conductivity is not None and not (is_number(conductivity) and conductivity > 0.0):
        raise ValueError(f"material: conductivity must be a positive number of W/(m K), but is {short(conductivity)}")


def _refuse_wrong_cells(mesh: NamedMesh, materials: Materials, count: int) -> None:
    times = np.zeros(count, dtype=np.int64)
    for _, cells in _with_cells(mesh, materials):
        times[cells] += 1
    for wrong, fault in ((times == 0, "without a material"), (times > 1, "in more than one of these groups")):
        bad = mesh.comm.allreduce(int(wrong.sum()))
        if bad and isinstance(materials, Mapping):
            all_cells = mesh.comm.allreduce(count)
            raise ValueError(
                f"material: {bad} of {all_cells} cells are {fault}; materials are given for {', '.join(materials)}, "
                f"the mesh has the cell groups {', '.join(mesh.cells) or '(none)'}; every cell needs exactly one"
            )


_NEEDED = {
    "expansion": ("a temperature needs the thermal expansion", "1/K"),
    "density": ("gravity needs the density", "kg/m^3"),
    "conductivity": ("heat needs the conductivity", "W/(m K)"),
}


def _refuse_without(materials: Materials, name: str) -> None:
    without = [group for group, material in by_group(materials) if getattr(material, name) is None]
    if without:
        of = "" if without == [None] else f" of {', '.join(map(str, without))}"
        needs, unit = _NEEDED[name]
        raise ValueError(f"{needs} of every material, but the material{of} has none: {name}, {unit}")


def _moduli(mesh: NamedMesh, material: AnyMaterial, cells: Cells) -> FloatArray:
    """Young's moduli of cells, shapes (), (3,) or (c, 1); collective."""
    if not of_place(material.young):
        return np.asarray(material.young, dtype=np.float64)
    x, what = _midpoints(mesh, cells), "material: young"
    values = evaluate_numbers(cast(Coefficient, material.young), x, what, mesh.comm)

    def positive() -> FloatArray:
        if np.any(zero := values == 0.0):
            raise ValueError(f"must be > 0 everywhere, but is 0 at x = {first_place(x, zero)}")
        return values[:, None]

    return on_all_ranks(positive, what, mesh.comm)


def _midpoints(mesh: NamedMesh, cells: Cells) -> FloatArray:
    return midpoints(mesh.domain)[: mesh.domain.topology.index_map(3).size_local][cells]


def _axes(mesh: NamedMesh, material: AnyMaterial, cells: Cells) -> FloatArray:
    """Rows d1, d2, d3 at the midpoints of cells, shape (c, 3, 3); collective."""
    given = material.directions if isinstance(material, OrthotropicMaterial) else COORDINATE_AXES
    x = _midpoints(mesh, cells)
    first, second = (evaluate_vectors(direction, x, "material: directions", mesh.comm) for direction in given)
    return on_all_ranks(lambda: perpendicular(first, second, x), "", mesh.comm)


def midpoints(domain: object) -> FloatArray:
    """Mean of the nodes of every cell of this rank, ghosts included, metres, shape (c, 3)."""
    return domain.geometry.x[compat.cell_geometry(domain)].mean(axis=1)  # type: ignore[attr-defined]


def _with_cells(mesh: NamedMesh, materials: Materials) -> Iterator[tuple[AnyMaterial, Cells]]:
    for name, material in by_group(materials):
        yield material, slice(None) if name is None else mesh.group(name, "material")
