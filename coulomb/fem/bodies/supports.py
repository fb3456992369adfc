"""Supports of a body: faces with prescribed displacements or rotations, planes of symmetry, and springs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, Protocol

import numpy as np
from mpi4py import MPI

from ...arrays import FloatArray, Int32Array, is_number
from ...units import amount, plain, quantity, used, vector
from ..geometry import (
    LEAST_LENGTH,
    Amplitude,
    Coefficient,
    Field,
    Point,
    RigidFoundation,
    check_angle,
    check_direction,
    check_point,
    evaluate_vectors,
    first_place,
    of_place,
    on_all_ranks,
    tangent_frames,
)
from .lasting_supports import Lasting, LastingConstraint

_MOST: Final = 100
"""Letters of a function of place that is said as it was given."""


def held_in_words(components: str, direction: Field | None, value: Field) -> str:
    """Held components or direction, and the prescribed displacement unless it is zero."""
    letters = direction is None and not set(components) - set("xyz")
    if direction is not None:
        held = f"along {_said(direction) if of_place(direction) else vector_in_words(np.asarray(direction))}"
    elif letters:
        held = ", ".join(components)
    else:
        held = "along the normal" if components == "normal" else "across the normal"
    if of_place(value):
        return f"{held}: {_said(value, 'm')}"
    given = np.asarray(value, dtype=np.float64)
    if not np.any(given):
        return held
    if letters:
        moved = {letter: given["xyz".index(letter)] for letter in components}
        return ", ".join(f"{letter} = {plain(quantity(by, 'm')) if by else 0}" for letter, by in moved.items())
    return f"{held}: the part of {plain(vector(given, 'm'))}"


def _said(value: Field, unit: str = "") -> str:
    """A function of place as it was given in a case, with the name of its unit; that of a user has no words, and those
    of a deck's cylinder are too many."""
    said = getattr(value, "said", None)
    return "a function of x" if said is None or len(said) > _MOST else f"{said} {plain(used().name(unit))}".rstrip()


def vector_in_words(vector: Sequence[float] | FloatArray) -> str:
    return f"({', '.join(f'{value:g}' for value in np.asarray(vector, dtype=np.float64))})"


NORMAL, TANGENTIAL = "normal", "tangential"
"""Components along and across the normal of the face."""

_STIFFEST: Final = 1e30
"""Largest stiffness of a spring in N/m^3: far beyond that of a clamp."""


class Support(Lasting, Protocol):
    """A support that prescribes displacements on a face."""

    @property
    def face(self) -> str: ...

    @property
    def kind(self) -> str: ...

    @property
    def what(self) -> str:
        """Kind and face, for messages."""
        ...

    @property
    def amplitude(self) -> Amplitude:
        """Factor of the displacement as a function of time."""
        ...

    @property
    def holds(self) -> str:
        """What it holds or prescribes at amplitude 1, for the list of what was understood."""
        ...

    def directions(self, face: SupportedFace) -> FloatArray:
        """The directions that it holds: orthonormal rows or zeros, shape (q, 3, 3); ValueError on every rank if the
        face does not fit; collective."""
        ...

    def displacement(self, face: SupportedFace) -> FloatArray:
        """The displacement in metres, of which the parts along the directions are prescribed, at amplitude 1, shape (q,
        3); ValueError on every rank if it is not finite; collective."""
        ...


@dataclass(frozen=True)
class PrescribedDisplacement(LastingConstraint):
    """Prescribed displacement on a face (an inhomogeneous Dirichlet condition).

    Attributes:
        face: Name of the face, or of a set of nodes: on edges, or at points (`NamedMesh.with_nodes`).
        value: Displacement in metres, a vector or a function of x; its parts along directions that are not prescribed
            are ignored.
        components: Which components are prescribed: letters of "xyz"; "normal", along the normal of the face at each
            node; or "tangential", across it.
        amplitude: Factor of the value as a function of time; a table is constant before its first and after its last
            row.
        direction: In place of components: the one direction along which the displacement is prescribed, a vector or a
            function of x, of any length.
        surface: The exact surface of which the face is a mesh, a `Plane`, `Sphere`, `Cylinder` or `SignedDistance`; the
            normals are then its own.  A cylinder in a bearing turns freely only with it: normals of a mesh are not
            quite radial.
        begin, end, reaches: When it acts (`LastingConstraint`).

    Raises:
        ValueError: As `LastingConstraint`; if components is none of these, or is given beside a direction, or a surface
            beside other components than "normal" and "tangential".
    """

    face: str
    value: Field
    components: str = "xyz"
    amplitude: Amplitude = 1.0
    direction: Field | None = None
    surface: RigidFoundation | None = None

    kind = "prescribed displacement"

    def __post_init__(self) -> None:
        super().__post_init__()
        letters = set(self.components) if isinstance(self.components, str) else set()
        by_letters = bool(letters) and len(letters) == len(self.components) and not letters - set("xyz")
        if not by_letters and self.components not in (NORMAL, TANGENTIAL):
            raise ValueError(
                f"{self.what}: components must be letters of 'xyz', '{NORMAL}' or '{TANGENTIAL}', "
                f"but are {self.components!r}"
            )
        if self.direction is not None and self.components != "xyz":
            raise ValueError(f"{self.what}: give components or a direction, not both")
        if self.surface is not None and (by_letters or self.direction is not None):
            raise ValueError(f"{self.what}: a surface goes with the components '{NORMAL}' or '{TANGENTIAL}'")

    @property
    def what(self) -> str:
        return f"{self.kind} on {self.face!r}"

    @property
    def holds(self) -> str:
        return held_in_words(self.components, self.direction, self.value) + self.lasting

    def directions(self, face: SupportedFace) -> FloatArray:
        rows = np.zeros((len(face.nodes), 3, 3))
        if self.direction is not None:
            rows[:, 0] = self._unit_direction(face)
        elif self.components == NORMAL:
            rows[:, 0] = face.normals(self.what, self.surface)
        elif self.components == TANGENTIAL:
            rows[:, :2] = tangent_frames(face.normals(self.what, self.surface))[:, 1:]
        else:
            rows[:] = np.diag([float(letter in self.components) for letter in "xyz"])
        return rows

    def _unit_direction(self, face: SupportedFace) -> FloatArray:
        assert self.direction is not None
        what = f"{self.what}: direction"
        vectors = evaluate_vectors(self.direction, face.x, what, face.comm)
        with np.errstate(over="ignore"):
            length = np.linalg.norm(vectors, axis=1)

        def unit() -> FloatArray:
            if np.any(length == 0.0):
                raise ValueError(f"must not be zero (first seen at x = {first_place(face.x, length == 0.0)})")
            beyond = (length < LEAST_LENGTH) | (length > 1.0 / LEAST_LENGTH)
            if np.any(beyond):
                between = f"between {LEAST_LENGTH:g} and {1.0 / LEAST_LENGTH:g}"
                raise ValueError(f"must have a length {between} (first seen at x = {first_place(face.x, beyond)})")
            return vectors / length[:, None]

        return on_all_ranks(unit, what, face.comm)

    def displacement(self, face: SupportedFace) -> FloatArray:
        return evaluate_vectors(self.value, face.x, self.what, face.comm)


class Clamp(PrescribedDisplacement):
    """Zero displacement of a face, in all directions or in some.

    With "normal" it is a frictionless guide, plane or curved: the face slides along itself.

    Args:
        face: Name of the face, or of a set of nodes.
        components: As of `PrescribedDisplacement`, as are direction, surface, begin, end, reaches and errors.
    """

    kind = "clamp"

    def __init__(
        self,
        face: str,
        components: str = "xyz",
        direction: Field | None = None,
        surface: RigidFoundation | None = None,
        *,
        begin: float | None = None,
        end: float | None = None,
        reaches: float | None = None,
    ):
        super().__init__(
            face,
            (0.0, 0.0, 0.0),
            components,
            direction=direction,
            surface=surface,
            begin=begin,
            end=end,
            reaches=reaches,
        )


@dataclass(frozen=True)
class SymmetryPlane(LastingConstraint):
    """A plane of symmetry of body, supports and loads, at any angle: the face lies in it, and does not leave it.

    Attributes:
        face: Name of the face, which must be plane, or of nodes in a plane.  Its displacement along its normal is zero;
            where two planes of symmetry meet, along both normals.
        begin, end, reaches: When it acts; as errors, those of `LastingConstraint`.
    """

    face: str

    kind = "symmetry"

    @property
    def amplitude(self) -> Amplitude:
        return 1.0

    @property
    def what(self) -> str:
        return f"symmetry plane on {self.face!r}"

    @property
    def holds(self) -> str:
        return f"along the normal{self.lasting}"

    def directions(self, face: SupportedFace) -> FloatArray:
        rows = np.zeros((len(face.nodes), 3, 3))
        rows[:, 0] = face.plane(self.what)
        return rows

    def displacement(self, face: SupportedFace) -> FloatArray:
        return np.zeros_like(face.x)


@dataclass(frozen=True)
class PrescribedRotation:
    """Prescribed rotation of a face about an axis, as of a rigid plate to which it is glued.

    The displacement of a point x is angle * axis x (x - point): linear in the angle, as all displacements in the theory
    of small strains, so that a body that rotates as a whole has no strain.  It differs from a circle by the part
    angle/2 of itself.

    Attributes:
        face: Name of the face, or of a set of nodes.
        point: A point of the axis in metres.
        axis: Direction of the axis; need not have length 1.
        angle: In radians, right-handed about the axis.
        amplitude: Factor of the angle as a function of time; a table is constant before its first and after its last
            row.
        axial: "held": no displacement along the axis; "free": the displacement along the axis is left to other supports
            and to the loads.

    Raises:
        ValueError: If the axis is zero, or an entry is not finite.
    """

    face: str
    point: Point
    axis: Point
    angle: float
    amplitude: Amplitude = 1.0
    axial: Literal["held", "free"] = "held"

    kind = "prescribed rotation"
    begin = end = reaches = None

    def __post_init__(self) -> None:
        check_point(f"{self.what}: point", self.point)
        check_direction(f"{self.what}: axis", self.axis)
        check_angle(f"{self.what}: angle", self.angle)
        if self.axial not in ("held", "free"):
            raise ValueError(f'{self.what}: axial must be "held" or "free", but is {self.axial!r}')

    @property
    def what(self) -> str:
        return f"{self.kind} on {self.face!r}"

    @property
    def holds(self) -> str:
        along = "" if self.axial == "held" else ", free along it"
        axis, point = vector_in_words(self.axis), vector_in_words(self.point)
        return f"rotation {self.angle:g} rad about {axis} through {point} {used().name('m')}{along}"

    @property
    def _unit_axis(self) -> FloatArray:
        axis = np.array(self.axis, dtype=np.float64)
        return axis / np.linalg.norm(axis)

    def directions(self, face: SupportedFace) -> FloatArray:
        """The axes, or two directions across the axis of rotation."""
        rows = np.eye(3)
        if self.axial == "free":
            rows = np.vstack([tangent_frames(self._unit_axis[None, :])[0, 1:], np.zeros(3)])
        return np.broadcast_to(rows, (len(face.nodes), 3, 3)).copy()

    def displacement(self, face: SupportedFace) -> FloatArray:
        return self.angle * np.cross(self._unit_axis, face.x - np.array(self.point))


@dataclass(frozen=True)
class Spring:
    """Elastic support of a face towards its undeformed position (Winkler foundation).

    Attributes:
        face: Name of the face; or of a set of nodes, each of which has such a spring to the ground.
        stiffness: Force per area and displacement in N/m^3, along x, y and z; one number for all three, or a function
            of x, evaluated at the nodes.  At nodes alone force per displacement in N/m, as numbers.
        at_nodes: Whether the face is a set of nodes.

    Raises:
        ValueError: If there are not one or three numbers, finite, >= 0, and one > 0.
    """

    face: str
    stiffness: Coefficient | Sequence[float]
    at_nodes: bool = False

    def __post_init__(self) -> None:
        if of_place(self.stiffness) and not self.at_nodes:
            return
        given = np.asarray(self.stiffness, dtype=object)
        numbers = [float(one) if is_number(one) else math.inf for one in given.ravel()]
        if given.shape not in ((), (3,)) or not 0.0 < max(numbers) <= _STIFFEST:
            raise ValueError(
                f"spring on {self.face!r}: stiffness must be a number or three (along x, y, z), in {self.unit}, "
                f">= 0, not all 0 and at most {_STIFFEST:g}, but is {self.stiffness!r}"
            )

    @property
    def unit(self) -> str:
        """That of the stiffness."""
        return used().name("N/m" if self.at_nodes else "N/m³").replace("³", "^3")

    @property
    def along_axes(self) -> FloatArray:
        """Shape (3,); of a function of place 1."""
        if of_place(self.stiffness):
            return np.ones(3)
        return np.broadcast_to(np.asarray(self.stiffness, dtype=np.float64), (3,))

    @property
    def holds(self) -> str:
        if of_place(self.stiffness):
            return "stiffness a function of x"
        values = self.along_axes
        same = bool(np.all(values == values[0]))
        return f"stiffness {f'{values[0]:g}' if same else vector_in_words(values)} {self.unit}"


_FOLDED: Final = 0.8
"""Length of the mean normal of the facets around a node below which they meet at an edge: two facets at more than 74
degrees, or a corner."""

_SAME_SIDE: Final = 0.5
"""Cosine of the angle between the normals of a surface and of the facets below which the face is no part of it."""

_CLEAN: Final = 1e-12
"""A component of a normal below this is a rounding error."""

_OFF_PLANE: Final = 1e-5
"""Largest distance of a node from the plane of a plane face, relative to the extent of the face: single precision."""


class SupportedFace:
    """What a support needs of its face; this rank's q nodes.

    Args:
        nodes: Among this rank's, ascending, shape (q,).
        x: Their coordinates in metres, shape (q, 3).
        integrals: Of the hat functions over the face, m^2, shape (q,), and of the outward normal against them, (q, 3);
            collective; None for a set of nodes.
    """

    def __init__(
        self,
        nodes: Int32Array,
        x: FloatArray,
        comm: MPI.Comm,
        integrals: Callable[[], tuple[FloatArray, FloatArray]] | None = None,
    ):
        self.nodes, self.x, self.comm, self._compute = nodes, x, comm, integrals

    @cached_property
    def _integrals(self) -> tuple[FloatArray, FloatArray]:
        assert self._compute is not None
        return self._compute()

    def normals(self, what: str, surface: RigidFoundation | None = None) -> FloatArray:
        """Unit normals of the nodes, shape (q, 3); collective.

        They are outward, the mean of the facets weighted by hat functions; or those of the exact surface, on its side.

        Raises:
            ValueError: On every rank, if the facets around a node of any rank meet at an edge, or if the surface has
                no normal or one far from that of the facets; the message begins with `what`.
        """
        if self._compute is None:
            if surface is None:
                raise ValueError(f"{what}: a set of nodes has no normals: give the surface, or a direction")
            return on_all_ranks(lambda: _clean(surface.normal(self.x)), what, self.comm)
        area, outward = self._integrals

        def unit() -> FloatArray:
            length = np.linalg.norm(outward, axis=1)
            if surface is None:
                folded = length < _FOLDED * area
                if np.any(folded):
                    at = first_place(self.x, folded)
                    raise ValueError(
                        f"the face has an edge at x = {at}, and no normal there; name its sides separately"
                    )
                return _clean(outward)
            n = surface.normal(self.x) if len(self.x) else outward
            other = ~(np.abs(np.einsum("ki,ki->k", n, outward)) > _SAME_SIDE * length)  # also where it is not finite
            if np.any(other):
                at = first_place(self.x, other)
                raise ValueError(f"the face is no part of the surface: at x = {at} their normals are far apart")
            return _clean(n)

        return on_all_ranks(unit, what, self.comm)

    def plane(self, what: str) -> FloatArray:
        """Outward unit normal of a plane face, shape (3,), or that of the plane of a set of nodes; ValueError on every
        rank, beginning with `what`, if it is not plane; collective."""
        if self._compute is None:
            return self._plane_of_nodes(what)
        area, outward = self._integrals
        total = self.comm.allreduce(float(area.sum()))
        mean = self.comm.allreduce(outward.sum(axis=0)) / total
        centre = self.comm.allreduce(area @ self.x) / total
        r = self.x - centre
        extent = self.comm.allreduce(float(np.max(np.abs(r), initial=0.0)), op=MPI.MAX)
        n: FloatArray = _clean(mean[None, :] if np.any(mean) else np.ones((1, 3)))[0]
        furthest = self.comm.allreduce(float(np.max(np.abs(r @ n), initial=0.0)), op=MPI.MAX)
        if np.linalg.norm(mean) < _FOLDED or furthest > _OFF_PLANE * extent:
            raise ValueError(
                f"{what}: the face must be plane, but its nodes are up to {amount(furthest)} off its mean plane; "
                'for a curved face use a clamp with components = "normal"'
            )
        return n

    def _plane_of_nodes(self, what: str) -> FloatArray:
        x: FloatArray = np.concatenate(self.comm.allgather(self.x))
        sizes, ways = (
            np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[1:] if len(x) > 2 else (np.zeros(3), np.eye(3))
        )
        if sizes[1] <= _OFF_PLANE * sizes[0]:
            raise ValueError(f"{what}: the nodes are on a line, and in no plane: use a clamp with a direction")
        if sizes[2] > _OFF_PLANE * sizes[0]:
            raise ValueError(f"{what}: the nodes must be in a plane: use a clamp with a direction")
        return _clean(ways[2:])[0]


def _clean(normals: FloatArray) -> FloatArray:
    """Vectors (q, 3) at length 1, without components that are rounding errors."""
    unit: FloatArray = normals / np.linalg.norm(normals, axis=1)[:, None]
    unit[np.abs(unit) < _CLEAN] = 0.0
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    return unit
