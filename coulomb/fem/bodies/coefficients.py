"""Derivatives of forms along the user's coefficients in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from petsc4py import PETSc

from ...arrays import FloatArray
from ..compat import fem, ufl
from .compiled_form import compiled

_WHAT = "the derivative along a coefficient"


def along_coefficient(forms: Sequence[Any], coefficient: Any, W: Any) -> FloatArray | None:
    """Derivative of the sum of forms without arguments along a coefficient; None if it is in none of them; collective.

    Along a Constant it has the shape of its value, and is the same on every rank: functions that are constant on cells,
    of the space W, take its place.  Along a Function it is that along its values which this rank owns, shape (n,).
    """
    comm = W.mesh.comm
    if isinstance(coefficient, fem.Function):
        within = [form for form in forms if any(of is coefficient for of in form.coefficients())]
        test = ufl.TestFunction(coefficient.function_space)
        parts = [part for one in within for part in compiled(ufl.derivative(one, coefficient, test), _WHAT, comm).parts]
        return np.sum([_assembled(part) for part in parts], axis=0) if parts else None
    within = [form for form in forms if any(of is coefficient for of in form.constants())]
    if not within:
        return None
    value = np.asarray(coefficient.value)
    entries, way = [fem.Function(W) for _ in range(value.size)], fem.Function(W)
    for function, number in zip((*entries, way), (*value.ravel(), 1.0), strict=True):
        function.x.array[:] = number
    whole = ufl.as_tensor(np.array(entries, dtype=object).reshape(value.shape)) if value.shape else entries[0]
    taken = [ufl.replace(one, {coefficient: whole}) for one in within]
    found = [sum(compiled(ufl.derivative(one, of, way), _WHAT, comm).number(comm) for one in taken) for of in entries]
    return np.array(found).reshape(value.shape)


def _assembled(form: Any) -> FloatArray:
    """A compiled linear form; collective."""
    vector = fem.petsc.assemble_vector(form)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    values: FloatArray = vector.array.copy()
    vector.destroy()
    return values
