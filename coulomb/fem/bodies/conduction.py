"""Steady conduction of heat in elastic bodies, with temperatures at the nodes of the displacements.

    div (k grad T) + s = 0;   on faces T given, or k dT/dn = q, or k dT/dn = a (T_a - T); else no heat passes

with the conductivity k of the materials.  The unknowns are changes of temperature from a reference: the difference that
causes thermal strain.  What contact conducts is added by `coulomb.model.heat`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray, is_number
from .. import compat
from ..compat import fem, ufl
from ..geometry import Amplitude, Coefficient, evaluate_amplitude, evaluate_signed_numbers, of_place, on_all_ranks
from .body import cell_measure
from .constraints import distributed_rows, local_rows, matrix_product
from .deformable import Deformable, Member
from .elasticity import LoadedBody
from .materials import constant_of_cells
from .reduction import chained

_KINDS = {"temperature": "temperature", "flux": "heat flux", "film": "film", "source": "heat source"}
"""The attributes of a `HeatLoad` of which it has one, and what it is called then."""


@dataclass(frozen=True)
class HeatLoad:
    """Heat or temperature on a face, or heat in the volume of bodies: one of temperature, flux, film and source.

    Attributes:
        face: Name of the face; None for a source.
        temperature: Prescribed temperature in kelvin or degrees Celsius, a number or a function of place.
        flux: Heat flux into the body in W/m^2, a number or a function of place.
        film: Coefficient of a film, > 0, in W/(m^2 K): heat film (ambient - T) per area flows into the body.
        ambient: Temperature on the other side of the film, a number or a function of place.
        source: Heat in the volume in W/m^3, a number or a function of place.
        body: The one of several bodies that has the source; by default all.
        amplitude: Factor as a function of time: of flux or source, or of the difference of temperature or ambient from
            the reference temperature.

    Raises:
        ValueError: If none or two of these are given, or a number is out of bounds.
    """

    face: str | None = None
    temperature: Coefficient | None = None
    flux: Coefficient | None = None
    film: float | None = None
    ambient: Coefficient | None = None
    source: Coefficient | None = None
    body: str | None = None
    amplitude: Amplitude = 1.0

    def __post_init__(self) -> None:
        given = [name for name in _KINDS if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"heat: give one of {', '.join(_KINDS)}, but {' and '.join(given) or 'none'} is given")
        if (self.face is None) != (self.source is not None):
            raise ValueError("heat: temperature, flux and film are on a face; a source is in the volume, without")
        if self.body is not None and self.source is None:
            raise ValueError("heat: body goes with source")
        if (self.film is None) != (self.ambient is None):
            raise ValueError("heat: film and ambient go together: the coefficient and the temperature beyond")
        if self.film is not None and not (is_number(self.film) and self.film > 0.0):
            raise ValueError(f"heat: film must be a positive number of W/(m^2 K), but is {self.film!r}")
        for name in ("temperature", "flux", "ambient", "source"):
            value = getattr(self, name)
            if not (value is None or of_place(value) or is_number(value, -np.inf)):
                raise ValueError(f"heat: {name} must be a finite number or a function of place, but is {value!r}")

    @property
    def kind(self) -> str:
        """What it is, in words."""
        return next(title for name, title in _KINDS.items() if getattr(self, name) is not None)

    @property
    def title(self) -> str:
        """Its kind and face, for messages."""
        return self.kind if self.face is None else f"{self.kind} on {self.face!r}"


class Conduction:
    """Conduction in all bodies, and what heats and cools them; this rank's k nodes.

    Attributes:
        reference: Temperature from which changes are measured.
        K: Conduction and films, W/K, shape (nodes, nodes), distributed.
        fixed_by: Number of the load that prescribes the temperature of each node, -1 where none does, shape (k,); where
            faces meet, the later one does.
        follows: Which nodes follow others in ties, sectors and bolts, unless their temperature is prescribed, shape
            (k,).
        T: From the temperatures of nodes that do not to those of all, shape (nodes, nodes), distributed; None if no
            node follows another.

    Raises:
        ValueError: On every rank, if a face or body is unknown, a value not finite, a material has no conductivity, or
            the temperature of a face that follows another is prescribed.
    """

    def __init__(self, bodies: Deformable, loads: Sequence[HeatLoad], reference: float):
        for load in loads:
            if not isinstance(load, HeatLoad):
                raise ValueError(f"heat must be a list of HeatLoad, but an entry is {load!r}")
        self.bodies, self.loads, self.reference = bodies, tuple(loads), reference
        self.fixed_by = np.full(len(bodies.x), -1)
        self._nodal = np.zeros((len(self.loads), len(bodies.x)))
        self._film = np.zeros_like(self._nodal)
        names = [member.name for member in bodies.members]
        for load in self.loads:
            if load.body is not None and load.body not in names:
                raise ValueError(f"heat: there is no body {load.body!r}; there are {', '.join(names)}")
        films: dict[str, list[scipy.sparse.csr_matrix]] = {name: [] for name in names}
        for number, load in enumerate(self.loads):
            self._add(number, load, films)
        self.K = self._joined([self._matrix(member, films[member.name]) for member in bodies.members])
        self.follows: BoolArray = np.zeros(len(bodies.x), dtype=bool)
        self.T = self._tied()

    @property
    def fixed(self) -> BoolArray:
        """Which of this rank's nodes have a prescribed temperature, shape (k,)."""
        return self.fixed_by >= 0

    def lifted(self, change: FloatArray) -> FloatArray:
        """T times changes of temperature (k,); collective."""
        return change if self.T is None else matrix_product(self.T, change)

    def transferred(self, heat: FloatArray) -> FloatArray:
        """T^T times heat at nodes (k,): that at nodes that follow others, at these; collective."""
        return heat if self.T is None else matrix_product(self.T, heat, transposed=True)

    def reduced(self, A: PETSc.Mat, diagonal: float) -> PETSc.Mat:
        """T^T A T, with a number on the diagonal at nodes that follow others; collective."""
        if self.T is None:
            return A.copy()
        product, alone = A.PtAP(self.T), self._of_nodes(diagonal * self.follows)
        product.axpy(1.0, alone)
        alone.destroy()
        return product

    def factors(self, time: float) -> FloatArray:
        """Amplitudes of the loads at a time, shape (loads,); ValueError on every rank if one has none; collective."""

        def evaluate() -> FloatArray:
            return np.array([evaluate_amplitude(load.amplitude, time, load.title) for load in self.loads])

        return on_all_ranks(evaluate, "", self.bodies.comm)

    def prescribed(self, factors: FloatArray) -> FloatArray:
        """Prescribed changes of temperature in kelvin, 0 at other nodes, shape (k,)."""
        temperature, here = np.zeros(len(self.bodies.x)), self.fixed
        temperature[here] = (factors[:, None] * self._nodal)[self.fixed_by[here], np.flatnonzero(here)]
        return temperature

    def heat(self, factors: FloatArray) -> FloatArray:
        """Heat of every load at this rank's nodes in watts, shape (loads, k); of films that from beyond alone."""
        of_temperature = np.array([load.temperature is not None for load in self.loads], dtype=bool)
        return np.where(of_temperature[:, None], 0.0, factors[:, None] * self._nodal)

    def through_films(self, change: FloatArray) -> FloatArray:
        """Heat that leaves through the film of every load at changes of temperature (k,), watts, shape (loads, k)."""
        return self._film * change

    def _add(self, number: int, load: HeatLoad, films: dict[str, list[scipy.sparse.csr_matrix]]) -> None:
        if load.face is None:
            for member in self.bodies.members:
                if load.source is not None and load.body in (None, member.name):
                    values = self._numbers(load, load.source, member.body.x)
                    self._nodal[number, member.nodes] = member.body.volume_load(_first(values))[:, 0]
            return
        member, facets = self.bodies.face(load.face, "heat")
        body, nodes = member.body, member.body.nodes_of(facets)
        given = next(value for value in (load.temperature, load.flux, load.ambient) if value is not None)
        values = np.zeros(len(body.x))
        values[nodes] = self._numbers(load, given, body.x[nodes])
        own = self._nodal[number, member.nodes]  # a view
        if load.flux is not None:
            own[:] = body.surface_load(_first(values), facets)[:, 0]
            return
        values[nodes] -= self.reference
        if load.film is None:
            own[:], self.fixed_by[member.nodes.start + nodes] = values, number
            return
        own[:] = load.film * body.surface_load(_first(values), facets)[:, 0]
        self._film[number, member.nodes] = load.film * body.area_of(facets)
        V = _scalars(member)
        T, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        films[member.name].append(
            load.film * local_rows(compat.assemble_matrix(fem.form(T * v * body.measure(facets))))
        )

    def _tied(self) -> PETSc.Mat | None:
        ties = [tie for tie in self.bodies.constraints.ties if tie.conducting is not None]
        if not ties:
            return None
        count = len(self.bodies.x)
        rows = scipy.sparse.csr_matrix((count, self.bodies.numbering.total))
        for tie in ties:
            if any(load.temperature is not None and load.face == tie.face for load in self.loads):
                raise ValueError(f"heat: {tie.face!r} follows {tie.against!r}: prescribe the temperature of that face")
            assert tie.conducting is not None
            nodes, weights = tie.conducting(self.fixed | self.follows)
            self.follows[nodes] = True
            lift = scipy.sparse.csr_matrix((np.ones(len(nodes)), (nodes, np.arange(len(nodes)))), (count, len(nodes)))
            rows = rows + lift @ weights
        return chained(self._of_nodes(~self.follows), self._joined([rows]), ties, self.bodies.lifetime)

    def _of_nodes(self, values: npt.NDArray[Any]) -> PETSc.Mat:
        """The matrix with these values (k,) on its diagonal, of which zeros are left out."""
        at, numbering = np.flatnonzero(values), self.bodies.numbering
        entries = values[at].astype(np.float64), (at, numbering.first + at)
        return self._joined([scipy.sparse.csr_matrix(entries, (len(values), numbering.total))])

    def _numbers(self, load: HeatLoad, value: Coefficient, x: FloatArray) -> FloatArray:
        return evaluate_signed_numbers(value, x, load.title, self.bodies.comm)

    def _matrix(self, member: Member, films: Sequence[scipy.sparse.csr_matrix]) -> scipy.sparse.csr_matrix:
        """The rows of the nodes of a body, W/K, shape (its nodes here, nodes of all bodies)."""
        body = member.body
        if not isinstance(body, LoadedBody) or body.materials is None:
            raise ValueError("heat: in small strains bodies of a mesh and materials conduct it, own forms do not")
        k = body._on_cells(constant_of_cells(body.mesh, body.materials, "conductivity"), "conductivity")
        V = _scalars(member)
        T, v = ufl.TrialFunction(V), ufl.TestFunction(V)
        form = fem.form(k * ufl.inner(ufl.grad(T), ufl.grad(v)) * cell_measure(body.domain))
        rows = local_rows(compat.assemble_matrix(form))
        for film in films:
            rows = rows + film
        columns = self.bodies.numbers_of(member, rows.indices.astype(np.int64))
        return scipy.sparse.csr_matrix((rows.data, columns, rows.indptr), (rows.shape[0], self.bodies.numbering.total))

    def _joined(self, parts: Sequence[scipy.sparse.csr_matrix]) -> PETSc.Mat:
        rows = scipy.sparse.vstack(parts, format="csr")
        numbering = self.bodies.numbering
        return distributed_rows(rows, (numbering.local, numbering.total), self.bodies, None)


def _first(values: FloatArray) -> FloatArray:
    """Numbers (k,) as the first components of vectors (k, 3)."""
    return np.column_stack([values, np.zeros((len(values), 2))])


def _scalars(member: Member) -> object:
    """The scalar functions on the nodes of a body."""
    body = member.body
    V = compat.functionspace(body.domain, body.degree)
    one, other = V.dofmap.index_map, body.V.dofmap.index_map
    same = one.local_range == other.local_range and np.array_equal(compat.cell_dofs(V), compat.cell_dofs(body.V))
    if not body.comm.allreduce(same, op=MPI.LAND):  # DOLFINx numbers the blocks of both by the same graph
        raise RuntimeError("heat: DOLFINx numbers scalars in another order than vectors")
    return V
