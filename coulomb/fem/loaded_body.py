"""A body with everything that acts on it except the foundation: supports and loads as functions of time; without K."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from .body import ElasticBody
from .loads import AppliedLoad, BodyForce, Load, Weight, vanishes
from .materials import Materials, material_of_cells
from .meshes import NamedMesh
from .nodal_forces import NodalForces
from .user_values import Amplitude, Field, evaluate_amplitude, evaluate_vectors, on_all_ranks

_MODES = (
    *("translation along x", "translation along y", "translation along z"),
    *("rotation about x", "rotation about y", "rotation about z"),
)


@dataclass(frozen=True)
class PrescribedDisplacement:
    """Prescribed displacement on a face (an inhomogeneous Dirichlet condition).

    Attributes:
        face: Name of the face.
        value: Displacement in metres, a vector or a function of x; components that are not prescribed are ignored.
        components: Which components are prescribed, letters of "xyz".
        amplitude: Factor of the value as a function of time; a table is constant before its first and after its last
            row.

    Raises:
        ValueError: If components is not made of different letters of "xyz".
    """

    face: str
    value: Field
    components: str = "xyz"
    amplitude: Amplitude = 1.0

    kind = "prescribed displacement"

    def __post_init__(self) -> None:
        letters = set(self.components)
        if not letters or len(letters) != len(self.components) or letters - set("xyz"):
            raise ValueError(f"{self.what}: components must be letters of 'xyz', but are {self.components!r}")

    @property
    def what(self) -> str:
        """Kind and face, for error messages."""
        return f"{self.kind} on {self.face!r}"


class Clamp(PrescribedDisplacement):
    """Zero displacement of a face, in all components or in some.

    Args:
        face: Name of the face.
        components: Which components are held, letters of "xyz".

    Raises:
        ValueError: If components is not made of different letters of "xyz".
    """

    kind = "clamp"

    def __init__(self, face: str, components: str = "xyz"):
        super().__init__(face, (0.0, 0.0, 0.0), components)


@dataclass(frozen=True)
class Spring:
    """Elastic support of a face towards its undeformed position (Winkler foundation).

    Attributes:
        face: Name of the face.
        stiffness: Force per area and displacement in N/m^3, along x, y and z; one number for all three.

    Raises:
        ValueError: If there are not one or three numbers, finite, >= 0, and one > 0.
    """

    face: str
    stiffness: float | Sequence[float]

    def __post_init__(self) -> None:
        if np.shape(self.stiffness) not in ((), (3,)) or not (
            np.all(np.isfinite(self.along_axes)) and np.all(self.along_axes >= 0.0) and np.any(self.along_axes > 0.0)
        ):
            raise ValueError(
                f"spring on {self.face!r}: stiffness must be a number or three (along x, y, z), in N/m^3, "
                f">= 0 and not all 0, but is {self.stiffness}"
            )

    @property
    def along_axes(self) -> FloatArray:
        """Shape (3,)."""
        return np.broadcast_to(np.asarray(self.stiffness, dtype=np.float64), (3,))


@dataclass(frozen=True)
class Loading:
    """Loads and prescribed displacements of a body at a time; this rank's k nodes.

    Attributes:
        time: The time.
        load: Nodal forces of all loads in newtons, shape (k, 3).
        prescribed: Prescribed displacements in metres, 0 elsewhere, shape (k, 3).
    """

    time: float
    load: FloatArray
    prescribed: FloatArray


class LoadedBody(ElasticBody):
    """An elastic body with its supports, springs and loads; `at` gives the loading at a time.

    Attributes:
        mesh: The body.
        materials: A Material, or a mapping of cell groups to materials.
        V: Its space of displacements.
        fixed: Which components are prescribed, this rank's nodes, shape (k, 3).
        spring: Stiffness of the springs at this rank's nodes along x, y, z in N/m, shape (k, 3).
        loads: Its loads, with their nodal forces.
        dragged: Which components are prescribed to be other than 0 at some time, shape (k, 3).

    Raises:
        ValueError: If a face is unknown, a value not finite, a cell without a material or with two, no density
            under gravity, or if supports and springs allow a rigid motion.
    """

    def __init__(
        self,
        mesh: NamedMesh,
        materials: Materials,
        clamps: Sequence[PrescribedDisplacement],
        tractions: Sequence[Load] = (),
        body_force: Field = (0.0, 0.0, 0.0),
        springs: Sequence[Spring] = (),
        body_force_amplitude: Amplitude = 1.0,
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
        gravity_amplitude: Amplitude = 1.0,
    ):
        super().__init__(mesh.domain, *material_of_cells(mesh, materials))
        self.mesh, self.materials = mesh, materials
        self.fixed, self.dragged = np.zeros((2, self._owned, 3), dtype=bool)
        self._clamps = [self._prescribe(clamp) for clamp in clamps]
        self._support(springs)
        self._refuse_floating_body()
        volume: list[Load] = [] if vanishes(body_force) else [BodyForce(body_force, body_force_amplitude)]
        volume += [] if vanishes(gravity) else [Weight(gravity, materials, gravity_amplitude)]
        self.loads = tuple(AppliedLoad(load, load.nodal_force(self, mesh)) for load in (*volume, *tractions))

    def at(self, time: float) -> Loading:
        """Loads and prescribed displacements at a time; collective.

        Raises:
            ValueError: On every rank, if an amplitude has no finite value at that time.
        """
        load, prescribed = np.zeros((2, self._owned, 3))
        for part in self.loads_at(time):
            load += part.forces
        for support, nodes, values in self._clamps:
            factor = self._factor(support.amplitude, time, support.what)
            for component in map("xyz".index, support.components):
                prescribed[nodes, component] = factor * values[:, component]
        return Loading(time, load, prescribed)

    def loads_at(self, time: float) -> Iterator[NodalForces]:
        """The forces of every load by itself at a time; collective.

        Raises:
            ValueError: On every rank, if an amplitude has no finite value at that time.
        """
        for applied in self.loads:
            load = applied.load
            yield NodalForces(load.kind.replace(" ", "_"), load.face, applied.at(time, self.mesh.comm))

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        """The forces of every clamp and prescribed displacement by itself, in the order given.

        A component that several supports prescribe belongs to the last of them, whose value it has.

        Args:
            reaction: Forces of all of them on the body in newtons, 0 along free directions, shape (k, 3).
        """
        taken = np.zeros((self._owned, 3), dtype=bool)
        shares = []
        for support, nodes, _ in reversed(self._clamps):
            mine = np.zeros((self._owned, 3), dtype=bool)
            for component in map("xyz".index, support.components):
                mine[nodes, component] = True
            forces = np.where(mine & ~taken, reaction, 0.0)
            shares.append(NodalForces(support.kind.replace(" ", "_"), support.face, forces))
            taken |= mine
        yield from reversed(shares)

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        """The forces of every spring by itself at displacements u (k, 3), in the order given."""
        for face, stiffness in self._springs:
            yield NodalForces("spring", face, -stiffness * u)

    def _factor(self, amplitude: Amplitude, time: float, what: str) -> float:
        factor: float = on_all_ranks(lambda: evaluate_amplitude(amplitude, time, what), "", self.mesh.comm)
        return factor

    def _prescribe(
        self, clamp: PrescribedDisplacement
    ) -> tuple[PrescribedDisplacement, npt.NDArray[np.int32], FloatArray]:
        nodes = self.nodes(clamp.face, clamp.kind)
        values = evaluate_vectors(clamp.value, self.x[nodes], clamp.what, self.mesh.comm)
        for component in map("xyz".index, clamp.components):
            self.fixed[nodes, component] = True
            self.dragged[nodes, component] = values[:, component] != 0.0
        return clamp, nodes, values

    def _support(self, springs: Sequence[Spring]) -> None:
        self.spring = np.zeros((self._owned, 3))
        self._springs: list[tuple[str, FloatArray]] = []
        for spring in springs:
            stiffness = self.nodal_area(spring.face, "spring")[:, None] * spring.along_axes
            self._springs.append((spring.face, stiffness))
            self.spring += stiffness

    def _refuse_floating_body(self) -> None:
        held = 1.0 * (self.fixed | (self.spring > 0.0))
        free = self._rigid_motions(held, 1e-10 * self.mesh.comm.allreduce(float(held.sum()), op=MPI.SUM))
        if free:
            raise ValueError(
                f"the body floats: its clamps and springs leave it {free}; hold these by a clamp or a spring, "
                "contact alone does not make the stiffness invertible"
            )

    def _rigid_motions(self, weight: FloatArray, limit: float) -> str:
        """Names of the rigid motions, of size 1 at a node, against which weights (k, 3) at the nodes have no energy."""
        comm, x = self.mesh.comm, self.x
        count = comm.allreduce(len(x), op=MPI.SUM)
        centre = comm.allreduce(x.sum(axis=0), op=MPI.SUM) / count
        r = x - centre
        size = math.sqrt(comm.allreduce(float(np.sum(r**2)), op=MPI.SUM) / count)
        modes = np.zeros((*x.shape, 6))
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            modes[:, k, k] = 1.0
            modes[:, i, 3 + k], modes[:, j, 3 + k] = -r[:, j] / size, r[:, i] / size
        gram = comm.allreduce(np.einsum("kci,kc,kcj->ij", modes, weight, modes), op=MPI.SUM)
        eigenvalues, vectors = np.linalg.eigh(gram)
        free = vectors[:, eigenvalues <= limit]
        return ", ".join(name for name, row in zip(_MODES, free, strict=True) if np.linalg.norm(row) > 0.3)

    # --- queries ----------------------------------------------------------------------------------------

    def nodes(self, face: str, what: str) -> npt.NDArray[np.int32]:
        """This rank's nodes on a face, sorted; ValueError if there is no such face."""
        return self.nodes_of(self.mesh.facets(face, what))

    def nodal_area(self, face: str, what: str = "contact") -> FloatArray:
        """Integral of every hat function over a face in m^2, this rank's nodes, shape (k,)."""
        return self.area_of(self.mesh.facets(face, what))

    def nodal_normal(self, face: str) -> FloatArray:
        """Integral of the body's outward normal against every hat function over a face, m^2, shape (k, 3)."""
        return self.normal_of(self.mesh.facets(face, "contact"))

    def spring_force(self, u: FloatArray) -> FloatArray:
        """Forces of the springs on the body at displacements u, newtons; shapes (k, 3)."""
        return -self.spring * u
