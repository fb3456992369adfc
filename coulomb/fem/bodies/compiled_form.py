"""Forms of the user as FFCx compiles them rightly: one form, or a sum of several.

FFCx evaluates what is constant on a cell once, before its loops over the points of each quadrature rule.  With a rule
of one point everything counts as constant, and the loops of other rules of the same form then take the values at that
point for their own: coefficients, and on hexahedra that are no parallelepipeds the Jacobian, so that matrices are
wrong, too (`verification/quadrature_rules.py`: actions by 72 %, matrices by 10 %; FFCx 0.5 to 0.11).  Integrals with
one point are therefore compiled apart from the others.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import FloatArray
from .. import compat
from ..compat import fem, ufl
from ..geometry import on_all_ranks
from .displacement_space import summed


class CompiledForm:
    """The sum of compiled forms on the same spaces; constants are those of all, one after the other."""

    def __init__(self, parts: list[Any]):
        self.parts = tuple(parts)

    @property
    def functions(self) -> list[Any]:
        """The functions in it, with their values in `x.array`; one of several parts for each of them."""
        return [function for part in self.parts for function in compat.functions_in(part)]

    @property
    def constants(self) -> FloatArray:
        """A copy of the values of its constants, packed."""
        return np.concatenate([compat.packed_constants(part) for part in self.parts])

    def matrix(self, constants: FloatArray) -> PETSc.Mat:
        """Of a bilinear form, with these values of the constants; collective."""
        first, *others = (compat.assemble_matrix(part, of) for part, of in zip(*self._with(constants), strict=True))
        for other in others:
            first.axpy(1.0, other, PETSc.Mat.Structure.UNKNOWN_NONZERO_PATTERN)
            other.destroy()
        return first

    def vector(self, constants: FloatArray | None = None) -> FloatArray:
        """Of a linear form at this rank's nodes, shape (k, 3), with these values of the constants, or those that they
        have; collective."""
        of_parts = zip(*self._with(self.constants if constants is None else constants), strict=True)
        return np.sum([summed(fem.petsc.assemble_vector(part, of)) for part, of in of_parts], axis=0)

    def number(self, comm: MPI.Comm) -> float:
        """Of a form without arguments; collective."""
        return float(comm.allreduce(sum(fem.assemble_scalar(part) for part in self.parts)))

    def _with(self, constants: FloatArray) -> tuple[tuple[Any, ...], list[FloatArray]]:
        sizes = [len(compat.packed_constants(part)) for part in self.parts]
        return self.parts, np.split(constants, np.cumsum(sizes)[:-1])


def compiled(form: Any, what: str, comm: MPI.Comm) -> CompiledForm:
    """A form, compiled by DOLFINx unless it is already; ValueError on every rank, beginning with `what`, if it cannot
    be; collective."""
    if isinstance(form, CompiledForm):
        return form
    if compat.is_compiled(form):
        return CompiledForm([form])

    def compile_it() -> CompiledForm:
        try:
            return CompiledForm([fem.form(part) for part in _by_rule(form)])
        except Exception as error:
            reason = str(error).strip().splitlines() or [type(error).__name__]
            names = [str(one.name) for one in form.coefficients() if hasattr(one, "name")]
            unfit = "".join(
                f"; {name!r} names a function: give it one of letters, digits and _"
                for name in names
                if not name.isidentifier()
            )
            raise ValueError(reason[-1] + unfit) from None

    return on_all_ranks(compile_it, f"{what} cannot be compiled", comm)


def _by_rule(form: Any) -> list[Any]:
    """The integrals of a form of UFL with more points than one, and those with one; the form itself if those of one
    kind (cells, facets) are not several, or alike in this."""
    kinds = [integral.integral_type() for integral in form.integrals()]
    if len(set(kinds)) == len(kinds):
        return [form]
    integrals = ufl.algorithms.expand_derivatives(form).integrals()  # of which degrees can be estimated
    single = [_has_one_point(integral) for integral in integrals]
    if len(set(single)) < 2:
        return [form]
    return [
        ufl.Form([one for one, alone in zip(integrals, single, strict=True) if alone == which])
        for which in (False, True)
    ]


def _has_one_point(integral: Any) -> bool:
    given = integral.metadata()
    if "quadrature_points" in given:
        return len(given["quadrature_points"]) == 1
    if given.get("quadrature_rule") == "vertex":
        return False
    degree = given.get("quadrature_degree", -1)
    if not isinstance(degree, int) or degree < 0:
        degree = ufl.algorithms.estimate_total_polynomial_degree(integral.integrand())
    return bool(np.max(degree) <= 1)


def with_own_degrees(form: Any) -> Any:
    """A form whose integrals have the degrees of quadrature by which FFCx would compute them, so that its derivatives
    are computed by the same."""
    steps = ("function_pullbacks", "integral_scaling", "geometry_lowering", "restrictions")
    kept = {"preserve_geometry_types": (ufl.classes.Jacobian,), "do_append_everywhere_integrals": False}
    data = ufl.algorithms.compute_form_data(form, **{f"do_apply_{step}": True for step in steps}, **kept)
    degrees: dict[str, Any] = {}
    for of_kind in data.integral_data:
        estimated = [integral.metadata()["estimated_polynomial_degree"] for integral in of_kind.integrals]
        degrees[of_kind.integral_type] = np.max([degrees.get(of_kind.integral_type, 0), *map(np.max, estimated)])
    return ufl.Form(
        [
            one.reconstruct(
                metadata={"quadrature_degree": int(degrees[one.integral_type()]), **_given_rule(one.metadata())}
            )
            for one in form.integrals()
        ]
    )


def _given_rule(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """Metadata without a degree that is left to UFL."""
    return {name: value for name, value in metadata.items() if not (name == "quadrature_degree" and value == -1)}


def terms_without(u: Any, form: Any) -> Any:
    """The terms of a form in which a function is not; None if there are none."""
    parts = [
        integral.reconstruct(term)
        for integral in form.integrals()
        for term in _terms(integral.integrand())
        if u not in ufl.algorithms.extract_coefficients(term)
    ]
    return ufl.Form(parts) if parts else None


def _terms(integrand: Any) -> Iterator[Any]:
    """The terms of a sum, and of products and quotients of one."""
    if isinstance(integrand, ufl.classes.Sum):
        for one in integrand.ufl_operands:
            yield from _terms(one)
        return
    if isinstance(integrand, ufl.classes.Product | ufl.classes.Division):
        first, second = integrand.ufl_operands
        product = isinstance(integrand, ufl.classes.Product)
        if isinstance(first, ufl.classes.Sum):
            for one in _terms(first):
                yield from _terms(one * second if product else one / second)
            return
        if product and isinstance(second, ufl.classes.Sum):
            for one in _terms(second):
                yield from _terms(first * one)
            return
    yield integrand


def integrals_of_kind(form: Any, cells: bool) -> Any:
    """The integrals of a form over cells, or the others; None if there are none."""
    chosen = [one for one in form.integrals() if (one.integral_type() == "cell") == cells]
    return ufl.Form(chosen) if chosen else None
