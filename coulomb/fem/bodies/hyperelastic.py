"""Hyperelastic materials: strain energies per undeformed volume, as expressions of UFL, and as materials of a mesh; and
a body of these with supports and loads, as of small strains."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation
from scipy.special import roots_jacobi

from ...arrays import FloatArray, is_number
from .. import compat
from ..compat import fem, ufl
from ..geometry import Amplitude, Field, evaluate_amplitude, of_place
from ..meshes import NamedMesh
from .body import cell_measure
from .constraints import HeldDirections
from .deformable import End
from .elasticity import LoadedBody
from .elimination import Made
from .loads import AppliedLoad, Load, Loading, NodalForces, Pressure, Temperature, ThermalLoad, range_of, shown_range
from .materials import Material, Materials, by_group, material_of_cells
from .nonlinear_body import NonlinearBody
from .supports import PrescribedRotation, Spring, Support

Invariants = tuple[Any, Any, Any]
"""I1 and I2 of C = F^T F, and J = det F."""


def invariants(F: Any) -> Invariants:
    """Of a deformation gradient, 3 x 3."""
    C = F.T * F
    first = ufl.tr(C)
    return first, 0.5 * (first**2 - ufl.tr(C * C)), ufl.det(F)


def elastic(of: Invariants, stretch: Any) -> Invariants:
    """The invariants of F/j from those of F, with a stretch j that is the same in all directions."""
    I1, I2, J = of
    return (I1, I2, J) if stretch is None else (I1 / stretch**2, I2 / stretch**4, J / stretch**3)


def neo_hookean(displacement: Any, mu: Any, lame: Any) -> Any:
    """Compressible neo-Hookean energy, mu/2 (I1 - 3 - 2 ln J) + lame/2 (ln J)^2 (Bonet and Wood 2008, eq. 6.27).

    Args:
        displacement: A function.
        mu: The shear modulus in pascals, a number, constant or function.
        lame: Lame's first constant, likewise.
    """
    return NeoHookean.energy(_of(displacement), mu, lame)


def mooney_rivlin(displacement: Any, c1: Any, c2: Any, bulk: Any) -> Any:
    """Mooney-Rivlin energy c1 (J^(-2/3) I1 - 3) + c2 (J^(-4/3) I2 - 3) + bulk/2 (J - 1)^2; constants in pascals."""
    return MooneyRivlin.energy(_of(displacement), c1, c2, bulk)


def st_venant_kirchhoff(displacement: Any, mu: Any, lame: Any) -> Any:
    """Energy mu E : E + lame/2 (tr E)^2 of Green's strain E = (F^T F - I)/2: for large rotations and small strains."""
    return StVenantKirchhoff.energy(_of(displacement), mu, lame)


def _of(displacement: Any) -> Invariants:
    return invariants(ufl.Identity(3) + ufl.grad(displacement))


_POINTS: Final = 12
"""Points of the quadrature of `_power_sum`."""


def _power_sum(I1: Any, I2: Any, s: float) -> Any:
    """The sum x^s of the eigenvalues x of a tensor of determinant 1 by its invariants, |s| <= 3.

    For s = m + f, x^s is sin(pi f)/pi times the integral of t^(f-1) x^(m+1)/(x + t) over t > 0, with t = (1 - z)/(1 +
    z) by Gauss and Jacobi's rule; and the sum of x^(m+1)/(x + t) is a quotient of polynomials in t and the invariants.
    """
    if s < 0.0:
        return _power_sum(I2, I1, -s)  # of the inverse
    whole, f = divmod(s, 1.0)
    m, squares = int(whole), I1**2 - 2.0 * I2
    sums = (3.0, I1, squares, I1**3 - 3.0 * I1 * I2 + 3.0)
    if f == 0.0:
        return sums[m]
    mixed = (2.0 * I2, I1 * I2 - 3.0, squares * I2 - I1)[m]
    with np.errstate(invalid="ignore"):
        nodes, weights = roots_jacobi(_POINTS, f - 1.0, -f)
    total: Any = 0.0
    for z, w in zip(nodes.tolist(), weights.tolist(), strict=True):
        t, factor = (1.0 - z) / (1.0 + z), 2.0 * math.sin(math.pi * f) / math.pi * w / (1.0 + z)
        total += factor * (sums[m + 1] * t**2 + mixed * t + sums[m]) / (t**3 + I1 * t**2 + I2 * t + 1.0)
    return total


class NeoHookean(Material):
    """A neo-Hookean material (`neo_hookean`) by Young's modulus in pascals and Poisson's ratio of small strains;
    density in kg/m^3, expansion in 1/K.  Arguments and errors as of `Material`."""

    law: ClassVar[str] = "neo-hookean"

    @property
    def constants(self) -> Mapping[str, float]:
        """The constants of `energy` in pascals."""
        mu = self.young / (2.0 * (1.0 + self.poisson))
        return {"mu": mu, "lame": 2.0 * mu * self.poisson / (1.0 - 2.0 * self.poisson)}

    @staticmethod
    def energy(of: Invariants, mu: Any, lame: Any) -> Any:
        I1, _, J = of
        return 0.5 * mu * (I1 - 3.0 - 2.0 * ufl.ln(J)) + 0.5 * lame * ufl.ln(J) ** 2


class StVenantKirchhoff(NeoHookean):
    """Hooke's law between Green's strain and the second Piola-Kirchhoff stress (`st_venant_kirchhoff`): for large
    rotations and small strains.  It is what a `Material` becomes in large motions."""

    law = "st-venant-kirchhoff"

    @staticmethod
    def energy(of: Invariants, mu: Any, lame: Any) -> Any:
        I1, I2, _ = of  # tr E = (I1 - 3)/2, and E : E = (I1^2 - 2 I2 - 2 I1 + 3)/4
        return 0.25 * mu * (I1**2 - 2.0 * I2 - 2.0 * I1 + 3.0) + 0.125 * lame * (I1 - 3.0) ** 2


@dataclass(frozen=True, init=False)
class MooneyRivlin(Material):
    """A Mooney-Rivlin material (`mooney_rivlin`).

    Attributes:
        c1, c2: In pascals, >= 0, not both 0; the shear modulus of small strains is 2 (c1 + c2).
        bulk: Bulk modulus in pascals, > 0.
        density: In kg/m^3, > 0; only gravity needs it.
        expansion: In 1/K; only a temperature needs it.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    c1: float = 0.0
    c2: float = 0.0
    bulk: float = 0.0

    law: ClassVar[str] = "mooney-rivlin"

    def __init__(self, c1: float, c2: float, bulk: float, density: float | None = None, expansion: float | None = None):
        for name, value in (("c1", c1), ("c2", c2), ("bulk", bulk)):
            if not is_number(value, 0.0):
                raise ValueError(f"material: {name} must be a number of pascals, not negative, but is {value!r}")
        young, poisson = _of_moduli(2.0 * (c1 + c2), bulk)
        super().__init__(young, poisson, density, expansion)
        for name, value in (("c1", c1), ("c2", c2), ("bulk", bulk)):
            object.__setattr__(self, name, value)

    @property
    def constants(self) -> Mapping[str, float]:
        """The constants of `energy` in pascals."""
        return {"c1": self.c1, "c2": self.c2, "bulk": self.bulk}

    @staticmethod
    def energy(of: Invariants, c1: Any, c2: Any, bulk: Any) -> Any:
        I1, I2, J = of
        first, second = J ** (-2.0 / 3.0) * I1, J ** (-4.0 / 3.0) * I2
        return c1 * (first - 3.0) + c2 * (second - 3.0) + 0.5 * bulk * (J - 1.0) ** 2


@dataclass(frozen=True, init=False)
class Ogden(Material):
    """An Ogden material: the energy is the sum of mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3) of the
    stretches l divided by J^(1/3), and bulk/2 (J - 1)^2 (Ogden 1972).

    Attributes:
        mu: In pascals, one for each exponent; mu alpha > 0, half of their sum is the shear modulus of small strains.
        alpha: Exponents in [-6, 6].
        bulk: Bulk modulus in pascals, > 0.
        density: In kg/m^3, > 0; only gravity needs it.
        expansion: In 1/K; only a temperature needs it.

    Raises:
        ValueError: If a constant is outside its bounds.
    """

    mu: tuple[float, ...] = ()
    alpha: tuple[float, ...] = ()
    bulk: float = 0.0

    law: ClassVar[str] = "ogden"

    def __init__(
        self,
        mu: Sequence[float],
        alpha: Sequence[float],
        bulk: float,
        density: float | None = None,
        expansion: float | None = None,
    ):
        pairs = list(zip(mu, alpha, strict=False))
        if not 0 < len(mu) == len(alpha) or not all(is_number(one, -math.inf) for one in (*mu, *alpha)):
            raise ValueError("material: mu and alpha must be lists of numbers, as many of one as of the other")
        if not all(m * a > 0.0 and abs(a) <= 6.0 for m, a in pairs):
            raise ValueError(
                f"material: every mu * alpha must be positive, and alpha between -6 and 6, but mu = {list(mu)} and "
                f"alpha = {list(alpha)}"
            )
        young, poisson = _of_moduli(0.5 * sum(m * a for m, a in pairs), bulk)
        super().__init__(young, poisson, density, expansion)
        for name, value in (("mu", tuple(map(float, mu))), ("alpha", tuple(map(float, alpha))), ("bulk", bulk)):
            object.__setattr__(self, name, value)

    @property
    def constants(self) -> Mapping[str, float]:
        """The constants of `energy` in pascals."""
        return {**{f"mu_{k}": value for k, value in enumerate(self.mu, start=1)}, "bulk": self.bulk}

    def energy(self, of: Invariants, *constants: Any) -> Any:
        """Sums of powers of stretches are rational functions of the invariants (`_power_sum`), so that derivatives
        exist where stretches are equal, as before deformation; relative errors are 1e-11 at a stretch of 2, 1e-7 at 3.
        """
        (I1, I2, J), (*mu, bulk) = of, constants
        first, second = J ** (-2.0 / 3.0) * I1, J ** (-4.0 / 3.0) * I2
        terms = [m / a * (_power_sum(first, second, 0.5 * a) - 3.0) for m, a in zip(mu, self.alpha, strict=True)]
        return sum(terms) + 0.5 * bulk * (J - 1.0) ** 2


def _of_moduli(mu: float, bulk: float) -> tuple[float, float]:
    """Young's modulus and Poisson's ratio of shear and bulk modulus; ValueError if they are out of proportion."""
    if not is_number(bulk, 0.0) or not 0.0 < mu < 1.5e3 * bulk:
        raise ValueError(
            "material: bulk and the shear modulus of small strains must be positive numbers of pascals, the latter "
            f"small beside bulk, but are {bulk!r} and {mu:g}"
        )
    return 9.0 * bulk * mu / (3.0 * bulk + mu), (3.0 * bulk - 2.0 * mu) / (6.0 * bulk + 2.0 * mu)


Hyperelastic = NeoHookean | MooneyRivlin | Ogden
"""A material with a `law`, its constants and the energy of these."""


def hyperelastic(material: object) -> Hyperelastic:
    """A material of large motions; of small strains, isotropic, with Green's strain; ValueError if it is none."""
    if isinstance(material, Material) and of_place(material.young):
        raise ValueError("material of large motions: young must be a number, one for each group of cells")
    if isinstance(material, Hyperelastic):
        return material
    if type(material) is Material:
        return StVenantKirchhoff(material.young, material.poisson, material.density, material.expansion)
    raise ValueError(
        "material of large motions must be NeoHookean, MooneyRivlin, Ogden, StVenantKirchhoff or an isotropic "
        f"Material, but is {material!r}; for others give a NonlinearBody with your own energy"
    )


_NOTHING = (0.0, 0.0, 0.0)


class _SupportedBody(LoadedBody):
    """Supports, springs and dead loads; prescribed rotations turn by finite angles."""

    def prescribed_values(self, time: float) -> FloatArray:
        values = super().prescribed_values(time)
        for number, support in enumerate(self.supports):
            if isinstance(support, PrescribedRotation):
                here, axis = self._rows.support == number, np.array(support.axis) / np.linalg.norm(support.axis)
                angle = support.angle * self._factor(support.amplitude, time, support.what)
                arms = self.x[self._rows.node[here]] - np.array(support.point)
                way = Rotation.from_rotvec(angle * axis).apply(arms) - arms if len(arms) else arms
                values[here] = np.einsum("ri,ri->r", self._rows.direction[here], way)
        return values


class HyperelasticBody(NonlinearBody):
    """A body of hyperelastic materials on a mesh.

    Tractions and total forces keep their direction and are per undeformed area (dead loads), pressures follow the
    surface; prescribed rotations are finite.  A temperature stretches by j = 1 + expansion dT: the strain energy is
    that of F/j, times j^3 (multiplicative split; S. Vujosevic, V. A. Lubarda: Finite-strain thermoelasticity based on
    multiplicative decomposition of deformation gradient, Theor. Appl. Mech. 28-29, 2002).

    Arguments are those of `Elasticity`; materials are `NeoHookean`, `MooneyRivlin`, `Ogden`, `StVenantKirchhoff`, or
    `Material`, which becomes the last of these.

    Raises:
        ValueError: As `Elasticity`; if there is a material of another kind.
    """

    def __init__(
        self,
        mesh: NamedMesh,
        materials: Materials,
        clamps: Sequence[Support] = (),
        tractions: Sequence[Load] = (),
        body_force: Field = _NOTHING,
        springs: Sequence[Spring] = (),
        body_force_amplitude: Amplitude = 1.0,
        gravity: Sequence[float] = _NOTHING,
        gravity_amplitude: Amplitude = 1.0,
        thermal: ThermalLoad | None = None,
    ):
        if any(spring.at_nodes for spring in springs):
            raise ValueError("spring: springs at nodes are for small motions: give one on a face")
        laws = [(group, hyperelastic(material)) for group, material in by_group(materials)]
        several = isinstance(materials, Mapping)
        materials = {str(group): law for group, law in laws} if several else laws[0][1]
        self._follow = [load for load in tractions if isinstance(load, Pressure)]
        dead = [load for load in tractions if not isinstance(load, Pressure)]
        self._loaded = loaded = _SupportedBody(
            *(mesh, materials, clamps, dead, body_force, springs, body_force_amplitude, gravity, gravity_amplitude)
        )
        u, v, w = fem.Function(loaded.V, name="displacement"), ufl.TestFunction(loaded.V), ufl.TrialFunction(loaded.V)
        F, dx = ufl.Identity(3) + ufl.grad(u), cell_measure(loaded.domain)
        # derivatives by the invariants q: terms are then as many as these, however long the law is
        J, self.thermal, self._amplitude = ufl.det(F), thermal, fem.Constant(loaded.domain, 1.0)
        stretch = None if thermal is None else self._thermal_stretch(thermal, mesh, materials)
        q = elastic(invariants(F), stretch)
        known = [ufl.variable(one) for one in q]
        density = self._density(laws, known) * (1.0 if stretch is None else stretch**3)
        by_q = [ufl.diff(density, one) for one in known]
        rates = [ufl.derivative(one, u, v) for one in q]
        inside = sum(a * rate for a, rate in zip(by_q, rates, strict=True)) * dx
        tangent = sum(
            ufl.diff(a, other) * rate * ufl.derivative(of, u, w)
            for a, rate in zip(by_q, rates, strict=True)
            for other, of in zip(known, q, strict=True)
        )
        tangent += sum(a * ufl.derivative(rate, u, w) for a, rate in zip(by_q, rates, strict=True))
        gradient = ufl.variable(F)
        stress = sum(
            a * ufl.diff(one, gradient) for a, one in zip(by_q, elastic(invariants(gradient), stretch), strict=True)
        )
        self._cauchy = stress * F.T / J
        faces = [mesh.facets(load.face, load.kind) for load in self._follow]
        faces += [mesh.facets(spring.face, "spring") for spring in springs]
        on = _surfaces(loaded, faces)
        normal = J * ufl.inv(F).T * ufl.FacetNormal(loaded.domain)
        self._factors = [fem.Constant(loaded.domain, 0.0) for _ in self._follow]
        pressures = [
            on(k, factor * self._value(load, faces[k]) * ufl.inner(normal, v))
            for k, (load, factor) in enumerate(zip(self._follow, self._factors, strict=True))
        ]
        energy = density * dx
        on_faces = list(pressures)
        for number, spring in enumerate(springs, len(self._follow)):
            stiffness = loaded.spring_stiffness(spring)
            sprung = on(number, sum(0.5 * stiffness[i] * u[i] ** 2 for i in range(3)))
            energy += sprung
            on_faces.append(ufl.derivative(sprung, u, v))
        super().__init__(
            residual=reduce(add, on_faces, inside),
            tangent=reduce(add, (ufl.derivative(one, u, w) for one in on_faces), tangent * dx),
            displacement=u,
            faces=mesh,
            update=self._at_time,
        )
        self._energy = self._at_function(energy)
        self._pressure_forms = [self._at_function(-one) for one in pressures]
        self._siblings = dict[tuple[bool, ...], HyperelasticBody]()
        self._hold(loaded)
        self.materials, self.loads = materials, loaded.loads
        if thermal is not None:  # its forces are in the internal ones
            size = shown_range(range_of(self._change, self.comm))
            self.loads = (*loaded.loads, AppliedLoad(thermal, np.zeros_like(self.reference), size))

    def _hold(self, loaded: _SupportedBody) -> None:
        """Take the supports that act on these bodies."""
        self._loaded, self.held, self.still, self.contradictions = (
            loaded,
            loaded.held,
            loaded.still,
            loaded.contradictions,
        )
        self.acting, self._made = loaded.acting, Made()
        self.__dict__.pop("_not_held", None)
        if self.acting:
            self._siblings[self.acting] = self

    @property
    def limits(self) -> tuple[float, ...]:
        return self._loaded.limits

    def held_at(self, time: float) -> HeldDirections:
        return self._loaded.held_at(time)

    def refuse_beginning(self, time: float) -> None:
        if self._place is None:
            self._loaded.refuse_beginning(time)

    def at_time(self, time: float) -> NonlinearBody:
        super().at_time(time)
        loaded = self._loaded.at_time(time)
        if self._place is not None or loaded is self._loaded:
            return self
        if loaded.acting not in self._siblings:
            copy.copy(self)._hold(loaded)
        return self._siblings[loaded.acting]

    def _density(self, laws: Sequence[tuple[str | None, Any]], of: Sequence[Any]) -> Any:
        """Strain energy per undeformed volume: the sum of those of all laws, each 0 in the cells of others."""
        loaded, found = self._loaded, 0.0
        count = loaded.domain.topology.index_map(3).size_local
        kinds = [(type(material), getattr(material, "alpha", ())) for _, material in laws]
        for kind in dict.fromkeys(kinds):
            mine = [law for law, of in zip(laws, kinds, strict=True) if of == kind]
            values = {name: np.zeros(count) for name in mine[0][1].constants}
            for group, material in mine:
                cells: Any = slice(None) if group is None else loaded.mesh.group(group, "material")
                for name, value in material.constants.items():
                    values[name][cells] = value
            found += mine[0][1].energy(of, *(loaded._on_cells(one, name) for name, one in values.items()))
        return found

    def _thermal_stretch(self, thermal: ThermalLoad, mesh: NamedMesh, materials: Materials) -> Any:
        """1 + expansion dT, a scalar of UFL, at the present amplitude; collective."""
        loaded = self._loaded
        expansion = material_of_cells(mesh, materials, heated=True).expansion
        assert expansion is not None
        self._change = thermal.change(loaded, mesh)
        kelvin = loaded.function(np.repeat(self._change[:, None], 3, axis=1), "temperature")[0]
        return 1.0 + self._amplitude * loaded._on_cells(expansion, "expansion") * kelvin

    def _value(self, load: Pressure, facets: npt.NDArray[np.int32]) -> Any:
        """The pressure at amplitude 1, a scalar of UFL, from its nodal values."""
        values = load.nodal_values(self._loaded, facets)
        return self._loaded.function(np.repeat(values[:, None], 3, axis=1), "pressure")[0]

    def _at_time(self, time: float) -> None:
        for factor, load in zip(self._factors, self._follow, strict=True):
            factor.value = evaluate_amplitude(load.amplitude, time, f"pressure on {load.face!r}")
        if self.thermal is not None:
            self._amplitude.value = evaluate_amplitude(self.thermal.amplitude, time, "temperature")

    def _outer_forces(self, u: FloatArray, time: float, before: End | None) -> tuple[Loading, FloatArray, FloatArray]:
        inside, *_ = super()._outer_forces(u, time, before)
        dead, load = self._loaded.after(time, before), sum((one.forces for one in self._following()), np.zeros_like(u))
        spring = self._loaded.spring_force(u)
        heat = None
        if self.thermal is not None:
            heat = Temperature(float(self._amplitude.value) * self._change, self.thermal.reference, 0.0)
        return Loading(time, inside.load + dead.load, dead.prescribed, heat), dead.load + load, spring

    def _following(self) -> Iterator[NodalForces]:
        """The forces of pressures at the present displacement."""
        self._evaluate_at(self._displacement.x.array[: self.reference.size])
        for load, form in zip(self._follow, self._pressure_forms, strict=True):
            yield NodalForces("pressure", load.face, form.vector())

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        yield from self._loaded.loads_at(loading.time)
        yield from self._following()

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        return self._loaded.shares(reaction)

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        return self._loaded.spring_forces(u)

    def support_entries(self) -> list[dict[str, Any]]:
        return self._loaded.support_entries()

    def forms(self) -> None:
        return None

    def strain_energy(self, u: FloatArray) -> float:
        return self._value_of(self._energy, u)

    def cell_fields(self, u: Any, loading: Loading) -> list[Any]:
        """Cauchy stresses at the cells' midpoints, and the constants of the materials."""
        stress = ufl.replace(self._cauchy, {self._displacement: u})
        return [*self._loaded.stress_fields(self._loaded.at_midpoints(stress)), *self._loaded.constants.values()]

    @property
    def numbers_per_cell(self) -> int:
        return self._loaded.numbers_per_cell


def _surfaces(body: LoadedBody, faces: Sequence[npt.NDArray[np.int32]]) -> Callable[[int, Any], Any]:
    """The integral over a face, by its number, of an integrand, as a form.  Faces may overlap: of one set of tags every
    facet has that of the faces that it is on."""
    facets = np.unique(np.concatenate([np.empty(0, dtype=np.int32), *faces])).astype(np.int32)
    tags = np.zeros(len(facets), dtype=np.int32)
    for number, face in enumerate(faces):
        tags += np.isin(facets, face).astype(np.int32) << number
    known = compat.meshtags(body.domain, 2, facets, tags)
    degree = {"quadrature_degree": 4 * body.degree}
    ds = ufl.Measure("ds", domain=body.domain, subdomain_data=known, metadata=degree)
    everywhere = sorted({int(tag) for part in body.comm.allgather(np.unique(tags)) for tag in part})

    def on(number: int, integrand: Any) -> Any:
        return reduce(add, (integrand * ds(tag) for tag in everywhere if tag >> number & 1))

    return on
