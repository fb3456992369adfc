"""The user's bilinear form a(u, v): its matrix, and its residual form at a displacement, for any values of its
coefficients."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from petsc4py import PETSc

from ...arrays import FloatArray
from .. import compat, compat_forms
from ..compat import fem, ufl


@dataclass(frozen=True)
class FormValues:
    """The values of the coefficients of a form at one time; this rank's part.

    Attributes:
        functions: Of every function in it, ghosts included.
        constants: Of all constants, packed.
    """

    functions: tuple[FloatArray, ...]
    constants: FloatArray

    def same(self, other: FormValues) -> bool:
        """Whether all values on this rank are equal."""
        pairs = zip(self.functions, other.functions, strict=True)
        equal = all(np.array_equal(one, two) for one, two in pairs)
        return equal and np.array_equal(self.constants, other.constants)


def values_of(form: Any) -> FormValues:
    """The present values of the coefficients of a compiled form."""
    functions = tuple(np.array(function.x.array) for function in compat_forms.functions_in(form))
    return FormValues(functions, compat_forms.packed_constants(form))


def compiled(form: Any, what: str) -> Any:
    """A form, compiled by DOLFINx unless it is already.

    Raises:
        ValueError: If it cannot be; the message begins with `what`.
    """
    if compat_forms.is_compiled(form):
        return form
    try:
        return fem.form(form)
    except Exception as error:
        reason = str(error).strip().splitlines()
        raise ValueError(f"{what} cannot be compiled: {reason[-1] if reason else type(error).__name__}") from None


class BilinearForm:
    """A bilinear form on a space of displacements.

    Of a UFL form the residual is the compiled action a(u, v) for all v; of a compiled form, of which no action can be
    made, it is the product of a matrix that is assembled anew.

    Args:
        a: UFL or compiled.
        V: The space.

    Raises:
        ValueError: If it cannot be compiled.
    """

    def __init__(self, a: Any, V: Any):
        self._form, self._u = compiled(a, "a"), fem.Function(V)
        self._action = None if compat_forms.is_compiled(a) else compiled(ufl.action(a, self._u), "a")

    @property
    def values(self) -> FormValues:
        """The present values of its coefficients."""
        return values_of(self._form)

    def suspects(self, values: FormValues) -> str:
        """Which of these values make a vanish or have no finite values, for the end of a message; empty if none do;
        collective."""
        comm = self._u.function_space.mesh.comm
        names = [f"the function {function.name!r}" for function in compat_forms.functions_in(self._form)]
        sizes = [float(np.max(np.abs(one), initial=0.0)) for one in values.functions]
        sizes = [float(np.max(comm.allgather(size))) for size in sizes]  # nan is the largest
        names += ["a constant"] * len(values.constants)
        sizes += map(float, np.abs(values.constants))
        wrong = ((name, size) for name, size in zip(names, sizes, strict=True) if not 0.0 < size < np.inf)
        said = (f"; {name} in a is {'0' if size == 0.0 else 'not finite'}" for name, size in wrong)
        return "".join(dict.fromkeys(said))

    def matrix(self, values: FormValues) -> PETSc.Mat:
        """The matrix with these values of the coefficients; collective."""
        with self._holding(values):
            return compat.assemble_matrix(self._form, values.constants)

    def residual(self, values: FormValues, u: FloatArray) -> FloatArray:
        """a(u, v) of all hat functions v, for nodal vectors u; shapes (k, 3); collective."""
        if self._action is None:
            return self._product(values, u)
        own = self._u.x.array[: u.size]
        own[:] = u.ravel()
        self._u.x.scatter_forward()
        with self._holding(values):
            vector = fem.petsc.assemble_vector(self._action, values.constants)
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        forces: FloatArray = vector.array.reshape(-1, 3).copy()
        vector.destroy()
        return forces

    def _product(self, values: FormValues, u: FloatArray) -> FloatArray:
        K = self.matrix(values)
        given, result = K.createVecs()
        given.array[:] = u.ravel()
        K.mult(given, result)
        forces: FloatArray = result.array_r.reshape(-1, 3).copy()
        for done in (K, given, result):
            done.destroy()
        return forces

    @contextmanager
    def _holding(self, values: FormValues) -> Iterator[None]:
        """With the user's functions at other values, which are reset afterwards."""
        functions = compat_forms.functions_in(self._form)
        present = [np.array(function.x.array) for function in functions]
        for function, taken in zip(functions, values.functions, strict=True):
            function.x.array[:] = taken
        try:
            yield
        finally:
            for function, taken in zip(functions, present, strict=True):
                function.x.array[:] = taken
