"""Hyperelastic materials: strain energies per undeformed volume, as expressions of UFL, and as materials of a mesh."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np

from ...arrays import FloatArray, is_number
from ..compat import ufl
from ..geometry import of_place
from .materials import Material

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
    from scipy.special import roots_jacobi  # takes time to load, and only such laws need it

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


@dataclass(frozen=True)
class Volumetric:
    """The part of an energy that resists changes of volume: a modulus times a function of one of the `Invariants`.

    Attributes:
        modulus: The name of the modulus among the constants.
        invariant: The number of the invariant.
        function: The function and its first two derivatives, shape (3, n), of numbers (n,).
    """

    modulus: str
    invariant: int
    function: Callable[[FloatArray], FloatArray]


def _of_logarithm(J: FloatArray) -> FloatArray:
    """(ln J)^2/2"""
    return np.array([0.5 * np.log(J) ** 2, np.log(J) / J, (1.0 - np.log(J)) / J**2])


def _of_change(J: FloatArray) -> FloatArray:
    """(J - 1)^2/2"""
    return np.array([0.5 * (J - 1.0) ** 2, J - 1.0, np.ones_like(J)])


def _of_trace(I1: FloatArray) -> FloatArray:
    """(tr E)^2/2 with tr E = (I1 - 3)/2"""
    return 0.25 * np.array([0.5 * (I1 - 3.0) ** 2, I1 - 3.0, np.ones_like(I1)])


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

    volumetric: ClassVar[Volumetric] = Volumetric("lame", 2, _of_logarithm)


class StVenantKirchhoff(NeoHookean):
    """Hooke's law between Green's strain and the second Piola-Kirchhoff stress (`st_venant_kirchhoff`): for large
    rotations and small strains.  It is what a `Material` becomes in large motions."""

    law = "st-venant-kirchhoff"

    @staticmethod
    def energy(of: Invariants, mu: Any, lame: Any) -> Any:
        I1, I2, _ = of  # tr E = (I1 - 3)/2, and E : E = (I1^2 - 2 I2 - 2 I1 + 3)/4
        return 0.25 * mu * (I1**2 - 2.0 * I2 - 2.0 * I1 + 3.0) + 0.125 * lame * (I1 - 3.0) ** 2

    volumetric: ClassVar[Volumetric] = Volumetric("lame", 0, _of_trace)


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

    volumetric: ClassVar[Volumetric] = Volumetric("bulk", 2, _of_change)


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

    volumetric: ClassVar[Volumetric] = MooneyRivlin.volumetric


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
