"""Settings of the solvers: every number is checked."""

from dataclasses import fields

import pytest
from conftest import make_block

from coulomb import InteriorPoint, SuccessiveTresca
from coulomb.solvers import (
    KPRGP,
    AugmentedSystem,
    Automatic,
    CondensedSystem,
    ConeInteriorPoint,
    DirectSolver,
    IterativeSolver,
    MatrixAutomatic,
    RegularisedNewton,
    SchurComplementSystem,
)
from coulomb.solvers.semismooth_newton import SemismoothNewton

SOLVERS = [
    *(Automatic, InteriorPoint, SuccessiveTresca, KPRGP, SemismoothNewton, ConeInteriorPoint, RegularisedNewton),
    *(MatrixAutomatic, SchurComplementSystem, AugmentedSystem, CondensedSystem),
]
NUMBER_TYPES = ("float", "int", "float | None", "tuple")
NUMBERS = [
    (solver, field.name) for solver in SOLVERS for field in fields(solver) if field.type.split("[")[0] in NUMBER_TYPES
]


@pytest.mark.parametrize(("solver", "name"), NUMBERS, ids=lambda value: getattr(value, "__name__", value))
def test_every_number_is_checked(solver, name):
    for wrong in (float("nan"), -1.0, "1", ()):
        with pytest.raises(ValueError, match=rf"{solver.__name__}: {name} must be .*, but is"):
            solver(**{name: wrong})


@pytest.mark.parametrize(
    ("solver", "field", "must"),
    [
        (InteriorPoint, {"backtrack": 1.5}, r"in \(0, 1\)"),
        (InteriorPoint, {"backtrack": 1.0}, r"in \(0, 1\)"),
        (InteriorPoint, {"to_boundary": 5.0}, r"in \(0, 1\)"),
        (InteriorPoint, {"tolerance": 0.0}, "> 0"),
        (InteriorPoint, {"r_tol": 1.0}, r"in \(0, 1\)"),
        (InteriorPoint, {"sigma_min": 0.0}, r"in \(0, sigma_max\]"),
        (InteriorPoint, {"sigma_min": 0.6}, r"in \(0, sigma_max\]"),
        (InteriorPoint, {"sigma_max": 0.51}, r"in \(0, 0.5\]"),
        (InteriorPoint, {"start_products": -1}, "an integer at least 0"),
        (InteriorPoint, {"max_iterations": 0}, "an integer at least 1"),
        (InteriorPoint, {"max_iterations": 2.5}, "an integer at least 1"),
        (InteriorPoint, {"max_iterations": True}, "an integer at least 1"),
        (InteriorPoint, {"starts": ()}, "> 0"),
        (InteriorPoint, {"starts": (1e3, 0.0)}, "> 0"),
        (KPRGP, {"proportionality": 0.0}, "> 0"),
        (KPRGP, {"step": 2.0}, ".*"),
        (KPRGP, {"step": 0.0}, ".*"),
        (SuccessiveTresca, {"inner_precision": 1.0}, ".*"),
        (SuccessiveTresca, {"damping": 0}, r"in \(0, 1\], or None"),
    ],
)
def test_bounds(solver, field, must):
    with pytest.raises(ValueError, match=rf"{solver.__name__}: {next(iter(field))} must be {must}, but is"):
        solver(**field)


def test_ends_of_intervals():
    assert InteriorPoint(sigma_min=0.5, sigma_max=0.5).sigma_min == 0.5
    assert SuccessiveTresca(damping=None).damping is None and SuccessiveTresca(damping=1).damping == 1


def test_the_solver_for_the_stiffness_by_name():
    """As in a case file; "direct" was accepted once and ended in "'str' object is not callable"."""
    for name, solver in (("direct", DirectSolver), ("iterative", IterativeSolver)):
        assert make_block(2, linear_solver=name).body.stiffness.linear_solver is solver
    assert (
        make_block(2, linear_solver="auto").body.stiffness.linear_solver is make_block(2).body.stiffness.linear_solver
    )
    for wrong in ("mumps", 1, Automatic):
        with pytest.raises(
            ValueError, match='linear_solver must be "auto", "direct" or "iterative", or one of the classes'
        ):
            make_block(2, linear_solver=wrong)
