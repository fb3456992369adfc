"""The tables of a case file that describe the solver and the output."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .case_body import Count, Table


class SolverTable(Table):
    """Accuracy, and the methods where the choice by size is not wanted; newton = "condensed" works matrix-free."""

    tolerance: Annotated[float, Field(ge=1e-12, le=1e-6, strict=True)] = 1e-8
    linear_solver: Literal["auto", "direct", "iterative"] = "auto"
    compliance: Literal["auto", "explicit", "matrix-free"] = "auto"
    method: Literal["auto", "one-loop", "fixed-point"] = "auto"
    newton: Literal["recycling", "augmented", "schur", "dense", "condensed"] = "recycling"
    max_outer: Count | None = None

    @model_validator(mode="after")
    def _belongs_together(self) -> SolverTable:
        if self.max_outer is not None and self.method != "fixed-point":
            raise ValueError('max_outer counts Tresca problems: it needs method = "fixed-point"')
        if self.method == "one-loop" and self.newton in ("augmented", "schur"):
            raise ValueError(f'newton = "{self.newton}" is for Tresca problems: it needs method = "fixed-point"')
        if self.newton == "condensed" and self.compliance == "explicit":
            raise ValueError('newton = "condensed" works with K in place of A: leave compliance at "auto"')
        return self


class OutputTable(Table):
    """Where results go, whether to draw them, and whether to write a page about them."""

    directory: str = "results"
    picture: bool = True
    report: bool = False
