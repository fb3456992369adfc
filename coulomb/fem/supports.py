"""Supports of a body: faces with prescribed displacements, and springs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ..arrays import FloatArray
from .user_values import Amplitude, Field, evaluate_vectors


class SupportedFace:
    """What a support needs of the face on which it acts; this rank's q nodes.

    Args:
        name: Name of the face.
        nodes: Its nodes among this rank's, ascending, shape (q,).
        x: Their coordinates in metres, shape (q, 3).
        comm: The ranks.
        outward: Computes the integrals of the outward normal against the hat functions in m^2, shape (q, 3);
            collective.
    """

    def __init__(
        self,
        name: str,
        nodes: npt.NDArray[np.int32],
        x: FloatArray,
        comm: MPI.Comm,
        outward: Callable[[], FloatArray],
    ):
        self.name, self.nodes, self.x, self.comm, self._outward = name, nodes, x, comm, outward

    @cached_property
    def outward(self) -> FloatArray:
        """Integrals of the outward normal against the hat functions in m^2, shape (q, 3); collective."""
        return self._outward()


class Support(Protocol):
    """A support that prescribes displacements on a face."""

    @property
    def face(self) -> str:
        """Name of the face."""
        ...

    @property
    def kind(self) -> str:
        """What the support is called in messages."""
        ...

    @property
    def what(self) -> str:
        """Kind and face, for messages."""
        ...

    @property
    def amplitude(self) -> Amplitude:
        """Factor of the displacement as a function of time."""
        ...

    def directions(self, face: SupportedFace) -> FloatArray:
        """The directions that it holds: orthonormal rows or zeros, shape (q, 3, 3); collective.

        Raises:
            ValueError: On every rank, if the face does not fit.
        """
        ...

    def displacement(self, face: SupportedFace) -> FloatArray:
        """The displacement in metres, of which the parts along the directions are prescribed, at amplitude 1, shape
        (q, 3); collective.

        Raises:
            ValueError: On every rank, if it has no finite value.
        """
        ...


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

    def directions(self, face: SupportedFace) -> FloatArray:
        """The directions that it holds: orthonormal rows or zeros, shape (q, 3, 3); collective."""
        axes = np.diag([float(letter in self.components) for letter in "xyz"])
        return np.broadcast_to(axes, (len(face.nodes), 3, 3)).copy()

    def displacement(self, face: SupportedFace) -> FloatArray:
        """The displacement in metres at amplitude 1, shape (q, 3); collective.

        Raises:
            ValueError: On every rank, if it has no finite value.
        """
        return evaluate_vectors(self.value, face.x, self.what, face.comm)


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
