"""The state of a contact problem at one time, as a value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from ..arrays import FloatArray
from ..fem.bodies import Deformable, Loading
from ..fem.contact import ContactSurface
from ..fem.geometry import RigidMotion, Spin
from ..solvers.laws import FrictionLaw
from .accumulated import Accumulated


@dataclass(frozen=True)
class ContactState:
    """A contact problem at one time; this rank's m contact points.

    Attributes:
        elasticity: The body with the coefficients of its stiffness at this time.
        loading: Loads and prescribed displacements.
        rigid_motions: Of the foundations of the faces.
        spins: Axis and angular velocity of the foundations of the faces; None where there is no rotation.
        surface: Contact points with their frames, gaps and B, for the foundations at this time.
        law: Of friction at the contact points.
        slip_rate: Slip rate in the load step before, metres per second, shape (m,); 0 without one.
        slip_origin: Displacement of the contact points from which slip is measured, along n, t1, t2, metres, shape (m,
            3): 0 at first, in a later load step that after the step before, moved with the foundation.
        accumulated: Slip, friction work and largest pressure of the load steps before.
    """

    elasticity: Deformable
    loading: Loading
    rigid_motions: tuple[RigidMotion, ...]
    spins: tuple[Spin | None, ...]
    surface: ContactSurface
    law: FrictionLaw
    slip_rate: FloatArray
    slip_origin: FloatArray
    accumulated: Accumulated

    @property
    def time(self) -> float:
        """The time of loads and foundations in seconds."""
        return self.loading.time


class Before(Protocol):
    """Start of a load step: time, displacement (k, 3) in metres, slip rates (m,) in m/s and what has accumulated, after
    the step before."""

    @property
    def time(self) -> float: ...

    @property
    def displacement(self) -> FloatArray: ...

    @property
    def slip_rate(self) -> FloatArray: ...

    @property
    def accumulated(self) -> Accumulated: ...
