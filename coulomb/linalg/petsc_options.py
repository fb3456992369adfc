"""Objects of PETSc that are configured by options, without leaving these in its database."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from petsc4py import PETSc

_prefixes = (f"coulomb_{number}_" for number in itertools.count())


@contextmanager
def petsc_options(prefix: str, values: Mapping[str, object]) -> Iterator[None]:
    """Set PETSc options under a prefix, and remove them afterwards."""
    database = PETSc.Options(prefix)
    for key, value in values.items():
        database[key] = value
    try:
        yield
    finally:
        for key in values:
            database.delValue(key)


def configured_ksp(
    K: PETSc.Mat,
    ksp_type: str,
    values: Mapping[str, object],
    operator: PETSc.Mat | None = None,
    prepare: Callable[[PETSc.PC], None] | None = None,
) -> PETSc.KSP:
    """A KSP set up with the given options only; they are removed from PETSc's database afterwards.

    Args:
        K: The matrix of which the preconditioner is made.
        ksp_type: PETSc's name of the method.
        values: The options, without prefix.
        operator: The matrix of the system, if it is not K.
        prepare: Called with the preconditioner before the options are set.
    """
    prefix = next(_prefixes)
    ksp = PETSc.KSP().create(K.comm)
    ksp.setOperators(K if operator is None else operator, K)
    ksp.setType(ksp_type)
    ksp.setErrorIfNotConverged(True)
    ksp.setOptionsPrefix(prefix)
    if prepare is not None:
        prepare(ksp.getPC())
    with petsc_options(prefix, values):
        ksp.setFromOptions()
        ksp.setUp()
    return ksp
