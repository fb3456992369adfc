"""The tables of a case file that describe the solver and the output."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

import coulomb

from .. import solvers
from ..model.times import HALVINGS, refuse_times
from .values import ROWS, Duration, FileName, Name, Number, Rounds, Steps, Table, Vector

if TYPE_CHECKING:
    from ..solvers.friction_problem import Solver
    from ..solvers.newton_systems import NewtonChoice


class UnitsTable(Table):
    """The units of length and stress of all numbers of a case and its results; of forces stress times length^2, of
    energies stress times length^3, of densities stress times s^2 over length^2."""

    length: Literal["m", "cm", "mm", "um", "in", "ft"] = "m"
    stress: Literal["Pa", "kPa", "MPa", "GPa", "psi"] = "Pa"


class SolverTable(Table):
    """Accuracy, and methods in place of the choice by size; newton = "condensed" is matrix-free.  kinematics = "large"
    is for large motions, branch = "stable" for their stable equilibria."""

    kinematics: Literal["small", "large"] = "small"
    branch: Literal["any", "stable"] = "any"

    tolerance: Annotated[float, Field(ge=1e-12, le=1e-6, strict=True)] = 1e-8
    linear_solver: Literal["auto", "direct", "iterative"] = "auto"
    compliance: Literal["auto", "explicit", "matrix-free"] = "auto"
    method: Literal["auto", "interior-point", "successive-tresca"] = "auto"
    newton: Literal["recycling", "augmented", "schur", "dense", "condensed"] = "recycling"
    max_outer: Rounds | None = None

    @model_validator(mode="after")
    def _belongs_together(self) -> SolverTable:
        if self.max_outer is not None and self.method != "successive-tresca":
            raise ValueError('max_outer counts Tresca problems: it needs method = "successive-tresca"')
        if self.method == "interior-point" and self.newton in ("augmented", "schur"):
            raise ValueError(f'newton = "{self.newton}" is for Tresca problems: it needs method = "successive-tresca"')
        if self.newton == "condensed" and self.compliance == "explicit":
            raise ValueError('newton = "condensed" works with K in place of A: leave compliance at "auto"')
        return self

    def contact_solver(self, sloped: bool) -> Solver:
        """The paper's Newton systems imply successive Tresca; `sloped` is whether friction grows with pressure
        anywhere.
        """
        systems: dict[str, NewtonChoice] = {
            "recycling": solvers.AugmentedSystem(),
            "augmented": solvers.AugmentedSystem(rank=0),
            "schur": solvers.SchurComplementSystem(rank=0),
            "dense": solvers.DenseSystem(),
            "condensed": solvers.CondensedSystem(),
        }
        whole = coulomb.InteriorPoint(self.tolerance, newton=systems[self.newton])
        if not sloped and self.method == "auto" and self.newton == "recycling":
            return solvers.Automatic(self.tolerance, whole)
        if not sloped and self.method == "auto":
            return whole
        if self.newton in ("dense", "condensed") and self.method != "successive-tresca":
            return whole
        if self.method == "successive-tresca" or self.newton in ("augmented", "schur"):
            most = coulomb.SuccessiveTresca.max_iterations if self.max_outer is None else self.max_outer
            return coulomb.SuccessiveTresca(self.tolerance, replace(whole, r_tol=0.1, c_fact=0.9), max_iterations=most)
        return (
            coulomb.InteriorPoint(self.tolerance)
            if self.method == "interior-point"
            else solvers.Automatic(self.tolerance)
        )


class HistoryTable(Table):
    """Load steps: their ends, or the end of the last and their number; from time 0, with the body free of stress."""

    times: Annotated[tuple[Number, ...], Field(max_length=ROWS)] | None = None
    end: Duration | None = None
    steps: Steps | None = None
    halvings: Annotated[int, Field(ge=0, le=30, strict=True)] = HALVINGS
    friction_error: Annotated[Number, Field(gt=0, lt=1)] | None = None

    @model_validator(mode="after")
    def _times_or_steps(self) -> HistoryTable:
        if (self.times is None) == (self.end is None or self.steps is None):
            raise ValueError("give either times, a list that increases from 0, or end and steps")
        refuse_times(0.0, self.ends)
        return self

    @property
    def ends(self) -> tuple[float, ...]:
        if self.times is not None:
            return self.times
        assert self.end is not None and self.steps is not None
        return tuple(float(t) for t in np.linspace(0.0, self.end, self.steps + 1)[1:])


def _inputs(given: object) -> object:
    names = given if isinstance(given, list | tuple) else ()
    if not isinstance(given, bool) and not (names and all(isinstance(name, str) for name in names)):
        raise ValueError('should be true, false, or a list of inputs, as ["friction of \'bottom\'", "material.young"]')
    return given


class OutputTable(Table):
    """Directory of the results, and whether to write a picture and the report, and to estimate the error of the mesh:
    error bars of all totals.  `format` are the files of the fields, `sensitivity` derivatives of totals along all
    inputs, or those of a list by their names or the places of numbers, with what the tolerances of inputs make
    uncertain together; `verify` compares each with answers of the changed case."""

    directory: FileName = "results"
    picture: bool = True
    report: bool = False
    error: bool = False
    sensitivity: Annotated[bool | tuple[str, ...], BeforeValidator(_inputs)] = False
    verify: bool = False
    format: tuple[Literal["xdmf", "vtkhdf", "csv", "frd"], ...] = ("xdmf",)

    @model_validator(mode="after")
    def _with_xdmf(self) -> OutputTable:
        if self.verify and not self.sensitivity:
            raise ValueError("verify is about sensitivity: give both")
        if "xdmf" not in self.format:
            raise ValueError('format must have "xdmf", which coulomb check reads: ["xdmf", "vtkhdf"]')
        return self


class ProbeTable(Table):
    """A named point in metres at which displacement, slip and pressure are reported, and the body that has it."""

    name: Name
    point: Vector
    body: Name | None = None

    def probe(self) -> coulomb.Probe:
        return coulomb.Probe(self.name, self.point, self.body)
