"""The tables of a case file that describe the solver and the output."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BeforeValidator, Field, model_validator

from .body import Table
from .renamed import current_method
from .values import FileName, Rounds

if TYPE_CHECKING:
    from ..solvers.friction_problem import CoulombSolver, QPSolver
    from ..solvers.newton_systems import NewtonSystem


class SolverTable(Table):
    """Accuracy, and methods in place of the choice by size; newton = "condensed" is matrix-free."""

    tolerance: Annotated[float, Field(ge=1e-12, le=1e-6, strict=True)] = 1e-8
    linear_solver: Literal["auto", "direct", "iterative"] = "auto"
    compliance: Literal["auto", "explicit", "matrix-free"] = "auto"
    method: Annotated[Literal["auto", "one-loop", "successive-tresca"], BeforeValidator(current_method)] = "auto"
    newton: Literal["recycling", "augmented", "schur", "dense", "condensed"] = "recycling"
    max_outer: Rounds | None = None

    @model_validator(mode="after")
    def _belongs_together(self) -> SolverTable:
        if self.max_outer is not None and self.method != "successive-tresca":
            raise ValueError('max_outer counts Tresca problems: it needs method = "successive-tresca"')
        if self.method == "one-loop" and self.newton in ("augmented", "schur"):
            raise ValueError(f'newton = "{self.newton}" is for Tresca problems: it needs method = "successive-tresca"')
        if self.newton == "condensed" and self.compliance == "explicit":
            raise ValueError('newton = "condensed" works with K in place of A: leave compliance at "auto"')
        return self

    def contact_solver(self, sloped: bool) -> CoulombSolver | QPSolver:
        """The solver of the table; the paper's Newton systems imply successive Tresca.

        Args:
            sloped: Whether friction grows with pressure at any node.
        """
        from ..solvers.automatic import Automatic
        from ..solvers.condensed import CondensedConeSystem, CondensedSystem
        from ..solvers.cone_systems import DenseConeSystem
        from ..solvers.dense_system import DenseSystem
        from ..solvers.newton_systems import AugmentedSystem, RecyclingSystem, SchurComplementSystem
        from ..solvers.one_loop import OneLoop
        from ..solvers.path_following import PathFollowing
        from ..solvers.successive_tresca import SuccessiveTresca

        systems: dict[str, type[NewtonSystem]] = {
            "recycling": RecyclingSystem,
            "augmented": AugmentedSystem,
            "schur": SchurComplementSystem,
            "dense": DenseSystem,
            "condensed": CondensedSystem,
        }
        path_following = PathFollowing(tolerance=self.tolerance, newton=systems[self.newton])
        if self.method == "auto" and not sloped:
            return path_following
        if self.method == "successive-tresca" or self.newton in ("augmented", "schur"):
            most = SuccessiveTresca.max_iterations if self.max_outer is None else self.max_outer
            return SuccessiveTresca(self.tolerance, path_following, max_iterations=most)
        if self.newton == "dense":
            return OneLoop(self.tolerance, newton=DenseConeSystem)
        if self.newton == "condensed":
            return OneLoop(self.tolerance, newton=CondensedConeSystem)
        return OneLoop(self.tolerance) if self.method == "one-loop" else Automatic(self.tolerance)


class OutputTable(Table):
    """Directory of the results, and whether to write a picture and the report."""

    directory: FileName = "results"
    picture: bool = True
    report: bool = False
