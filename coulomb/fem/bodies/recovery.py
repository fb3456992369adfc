"""The error of the stress, in the energy norm, by the difference from a recovered, continuous stress.

The error of s_h, the stress of the displacement, is estimated by eta,

    eta_K^2 = integral over the cell K of (s* - s_h) : C^-1 : (s* - s_h)                 (Zienkiewicz and Zhu 1987)

with a recovered stress s* that is continuous and closer to the exact one.  Each vertex v has a polynomial P_v of the
order of the elements, fitted by least squares to s_h in the cells around v, at the points where s_h is most accurate
(superconvergent patch recovery, Zienkiewicz and Zhu 1992); s* is their mean with the linear functions N_v of the
vertices (Blacker and Belytschko 1994):

    s* = sum over v of N_v P_v

A stress that is a polynomial of this order and is in s_h exactly is s*: eta then vanishes.  The stress jumps between
materials, so that each material has polynomials of its own, from its own cells.

At a boundary the cells are on one side of v, and a polynomial fitted to them is a poor one at v.  Its quality is
Q = 1/(1 + z), z the square of the distance of v from the mean of the points, measured by their scatter (Mahalanobis):
1 inside, 0.25 or less on faces.  Where vertices of the same cells have better ones, P_v is mixed with their mean.

Measured, eta over the true error of smooth stresses on cubes, curved ones too, of isotropic (nu = 0.3 and 0.49) and
orthotropic materials, with n cells along an edge (of tetrahedra six in a cube), and of a block that is bent, with
singular edges at its clamp, n = 2, 4, 8 (1, 2, 4 in second order):

    elements           n      smooth        n    smooth        singular, nu = 0.3      singular, nu = 0.49
    8-node hexahedra   3, 4   1.0 to 1.1    12   1.00          0.89, 0.89, 0.87        0.49, 0.65, 0.78
    4-node tetrahedra  3, 4   0.93 to 0.97  12   0.99          0.61, 0.80, 0.88        0.27, 0.46, 0.67
    27-node hexahedra  2      1.0 to 3.0    6    0.99 to 1.14  0.61, 1.13, 0.93        0.53, 0.71, 0.65
    10-node tetrahedra 2      0.92 to 1.13  6    0.96 to 1.00  0.78, 0.79, 0.66        0.56, 0.76, 0.83

Near singular edges, where meshes are coarse for the stress, and where elements lock, eta is too small; in a single cell
it is zero: answers on other meshes tell more (`io.energy_error`).  Where a few graded cells of second order have a peak
it is much too large (Hertz on two cells under the contact: 18).  A projection onto continuous functions of the elements
by least squares is no choice: in second order its eta is 0.2 to 0.7 of the error, and on hexahedra tends to 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final, cast

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ...arrays import FloatArray, IntArray
from .. import compat
from ..compat import basix
from ..meshes import Exchange, corner_geometry, lagrange_slopes, lagrange_values, owner_of, starts_of
from .deformable import Deformable
from .elasticity import LoadedBody
from .materials import PAIRS, CellMaterials, by_group, symmetric

_FINE: Final = 1e-3
"""Weight in a fit of the points of the integrals, beside the best ones with 1.  It has a unique solution by them in a
single cell, too.  Without them nothing is known of the slope across a single layer of cells, and the bending stress
there counts as an error."""

_BETTER: Final = 1.5
"""Ratio of the qualities from which on a polynomial is mixed with another."""

_AT_ONCE: Final = 1000
"""Cells at a time, so that little memory is needed: some 40 kB for each."""


@dataclass(frozen=True, eq=False)
class StressError:
    """The estimated error of the stress of a body; this rank's own c cells.

    Attributes:
        squared: Of each cell, eta_K^2 in joules: twice the strain energy of the error; shape (c,).
        volume: Of each cell in m^3, shape (c,).
        modulus: Young's modulus of each cell in pascals, of orthotropic ones the harmonic mean of three, shape (c,).
        total: eta of all cells of all ranks, the square root of joules.
        norm: The same of the stress itself: the root of twice its strain energy, without that of a thermal strain.
        along: Of a box, the parts of eta_K^2 that more planes across x, across y and across z would make smaller, shape
            (3, c); else None.
    """

    squared: FloatArray
    volume: FloatArray
    modulus: FloatArray
    total: float
    norm: float
    along: FloatArray | None = None

    @property
    def relative(self) -> float:
        """eta over the norm: the error of the stress as a part of it."""
        return relative_error([self])

    @property
    def stress(self) -> FloatArray:
        """The error as a stress, pascals, shape (c,): the uniaxial stress with the energy of the error in the cell,
        sqrt(E eta_K^2/volume).

        It is in the unit of the von Mises stress and can be read beside it, does not become small merely because a cell
        is, and is largest where a finer mesh is needed most.
        """
        return np.sqrt(self.modulus * self.squared / self.volume)


def relative_error(errors: Iterable[StressError]) -> float:
    """eta of several bodies over the norm of their stresses; 0 without any stress."""
    squares = np.array([(one.total, one.norm) for one in errors]) ** 2
    error, norm = np.sqrt(squares.sum(axis=0))
    return float(error / norm) if norm != 0.0 else 0.0


def stress_errors(bodies: Deformable, u: FloatArray, change: FloatArray | None = None) -> dict[str, StressError]:
    """The errors of the bodies of a problem, by their names ("" if it is the only one); arguments and errors as of
    `stress_error`; collective."""
    return {
        member.name: stress_error(
            cast(LoadedBody, member.body), u[member.nodes], None if change is None else change[member.nodes]
        )
        for member in bodies.members
    }


def stress_error(body: LoadedBody, u: FloatArray, change: FloatArray | None = None) -> StressError:
    """The error of the stress of displacements u (k, 3) in metres of this rank's nodes, with a change of temperature
    (k,) in kelvin, which a body without a temperature ignores; collective.

    Raises:
        ValueError: If the stress is not known: of a body from the user's forms, or for large motions.
    """
    if not hasattr(body, "constants"):
        raise ValueError(
            "the error of the stress is known of linear elastic materials only: for a body from your own forms, or for "
            "large motions, it is not known which stress belongs to a strain"
        )
    cells = StressedCells(body, u, change)
    sums = np.zeros((3, cells.count))
    grid = body.mesh.grid
    along = None if grid is None else np.zeros((3, cells.count))
    X, weights = cells.integration()
    N = lagrange_values(cells.kind, 1, X)
    for of_material in _by_material(body, cells.count, cells.heated):
        polynomials = _recovered(cells, of_material)
        for part in _parts(of_material):
            terms, stress, volume = cells.at(part, X)
            vertices = cells.vertices[part]
            about = _moved(polynomials[vertices], cells.origins(part)[:, None] - cells.x[vertices], body.degree)
            between = N @ about.reshape(len(part), N.shape[1], -1)
            recovered = np.einsum("cqm,cqmk->cqk", terms, between.reshape(*terms.shape, 6))
            difference = recovered - stress
            volume *= weights
            for row, of in enumerate((difference, stress)):
                sums[row, part] = np.sum(cells.energy(part, of) * volume, axis=1)
            sums[2, part] = volume.sum(axis=1)
            if grid is not None and along is not None:
                highest = np.einsum("caq,cqk->cak", _highest(N, grid.corners[part], weights, body.degree), difference)
                along[:, part] = cells.energy(part, highest).T * sums[2, part]
    total, norm = np.sqrt(body.comm.allreduce(sums[:2].sum(axis=1)))
    return StressError(sums[0], sums[2], cells.modulus, float(total), float(norm), along)


def _highest(N: FloatArray, corners: IntArray, weights: FloatArray, degree: int) -> FloatArray:
    """Weights (c, 3, q) of values at q points in cells of a box, whose sums are the means over the cell, as the root of
    the square, of the parts with the highest power of x, y and z that a polynomial of this degree has.

    With the place s in the slab between two planes, 0 to 1, they are a (s - 1/2) or a (s^2 - s + 1/6), a by least
    squares: what the stress of a finite element lacks in the direction of its strain.

    Args:
        N: First-order functions of the corners at the points, shape (q, 4 or 8).
        weights: Of the points, shape (q,).
    """
    kinds, of_cell = np.unique(corners, axis=0, return_inverse=True)
    terms, root = _monomials(N @ kinds, degree), np.sqrt(weights)
    rows = slice(1, 4) if degree == 1 else slice(4, 7)
    size = math.sqrt(1.0 / 12.0 if degree == 1 else 1.0 / 180.0)
    functions: FloatArray = size * np.linalg.pinv(terms * root[:, None])[:, rows] * root
    return functions[of_cell.ravel()]


def _by_material(body: LoadedBody, count: int, heated: bool) -> list[IntArray]:
    """This rank's own cells of each material, the same materials in the same order on all ranks.

    Groups of cells with equal materials are one; a material with directions that are functions of place is one, too.
    """
    cells_of: dict[str, list[IntArray]] = {}
    for name, material in by_group(body.materials or {}):
        expansion = material.expansion if heated else None
        elastic = replace(cast(Any, material), density=None, conductivity=None, expansion=expansion)
        here = np.arange(count) if name is None else body.mesh.group(name, "material")
        cells_of.setdefault(repr(elastic), []).append(np.asarray(here, dtype=np.int64))
    return [np.concatenate(cells) for cells in cells_of.values()]


def _parts(cells: IntArray) -> Iterator[IntArray]:
    for first in range(0, len(cells), _AT_ONCE):
        yield cells[first : first + _AT_ONCE]


def _monomials(y: FloatArray, degree: int) -> FloatArray:
    """Those of places y (..., 3) up to a degree: 1, x, y, z, and in second order the products of `PAIRS`; shape (..., 4
    or 10)."""
    products = [y[..., i] * y[..., j] for i, j in PAIRS] if degree == 2 else []
    return np.stack([np.ones(y.shape[:-1]), *np.moveaxis(y, -1, 0), *products], axis=-1)


def _move_products(rows: FloatArray, d: FloatArray) -> None:
    """Change rows (..., m, w) for monomials at places y into those for y + d, d (..., 3)."""
    for row, (i, j) in zip(range(4, rows.shape[-2]), PAIRS, strict=False):
        product = d[..., i, None] * (rows[..., 1 + j, :] + d[..., j, None] * rows[..., 0, :])
        rows[..., row, :] += product + d[..., j, None] * rows[..., 1 + i, :]
    rows[..., 1:4, :] += d[..., None] * rows[..., :1, :]


def _moved(c: FloatArray, d: FloatArray, degree: int) -> FloatArray:
    """Coefficients (..., m, 6) of polynomials in y + d as such in y, d (..., 3)."""
    moved = c.copy()
    moved[..., 0, :] = np.einsum("...m,...mk->...k", _monomials(d, degree), c)
    for row, (i, j) in zip(range(4, c.shape[-2]), PAIRS, strict=False):
        moved[..., 1 + i, :] += d[..., j, None] * c[..., row, :]
        moved[..., 1 + j, :] += d[..., i, None] * c[..., row, :]
    return moved


def _points(cells: StressedCells, degree: int) -> tuple[FloatArray, FloatArray]:
    """Points of the reference cell (q, 3) and weights (q,) that integrate polynomials up to a degree."""
    points, weights = basix.make_quadrature(getattr(basix.CellType, cells.kind.name), degree)
    return np.asarray(points), np.asarray(weights)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of vectors (3, ...), in a tenth of the time of `np.cross`."""
    return np.stack([a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)])


class StressedCells:
    """This rank's own cells with displacements of their nodes; no thermal stress without a change of temperature.

    Attributes:
        vertices: Of every cell, by this rank's numbers of them, ghosts included, shape (c, 4 or 8).
        x: Places of vertices, metres, shape (v, 3); 0 of those of other ranks' cells only.
    """

    def __init__(self, body: LoadedBody, u: FloatArray, change: FloatArray | None):
        domain = self._domain = body.domain  # keeps the communicator alive
        topology = domain.topology
        self.kind, self.degree, self.comm = topology.cell_type, body.degree, domain.comm
        self.count = int(topology.index_map(3).size_local)
        self._points, self._nodes = (
            of[: self.count] for of in (compat.cell_geometry(domain), compat.cell_dofs(body.V))
        )
        values = body.function(u).x.array
        self._x, self._u, self._dilatation = domain.geometry.x, values.reshape(-1, 3), body.dilatation(values)
        corners = corner_geometry(domain)[: self.count]
        self.vertices = topology.connectivity(3, 0).array.reshape(-1, corners.shape[1])[: self.count]
        self.of_vertices = topology.index_map(0)
        self.x = np.zeros((self.of_vertices.size_local + self.of_vertices.num_ghosts, 3))
        self.x[self.vertices] = self._x[corners]
        material = CellMaterials.of_fields({name: self._own(given) for name, given in body.constants.items()})
        of_cells, stiffness = material.directional, material.stiffness
        self.modulus = material.young if of_cells is None else 3.0 / np.sum(1.0 / of_cells.young, axis=1)
        self._young, self._poisson, self._stiffness = material.young, material.poisson, stiffness
        thermal = None if change is None else material.thermal_stress(stiffness)
        self.heated = thermal is not None
        if change is not None and thermal is not None:
            per_kelvin = thermal[0] if thermal[0].ndim == 2 else thermal[0][:, None] * np.repeat([1.0, 0.0], 3)
            self._per_kelvin = per_kelvin
            kelvin = body.function(np.repeat(change[:, None], 3, axis=1), "temperature_change")
            self._kelvin = kelvin.x.array.reshape(-1, 3)[:, 0]

    def _own(self, given: Any) -> FloatArray:
        """Rows of this rank's own cells of a function that is constant on every cell."""
        width = int(given.function_space.dofmap.bs)
        rows: FloatArray = given.x.array.reshape(-1, width)[compat.cell_dofs(given.function_space)[: self.count, 0]]
        return rows if width > 1 else rows[:, 0]

    def nodal(self) -> tuple[FloatArray, FloatArray]:
        """Places and displacements of the nodes of every cell, metres, shapes (c, n, 3)."""
        return self._x[self._points], self._u[self._nodes]

    def at(self, cells: IntArray, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """At q points X of the reference cell their places from the cells' origins, by their `_monomials` (c, q, m),
        stresses (c, q, 6) in the order of `PAIRS`, and volumes over those of the reference cell (c, q)."""
        N, slopes = (of(self.kind, self.degree, X) for of in (lagrange_values, lagrange_slopes))
        x = self._x[self._points[cells]] - self.origins(cells)[:, None]
        both = np.concatenate([x, self._u[self._nodes[cells]]], axis=2).transpose(1, 2, 0)
        along = (slopes.reshape(3 * len(X), -1) @ both.reshape(len(both), -1)).reshape(3, len(X), 6, len(cells))
        edges, stretches = along[:, :, :3].swapaxes(1, 2), along[:, :, 3:].swapaxes(1, 2)  # along the reference axes
        normals = [_cross(edges[a - 2], edges[a - 1]) for a in range(3)]
        volume = sum(edges[0, i] * normals[0][i] for i in range(3))
        slope = [[sum(normals[a][i] * stretches[a, j] for a in range(3)) for j in range(3)] for i in range(3)]
        strain = np.stack([slope[i][i] if i == j else slope[i][j] + slope[j][i] for i, j in PAIRS]) / volume
        if self._dilatation is not None:
            change = self._dilatation[cells] - strain[:3].sum(axis=0)
            strain[:3] += np.where(np.isnan(change), 0.0, change) / 3.0
        stress = self.hooke(cells, strain.transpose(2, 1, 0))
        if self.heated:
            kelvin = self._kelvin[self._nodes[cells]] @ N.T
            if self._dilatation is not None:
                mean = self._kelvin[self._nodes[cells]].mean(axis=1, keepdims=True)
                kelvin = np.where(np.isnan(self._dilatation[cells])[:, None], kelvin, mean)
            stress -= kelvin[:, :, None] * self._per_kelvin[cells][:, None]
        return _monomials(N @ x, self.degree), stress, np.abs(volume.T)

    def integration(self, of_slopes: bool = False) -> tuple[FloatArray, FloatArray]:
        """Points (q, 3) and weights (q,) of the integrals: more of them change eta by 1e-3 of itself; those for squares
        `of_slopes` are inside the cell."""
        tetrahedron = self.kind.name == "tetrahedron"
        return _points(self, 2 if tetrahedron and of_slopes else 2 * self.degree + (not tetrahedron))

    def origins(self, cells: IntArray) -> FloatArray:
        """The first vertex of each cell, metres, shape (c, 3): places in a cell are taken from there."""
        return self.x[self.vertices[cells, 0]]

    def hooke(self, cells: IntArray, strain: FloatArray) -> FloatArray:
        """The stresses of strains (c, q, 6), without a thermal stress."""
        if self._stiffness is not None:
            return strain @ symmetric(self._stiffness[cells])
        young, poisson = (of[cells][:, None, None] for of in (self._young, self._poisson))
        mu = young / (2.0 * (1.0 + poisson))
        stress: FloatArray = mu * strain * np.repeat([2.0, 1.0], 3)
        stress[..., :3] += 2.0 * mu * poisson / (1.0 - 2.0 * poisson) * strain[..., :3].sum(axis=-1, keepdims=True)
        return stress

    def energy(self, cells: IntArray, stress: FloatArray) -> FloatArray:
        """s : C^-1 : s of stresses (c, q, 6), J/m^3, shape (c, q)."""
        if self._stiffness is not None:
            return np.einsum("cqi,cqi->cq", stress, stress @ np.linalg.inv(symmetric(self._stiffness[cells])))
        young, poisson = (of[cells][:, None] for of in (self._young, self._poisson))
        squares = stress**2 @ np.repeat([1.0, 2.0], 3)
        return ((1.0 + poisson) * squares - poisson * stress[..., :3].sum(axis=-1) ** 2) / young

    def summed(self, rows: FloatArray) -> FloatArray:
        """Rows of this rank's vertices (v, ...), added up over all ranks; collective."""
        if self.comm.size == 1:
            return rows
        index_map = self.of_vertices
        own, ghosts = index_map.size_local, np.asarray(index_map.ghosts, dtype=np.int64)
        ask = Exchange(self.comm, owner_of(starts_of(self.comm, own), ghosts))
        at = ask.send(ghosts) - index_map.local_range[0]
        total = rows.copy()
        np.add.at(total, at, ask.send(rows[own:]))
        total[own:] = ask.reply(total[at])
        return total


def _recovered(cells: StressedCells, own: IntArray) -> FloatArray:
    """Coefficients of the polynomials of this rank's vertices in the cells of one material, `own`, by `_monomials` of
    places from the vertex, shape (v, m, 6), 0 at vertices elsewhere; collective."""
    best, _ = _points(cells, cells.degree if cells.kind.name == "tetrahedron" else 2 * cells.degree - 1)
    fine, _ = cells.integration()
    X, weights = np.concatenate([best, fine]), np.repeat([1.0, _FINE], [len(best), len(fine)])
    size = 4 if cells.degree == 1 else 10
    moments: FloatArray = np.zeros((len(cells.x), size, size + 6))
    for part in _parts(own):
        terms, stress, _ = cells.at(part, X)
        vertices = cells.vertices[part]
        about = (terms * weights[:, None]).swapaxes(1, 2) @ np.concatenate([terms, stress], axis=2)
        shift = cells.origins(part)[:, None] - cells.x[vertices]
        about = np.repeat(about[:, None], vertices.shape[1], axis=1)
        _move_products(about, shift)
        _move_products(about[..., :size].swapaxes(2, 3), shift)
        _add(moments, vertices, about)
    moments = cells.summed(moments)
    polynomials, quality = np.zeros((len(cells.x), size, 6)), np.zeros(len(cells.x))
    here = moments[:, 0, 0] > 0.0
    polynomials[here], quality[here] = _fitted(moments[here])
    others: FloatArray = np.zeros((len(cells.x), 1 + 6 * size))
    for part in _parts(own):
        vertices = cells.vertices[part]
        cell, i, j = np.nonzero(quality[vertices][:, None, :] > _BETTER * quality[vertices][:, :, None])
        at, of = vertices[cell, i], vertices[cell, j]
        moved = _moved(polynomials[of], cells.x[at] - cells.x[of], cells.degree)
        rows = np.column_stack([np.ones(len(of)), moved.reshape(len(of), 6 * size)])
        _add(others, at, quality[of, None] * rows)
    others = cells.summed(others)
    mixed = others[:, 0] > 0.0
    mean = (others[mixed, 1:] / others[mixed, :1]).reshape(-1, size, 6)
    share = quality[mixed][:, None, None]
    polynomials[mixed] = (mean + share * polynomials[mixed]) / (1.0 + share)
    return polynomials


def _fitted(moments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Polynomials (v, m, 6) of least squares, and their qualities (v,), of the weighted sums (v, m, m + 6) of products
    of the monomials with themselves and with the stress.

    The mean over the points is taken off both, so that a constant stress is exact; each monomial is divided by its
    size, so that the unit does not matter.  A number at the size of rounding errors lets cells be as flat as they like.
    """
    size = moments.shape[1]
    moments = moments / moments[:, :1, :1]
    mean = moments[:, 1:, 0]
    scale = 1.0 / np.sqrt(np.einsum("vii->vi", moments[:, 1:, 1:size]))
    centred = scale[:, :, None] * (moments[:, 1:, 1:] - mean[:, :, None] * moments[:, :1, 1:])
    scatter = centred[:, :, : size - 1] * scale[:, None] + 1e-14 * np.eye(size - 1)
    slopes = scale[:, :, None] * np.linalg.solve(scatter, centred[:, :, size - 1 :])
    constant = moments[:, :1, size:] - mean[:, None] @ slopes
    place = (mean * scale)[:, :3, None]
    z = place.swapaxes(1, 2) @ np.linalg.solve(scatter[:, :3, :3], place)
    return np.concatenate([constant, slopes], axis=1), 1.0 / (1.0 + z[:, 0, 0])


def _add(total: FloatArray, at: npt.NDArray[np.integer[Any]], rows: FloatArray) -> None:
    """Add rows (..., w) to those of an array (v, w) at numbers (...), which may be repeated."""
    numbers, inverse = np.unique(at, return_inverse=True)
    sums = scipy.sparse.csr_matrix(
        (np.ones(at.size), (inverse.ravel(), np.arange(at.size))), shape=(len(numbers), at.size)
    )
    total[numbers] += (sums @ rows.reshape(at.size, total[0].size)).reshape(len(numbers), *total.shape[1:])
