"""The tables of a case file about what joins faces and nodes: ties, sectors, bolts, rigid faces, equations."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

import coulomb

from ..fem.mesh_formats import other_side
from .curves import AmplitudeTable, amplitude_of
from .loads import LastingTable
from .values import ROWS, AlongAxes, Direction, Name, NodesValue, Number, Stiffness, Table, Vector


class FacePairTable(Table):
    """Two faces of which one moves as the other does; with `slave` the nodes of `face` follow those of `against`."""

    face: Name
    against: Name
    slave: Annotated[bool, Field(strict=True)] = False

    @model_validator(mode="after")
    def _two(self) -> FacePairTable:
        if self.face == self.against:
            raise ValueError(f"face {self.face!r} cannot be tied to itself: give another as against")
        return self

    def tie(self) -> coulomb.Tied:
        """What it is in the problem."""
        raise NotImplementedError


class TieTable(FacePairTable, LastingTable):
    """Two faces that are glued to each other: after `begin` as they are then, until `end`, and from `reaches` on as
    before deformation."""

    def tie(self) -> coulomb.Tied:
        return coulomb.Tied(self.face, self.against, self.slave, **self.lasting)


class CyclicSymmetryTable(FacePairTable):
    """The two cut faces of one of several equal sectors around an axis."""

    point: Vector = (0.0, 0.0, 0.0)
    axis: Vector
    sectors: Annotated[int, Field(ge=2, le=100_000, strict=True)]

    def tie(self) -> coulomb.Tied:
        return coulomb.CyclicSymmetry(self.face, self.against, self.slave, self.point, self.axis, self.sectors)


class PretensionTable(FacePairTable):
    """The section of a bolt, tightened to a force in newtons or by a shortening in metres; by default against the other
    side of a cut."""

    against: Name = ""
    force: Number | None = None
    shortening: Number | None = None
    direction: Direction | None = None
    amplitude: AmplitudeTable | None = None
    lock: Number | None = None

    @model_validator(mode="before")
    @classmethod
    def _other_side(cls, given: object) -> object:
        if isinstance(given, dict) and isinstance(given.get("face"), str) and "against" not in given:
            return {**given, "against": other_side(given["face"])}
        return given

    @model_validator(mode="after")
    def _one(self) -> PretensionTable:
        if (self.force is None) == (self.shortening is None):
            raise ValueError("give either force (N) or shortening (m), one of the two")
        return self

    def tie(self) -> coulomb.Tied:
        return coulomb.Pretension(
            self.face,
            self.against,
            self.slave,
            self.force,
            self.shortening,
            self.direction,
            amplitude_of(self.amplitude),
            self.lock,
        )


class TermTable(Table):
    """A term of an equation: a coefficient times a component of the displacement of nodes: those of a set by its name,
    some by their numbers in the mesh file (in several bodies "body:12"), or those at places in metres."""

    nodes: NodesValue
    component: Literal["x", "y", "z"]
    coefficient: Number


class EquationTable(Table):
    """Terms whose sum is a constant in metres, the displacement of the first being eliminated; or stretches a spring of
    a `stiffness`."""

    terms: Annotated[tuple[TermTable, ...], Field(min_length=1, max_length=ROWS)]
    constant: Number = 0.0
    amplitude: AmplitudeTable | None = None
    stiffness: Stiffness | None = None

    @model_validator(mode="after")
    def _eliminates(self) -> EquationTable:
        if self.terms[0].coefficient == 0.0:
            raise ValueError("the coefficient of the first term must not be 0: its displacement is eliminated")
        if self.stiffness is not None and self.constant:
            raise ValueError("give either constant, or the stiffness of a spring, one of the two")
        return self

    def equation(self) -> coulomb.Equation:
        terms = [(term.nodes, term.component, term.coefficient) for term in self.terms]
        return coulomb.Equation(terms, self.constant, amplitude_of(self.amplitude), self.stiffness)


class RigidFaceTable(Table):
    """A face that moves as a rigid body, with a reference point in metres; components that are not given are free, and
    each may have an amplitude of its own."""

    face: Name
    point: Vector | None = None
    translation: AlongAxes = AlongAxes()
    rotation: AlongAxes = AlongAxes()
    amplitude: AmplitudeTable | None = None
    translation_x_amplitude: AmplitudeTable | None = None
    translation_y_amplitude: AmplitudeTable | None = None
    translation_z_amplitude: AmplitudeTable | None = None
    rotation_x_amplitude: AmplitudeTable | None = None
    rotation_y_amplitude: AmplitudeTable | None = None
    rotation_z_amplitude: AmplitudeTable | None = None
    translation_stiffness: tuple[Stiffness, Stiffness, Stiffness] = (0.0, 0.0, 0.0)
    rotation_stiffness: tuple[Stiffness, Stiffness, Stiffness] = (0.0, 0.0, 0.0)
    along: Literal["rigid", "free"] = "rigid"

    def rigid_face(self) -> coulomb.RigidFace:
        own = [getattr(self, f"{of}_{axis}_amplitude") for of in ("translation", "rotation") for axis in "xyz"]
        return coulomb.RigidFace(
            self.face,
            self.point,
            self.translation.components,
            self.rotation.components,
            amplitude_of(self.amplitude),
            [None if one is None else amplitude_of(one) for one in own],
            self.translation_stiffness,
            self.rotation_stiffness,
            self.along,
        )
