"""Strain energies of hyperelastic materials, per undeformed volume, as expressions of UFL."""

from __future__ import annotations

from typing import Any

from ..fem.compat import ufl


def neo_hookean(displacement: Any, mu: Any, lame: Any) -> Any:
    """Compressible neo-Hookean energy, mu/2 (I1 - 3 - 2 ln J) + lame/2 (ln J)^2 (Bonet and Wood 2008, eq. 6.27).

    Args:
        displacement: A function.
        mu, lame: Lame's constants in pascals: numbers, constants or functions.
    """
    F = _gradient(displacement)
    J = ufl.det(F)
    return 0.5 * mu * (ufl.inner(F, F) - 3.0 - 2.0 * ufl.ln(J)) + 0.5 * lame * ufl.ln(J) ** 2


def mooney_rivlin(displacement: Any, c1: Any, c2: Any, bulk: Any) -> Any:
    """Mooney-Rivlin energy c1 (J^(-2/3) I1 - 3) + c2 (J^(-4/3) I2 - 3) + bulk/2 (J - 1)^2; constants in pascals."""
    F = _gradient(displacement)
    J, C = ufl.det(F), F.T * F
    first = ufl.tr(C)
    second = 0.5 * (first**2 - ufl.tr(C * C))
    return (
        c1 * (J ** (-2.0 / 3.0) * first - 3.0) + c2 * (J ** (-4.0 / 3.0) * second - 3.0) + 0.5 * bulk * (J - 1.0) ** 2
    )


def st_venant_kirchhoff(displacement: Any, mu: Any, lame: Any) -> Any:
    """Energy mu E : E + lame/2 (tr E)^2 of Green's strain E = (F^T F - I)/2: for large rotations and small strains."""
    F = _gradient(displacement)
    E = 0.5 * (F.T * F - ufl.Identity(3))
    return mu * ufl.inner(E, E) + 0.5 * lame * ufl.tr(E) ** 2


def _gradient(displacement: Any) -> Any:
    """F = I + grad u."""
    return ufl.Identity(3) + ufl.grad(displacement)
