"""Contact faces as the user defines them: face, foundation, law of friction.

Friction may depend on time and on the slip rate.  The coefficient of a load step is taken at the end of the step, with
the slip rate of the step before: its slip over its duration (semi-implicit).  So each step has Coulomb's law with a
given coefficient per contact point, as without slip rates; the coefficient lags by one step, an error that falls with
the size of the steps.  In the first step, and without load steps, the slip rate is 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray, is_number, is_of_ufl, short
from ..fem.contact import Normals, Shape
from ..fem.geometry import (
    Amplitude,
    Coefficient,
    Field,
    FrictionAxes,
    Motion,
    Point,
    RigidFoundation,
    RigidMotion,
    Rotation,
    SignedDistance,
    evaluate_amplitude,
    evaluate_numbers,
    evaluate_signed_numbers,
    of_place,
    on_all_ranks,
    rigid_motion,
)
from ..solvers.laws import FrictionLaw
from .foundation_load import FoundationLoad


@runtime_checkable
class FrictionModel(Protocol):
    """A coefficient of friction by place, time and slip rate."""

    def coefficient(self, x: FloatArray, time: float, slip_rate: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
        """F >= 0 at points, shape (k,); collective.

        Args:
            x: The points in metres, shape (k, 3).
            time: Of the end of the load step, seconds.
            slip_rate: In the load step before, metres per second, shape (k,).
            what: What the coefficient is called in errors.

        Raises:
            ValueError: On every rank, if a value fails, or is negative or not finite on any.
        """
        ...


@dataclass(frozen=True)
class SlipRateFriction:
    """F = kinetic + (static - kinetic) exp(-v / decay_speed) with the slip rate v: exponential decay.

    F is the same in all directions; orthotropic friction does not depend on the slip rate.

    Attributes:
        static: F without slip, >= 0; a number or a function of place.
        kinetic: F of fast slip, >= 0; smaller or larger than static.
        decay_speed: In metres per second, > 0.

    Raises:
        ValueError: If a number is out of its bounds.
    """

    static: Coefficient
    kinetic: Coefficient
    decay_speed: Coefficient

    def __post_init__(self) -> None:
        for name, value in (("static", self.static), ("kinetic", self.kinetic)):
            if not of_place(value) and not is_number(value):
                raise ValueError(f"friction: {name} must be a number >= 0, but is {value}")
        if not of_place(self.decay_speed) and not (is_number(self.decay_speed) and self.decay_speed != 0.0):
            raise ValueError(f"friction: decay_speed must be a number > 0 (m/s), but is {self.decay_speed}")

    def coefficient(self, x: FloatArray, time: float, slip_rate: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
        """F at points x (k, 3), shape (k,), as `FrictionModel`."""
        static = evaluate_numbers(self.static, x, f"{what}: static", comm)
        kinetic = evaluate_numbers(self.kinetic, x, f"{what}: kinetic", comm)
        speed = evaluate_numbers(self.decay_speed, x, f"{what}: decay_speed", comm)
        ratio = np.divide(slip_rate, speed, out=np.where(slip_rate > 0.0, np.inf, 0.0), where=speed > 0.0)
        return kinetic + (static - kinetic) * np.exp(-ratio)


@dataclass(frozen=True)
class VariableFriction:
    """F as a function of place, time and slip rate.

    Attributes:
        function: Of x, shape (3, k), in metres, the time in seconds, and the slip rates (k,) of the load step before in
            metres per second; returns k numbers >= 0.
    """

    function: Callable[[FloatArray, float, FloatArray], FloatArray]

    def coefficient(self, x: FloatArray, time: float, slip_rate: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
        """F at points x (k, 3), shape (k,), as `FrictionModel`."""
        return evaluate_numbers(lambda points: self.function(points, time, slip_rate.copy()), x, what, comm)


@dataclass(frozen=True)
class PressureFriction:
    """F as a function of the contact pressure p, linear between the points given and constant outside.

    The bound of friction is F(p) p in every iterate of a solver: nothing lags behind.

    Attributes:
        pressures: In pascals, >= 0, ascending.
        coefficients: F >= 0 at these pressures.

    Raises:
        ValueError: If they are not as many, or a number is out of its bounds.
    """

    pressures: Sequence[float]
    coefficients: Sequence[float]

    def __post_init__(self) -> None:
        for name, values in (("pressures", self.pressures), ("coefficients", self.coefficients)):
            if len(values) == 0 or not all(is_number(value) for value in values):
                raise ValueError(f"friction: {name} must be numbers >= 0, but are {values!r}")
        if len(self.pressures) != len(self.coefficients) or any(np.diff(self.pressures) <= 0.0):
            raise ValueError(
                "friction: pressures must ascend, with one coefficient each, but there are "
                f"{list(self.pressures)} and {list(self.coefficients)}"
            )

    def factors(self, area: FloatArray, factor: float) -> tuple[FloatArray, FloatArray]:
        """F times a factor, and the normal forces in newtons at which it is given, at nodes of areas (k,) in m^2;
        shapes (k, points)."""
        return np.tile(np.multiply(factor, self.coefficients), (len(area), 1)), np.multiply.outer(area, self.pressures)


@dataclass(frozen=True)
class ThermalContact:
    """Conduction of heat through a contact, in a problem with heat: h = conductance + factor (p/hardness)^exponent.

    Heat h (T - T_opposite) per area flows where there is pressure p > 0, none through open points.  Rough surfaces that
    yield have h = 1.25 k m/s (p/H)^0.95 with the harmonic mean k of the conductivities, slope m and height s of the
    roughness and hardness H of the softer body (Cooper, Mikic and Yovanovich 1969).

    Attributes:
        conductance: The part of h that does not depend on pressure, W/(m^2 K): a number or a function of place.
        factor: h at the pressure `hardness`, without that part, W/(m^2 K).
        hardness: Pressure in pascals, > 0.
        exponent: Exponent of the pressure, > 0; 1 for a conductance that is linear in the pressure.
        temperature: Temperature of a rigid foundation, in kelvin or degrees Celsius; pairs have none.
        share: Part of the heat of friction that goes into `Contact.face`, from 0 to 1; the rest goes into the other
            face, or into the foundation.

    Raises:
        ValueError: If a number is out of bounds.
    """

    conductance: Coefficient = 0.0
    factor: float = 0.0
    hardness: float = 1e9
    exponent: float = 0.95
    temperature: float | None = None
    share: float = 0.5

    def __post_init__(self) -> None:
        for name, least in (("conductance", 0.0), ("factor", 0.0), ("hardness", None), ("exponent", None)):
            value = getattr(self, name)
            if name == "conductance" and of_place(value):
                continue
            if not is_number(value) or (least is None and not value > 0.0):
                bound = ">" if least is None else ">="
                raise ValueError(f"contact: thermal: {name} must be a number {bound} 0, but is {value!r}")
        if not (is_number(self.share) and self.share <= 1.0):
            raise ValueError(f"contact: thermal: share must be a number from 0 to 1, but is {self.share!r}")
        if self.temperature is not None and not is_number(self.temperature, -np.inf):
            raise ValueError(f"contact: thermal: temperature must be a finite number, but is {self.temperature!r}")

    @property
    def conducts(self) -> bool:
        """Whether heat flows at any pressure."""
        return of_place(self.conductance) or self.conductance != 0.0 or self.factor > 0.0

    def at(self, pressure: FloatArray, x: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
        """h at points x (m, 3) under pressures (m,) in pascals, W/(m^2 K), shape (m,); ValueError on every rank if the
        conductance fails, or is negative or not finite; collective."""
        p = np.maximum(pressure, 0.0)
        constant = evaluate_numbers(self.conductance, x, f"{what}: thermal: conductance", comm)
        h: FloatArray = constant + self.factor * (p / self.hardness) ** self.exponent
        return np.where(p > 0.0, h, 0.0)


INSULATED = ThermalContact()
"""No conduction; heat of friction in halves."""


@dataclass(frozen=True)
class Contact:
    """A contact face, its foundation and its law of friction |x_t| <= min(c a + F x_n, q a), a the area of a node.

    Coulomb's law has friction F alone, Mohr-Coulomb's friction and cohesion c, Tresca's slip_stress in place of both: a
    cohesion alone.  A cohesion resists slip, not opening, and acts on open nodes too.  q is the `friction_limit`, if
    there is any.

    Friction may be orthotropic, (F1, F2) with a direction: the friction force T lies in the ellipse with the semi-axes
    r F1/F along the direction and r F2/F across it, r = c a + F x_n and F the larger of both; slip is along the outward
    normal of the ellipse at T (associated rule).

    Attributes:
        face: Name of the contact face.
        friction: Coefficient of friction F >= 0, constant or a function of place; or two, along `direction` and across;
            or `SlipRateFriction`, or any `VariableFriction` of place, time and slip rate; or `PressureFriction`.
        slip_stress: Tresca friction: the shear stress in pascals at which the face slips, independent of pressure;
            constant or a function of place.
        foundation: Rigid foundation; by default the plane of the face itself (gap 0).  A function of x, shape (3, k),
            is its signed distance, as of `SignedDistance`.
        normals: Source of the normals of the contact frames, "foundation" or "body" (`contact_surface`).
        motion: Translation of the foundation as a function of time, metres.
        rotation: Rotation of the foundation as a function of time; before the translation, with which its axis moves.
        cohesion: In addition to friction: the shear stress c >= 0 in pascals that the face bears without pressure,
            constant or a function of place.
        direction: Of orthotropic friction, a vector or a function of place; projected into the tangent plane of a node.
        friction_amplitude: Factor of friction as a function of time, >= 0.
        gap: Initial gap in metres in addition to the distance between face and foundation, along the contact normal;
            constant or a function of place, evaluated at the undeformed face.  Negative values are an interference
            (press fit): the face must move back by so much.
        gap_amplitude: Factor of `gap` as a function of time, with which a press fit is applied in a load history.
        against: In place of a foundation, another deformable face, of another body ("lower:top") or of the same; or
            the face itself: its facets that are before each other become two faces, "skin_facing_itself_1" and
            "skin_facing_itself_2", in large motions at the beginning of every load step.
        adjust: Gaps and penetrations between two deformable faces up to this size in metres, as meshes leave them where
            surfaces are the same, are closed before deformation, without strain.  Of two sizes the first is for gaps,
            the second for penetrations.
        smooth: The facets of first order of a pair stand for smooth surfaces, with the mean normals at their corners,
            when its gap is measured.
        surface: The surface for which the facets of the face stand when the gap of a pair is measured: a `Cylinder`, a
            `Sphere` or any signed distance that is 0 there.  Its nodes must be on it; those of finer meshes will be.
        against_surface: That of the face `against`.
        facing: Whether nodes that face away from a rigid foundation are no contact points, as on the far side of a
            ball; else all are, as in large motions, where a face may turn over an edge.
        slave: Whether the contact points of a pair are those of `face`, whatever the meshes; else those of the finer
            face, or of the softer body.  Large motions keep the first choice.
        thermal: Conduction of heat, in a problem with heat; by default no heat passes but that of friction, in halves.
        friction_limit: The largest shear stress q > 0 in pascals that friction reaches, as where the softer surface
            yields in shear (0.58 times its yield stress); constant or a function of place.
        force: Force on the foundation along x, y and z in newtons, in which it comes to rest: its motion along these
            axes is a part of the answer (`Solution.loaded_foundations`).  None along those where it has its `motion`.
        moment: The same about axes along x, y and z through the `force_point`, N m; None where it does not turn.
        force_point: Where the force acts, metres; it moves with the foundation.  By default the middle of the face.
        force_amplitude: Factor of force and moment as a function of time.
        depth: The largest penetration of a pair that is found, metres, less than what is behind the face is thick; by
            default a quarter of the extent of the smaller face, of a face with itself half of its thinnest wall.

    Examples:
        >>> from coulomb import Contact, Plane
        >>> floor = Contact("bottom", friction=0.3)  # the plane of the face
        >>> wall = Contact("right", 0.2, foundation=Plane((0.1, 0.0, 0.0), (-1.0, 0.0, 0.0)))
        >>> press_fit = Contact("ring:bore", 0.15, against="shaft:surface", gap=-20e-6)  # metres
        >>> glued = Contact("bottom", slip_stress=2e6)  # Tresca, pascals
        >>> tool = Contact("top", 0.1, force=(None, None, -500.0))  # newtons; guided along x and y

    Raises:
        ValueError: If no law is given, or two, if a number is negative or not finite, or if two coefficients of
            friction have no direction.
    """

    face: str
    friction: Coefficient | Sequence[Coefficient] | FrictionModel | PressureFriction | None = None
    slip_stress: Coefficient | None = None
    foundation: RigidFoundation | None = None
    normals: Normals = "foundation"
    motion: Motion | None = None
    cohesion: Coefficient | None = None
    direction: Field | None = None
    friction_amplitude: Amplitude = 1.0
    rotation: Rotation | None = None
    gap: Coefficient = 0.0
    gap_amplitude: Amplitude = 1.0
    against: str | None = None
    adjust: float | Sequence[float] = 0.0
    smooth: bool = False
    surface: RigidFoundation | None = None
    against_surface: RigidFoundation | None = None
    facing: bool = True
    slave: bool = False
    thermal: ThermalContact = INSULATED
    friction_limit: Coefficient | None = None
    force: Sequence[float | None] = (None, None, None)
    moment: Sequence[float | None] = (None, None, None)
    force_point: Point | None = None
    force_amplitude: Amplitude = 1.0
    depth: float | None = None

    def __post_init__(self) -> None:
        for name in ("foundation", "surface", "against_surface"):
            given = getattr(self, name)
            if given is None or hasattr(given, "signed_distance"):
                continue
            if not callable(given) or is_of_ufl(given):
                raise ValueError(
                    f"contact: {name} must be a Plane, Sphere, Cylinder or SignedDistance, or a function of x, shape "
                    f"(3, k), that returns distances (k,), but is {short(given)}"
                )
            object.__setattr__(self, name, SignedDistance(given))
        if bool(self.load) and self.rotation is not None and any(one is not None for one in self.moment):
            raise ValueError("contact: a foundation has a given rotation, or turns under a moment: give one of the two")
        if not isinstance(self.thermal, ThermalContact):
            raise ValueError(f"contact: thermal must be a ThermalContact, but is {self.thermal!r}")
        if self.against is None and self.thermal.conducts and self.thermal.temperature is None:
            raise ValueError("contact: thermal: heat flows into the foundation: give its temperature")
        if self.against is not None and self.thermal.temperature is not None:
            raise ValueError("contact: thermal: temperature is for rigid foundations: give a pair none")
        if (self.friction is None) == (self.slip_stress is None):
            raise ValueError("contact: give either friction (Coulomb) or slip_stress (Tresca), one of the two")
        if np.shape(self.adjust) not in ((), (2,)) or not all(map(is_number, np.ravel(self.adjust))):
            raise ValueError(
                f"contact: adjust must be a number of metres >= 0, or one for gaps and one for penetrations, but is "
                f"{self.adjust!r}"
            )
        if self.depth is not None and not (self.against is not None and is_number(self.depth) and self.depth > 0.0):
            raise ValueError(f"contact: depth is a number of metres > 0 of a pair, but is {self.depth!r}")
        if self.against is not None:
            self._refuse_foundation()
        elif any(self.closed):
            raise ValueError("contact: adjust is for faces against a deformable face; for foundations use gap")
        elif self.smooth or self.surface is not None or self.against_surface is not None:
            raise ValueError("contact: smooth and surface are for faces against a deformable face: give `against`")
        if self.rotation is not None and not isinstance(self.rotation, Rotation):
            raise ValueError(f"contact: rotation must be a Rotation(point, axis, angle), but is {self.rotation!r}")
        if self.cohesion is not None and self.friction is None:
            raise ValueError("contact: cohesion goes with friction; slip_stress is a cohesion alone")
        if isinstance(self.friction, str):
            raise ValueError(f"contact: friction must be a number >= 0, but is {self.friction!r}")
        coefficients = self.friction if isinstance(self.friction, Sequence) else ()
        variable = FrictionModel, PressureFriction
        directed = self.direction is not None and isinstance(self.friction, variable)
        if directed or any(isinstance(value, variable) for value in coefficients):
            raise ValueError(
                "contact: friction that depends on slip rate or pressure is the same in all directions: give it alone, "
                "without a direction, or two numbers or functions of place, (along, across), with a direction"
            )
        if isinstance(self.friction, Sequence) and self.direction is None:
            raise ValueError("contact: two coefficients of friction, (along, across), need a direction")
        if self.direction is not None and not isinstance(self.friction, Sequence):
            raise ValueError("contact: a direction needs two coefficients of friction, (along, across)")
        if isinstance(self.friction, Sequence) and len(self.friction) != 2:
            raise ValueError(f"contact: friction must be one number or two, (along, across), but is {self.friction}")
        for name, given in (
            ("friction", self.friction),
            ("slip_stress", self.slip_stress),
            ("cohesion", self.cohesion),
        ):
            each = given if isinstance(given, Sequence) and not isinstance(given, str) else (given,)
            for value in each if given is not None else ():
                allowed = of_place(value) or is_number(value)
                if not (allowed or (name == "friction" and isinstance(value, variable))):
                    raise ValueError(f"contact: {name} must be a number >= 0, but is {short(value)}")
        if self.friction_limit is not None and self.friction is None:
            raise ValueError("contact: friction_limit goes with friction; slip_stress is a limit itself")
        if not (self.friction_limit is None or of_place(self.friction_limit)) and not (
            is_number(self.friction_limit) and self.friction_limit != 0.0
        ):
            raise ValueError(f"contact: friction_limit must be a number of pascals > 0, but is {self.friction_limit!r}")
        if not (of_place(self.gap) or is_number(self.gap, -np.inf)):
            raise ValueError(
                "contact: gap must be a number of metres or a function of place, negative for an interference, "
                f"but is {self.gap!r}"
            )
        unscaled = is_number(self.gap_amplitude, -np.inf) and self.gap_amplitude == 1.0
        if not (unscaled or of_place(self.gap) or self.gap):
            raise ValueError("contact: gap_amplitude is a factor of gap, which is not given")

    def exchanged(self) -> Contact:
        """The same pair with its other face as the slave."""
        assert self.against is not None
        return replace(
            self,
            face=self.against,
            against=self.face,
            surface=self.against_surface,
            against_surface=self.surface,
            thermal=replace(self.thermal, share=1.0 - self.thermal.share),
        )

    @property
    def load(self) -> FoundationLoad:
        """What is given of force and moment on the foundation."""
        return FoundationLoad(self.face, self.force, self.moment, self.force_point, self.force_amplitude)

    @property
    def closed(self) -> tuple[float, float]:
        """The sizes in metres of the gaps and of the penetrations that are closed before deformation."""
        gaps, penetrations = np.broadcast_to(np.asarray(self.adjust, dtype=np.float64), 2)
        return float(gaps), float(penetrations)

    @property
    def shape(self) -> Shape:
        """What the facets of the pair stand for, and the largest penetration that is found."""
        return Shape(self.smooth, self.surface, self.against_surface, np.inf if self.depth is None else self.depth)

    def _refuse_foundation(self) -> None:
        if not isinstance(self.against, str):
            raise ValueError(f"contact: against must be the name of a face, but is {self.against!r}")
        unfit = {"foundation": self.foundation, "motion": self.motion, "rotation": self.rotation}
        given = [name for name, value in unfit.items() if value is not None] + ["force"] * bool(self.load)
        if given:
            raise ValueError(
                f"contact: {given[0]} is for rigid foundations, but face {self.face!r} is against the deformable face "
                f"{self.against!r}: move that body by its supports"
            )
        if self.normals != "foundation":
            raise ValueError("contact: normals is for rigid foundations: between two faces they are those of the slave")

    @property
    def axes(self) -> FrictionAxes | None:
        """Of orthotropic friction."""
        if not isinstance(self.friction, Sequence) or self.direction is None:
            return None
        return FrictionAxes(self.friction[0], self.friction[1], self.direction)

    def rigid_motion(self, time: float, what: str) -> RigidMotion:
        """Of the foundation at a time; `what` it is called in errors.

        Raises:
            ValueError: If a function fails, or a table is none.
        """
        return rigid_motion(self.motion, self.rotation, time, what)

    def law(self, x: FloatArray, area: FloatArray, time: float, slip_rate: FloatArray, comm: MPI.Comm) -> FrictionLaw:
        """The law of friction at nodes x (k, 3) in metres of the face, with areas (k,) in m^2, and slip rates (k,) of
        the load step before in m/s; collective.

        Raises:
            ValueError: On every rank, if a function of place fails, or is negative or not finite on any.
        """
        what = f"contact face {self.face!r}"

        def values(name: str, given: Coefficient | Sequence[Coefficient] | None) -> FloatArray:
            if given is None:
                return np.zeros(len(x))
            if isinstance(given, Sequence):
                assert self.axes is not None
                return np.max(self.axes.coefficients(x, what, comm), axis=1)
            return evaluate_numbers(given, x, f"{what}: {name}", comm)

        factor, knots = self.friction_factor(time, comm), None
        if isinstance(self.friction, PressureFriction):
            friction, knots = self.friction.factors(area, factor)
        elif isinstance(self.friction, FrictionModel):
            friction = factor * self.friction.coefficient(x, time, slip_rate, f"{what}: friction", comm)
        else:
            friction = factor * values("friction", self.friction)

        bearing = ("cohesion", self.cohesion) if self.slip_stress is None else ("slip_stress", self.slip_stress)
        limit = None if self.friction_limit is None else values("friction_limit", self.friction_limit) * area
        return FrictionLaw(values(*bearing) * area, friction, limit, knots)

    def gap_at(self, x: FloatArray, comm: MPI.Comm) -> FloatArray:
        """The given gap in metres at nodes x (k, 3) of the face, without its amplitude, shape (k,); collective.

        Raises:
            ValueError: On every rank, if a function of place fails, or is not finite on any.
        """
        return evaluate_signed_numbers(self.gap, x, f"contact face {self.face!r}: gap", comm)

    def gap_factor(self, time: float, comm: MPI.Comm) -> float:
        """The amplitude of the given gap at a time; collective.

        Raises:
            ValueError: On every rank, if it has no value then.
        """
        what = f"contact face {self.face!r}: gap"
        return on_all_ranks(lambda: evaluate_amplitude(self.gap_amplitude, time, what), "", comm)

    def friction_factor(self, time: float, comm: MPI.Comm) -> float:
        """The amplitude of friction at a time; collective.

        Raises:
            ValueError: On every rank, if it has no value then, or is negative.
        """
        what = f"contact face {self.face!r}"

        def evaluate() -> float:
            factor = evaluate_amplitude(self.friction_amplitude, time, f"{what}: friction")
            if factor < 0.0:
                raise ValueError(f"{what}: friction_amplitude must be >= 0, but is {factor:g} at time {time:g}")
            return factor

        return on_all_ranks(evaluate, "", comm)
