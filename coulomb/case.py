"""A TOML case file: read, checked, and turned into a problem."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from mpi4py import MPI
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from .arrays import FloatArray
from .fem.body import Material
from .fem.elasticity import Clamp, Traction
from .fem.fields import Coefficient
from .fem.meshes import BOX_FACES, box
from .fem.obstacles import Plane
from .problem import Contact, ContactProblem
from .solvers.automatic import Automatic
from .solvers.condensed import CondensedConeSystem, CondensedSystem
from .solvers.cone_systems import DenseConeSystem
from .solvers.coulomb import CoulombSolver
from .solvers.dense_system import DenseSystem
from .solvers.fixed_point import SuccessiveTresca
from .solvers.newton_systems import AugmentedSystem, NewtonSystem, RecyclingSystem, SchurComplementSystem
from .solvers.one_loop import OneLoop
from .solvers.path_following import PathFollowing
from .solvers.stiffness import DirectSolver, IterativeSolver
from .solvers.tresca import QPSolver

Face = Literal["left", "right", "front", "back", "bottom", "top"]
Number = Annotated[float, Field(allow_inf_nan=False, strict=True)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False, strict=True)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False, strict=True)]
Vector = tuple[Number, Number, Number]
Count = Annotated[int, Field(ge=1, strict=True)]

assert set(BOX_FACES) == set(Face.__args__)  # type: ignore[attr-defined]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MeshTable(_Table):
    """A box, lengths in metres."""

    box: tuple[Positive, Positive, Positive]
    cells: tuple[Count, Count, Count]
    cell: Literal["hexahedron", "tetrahedron"] = "hexahedron"


class MaterialTable(_Table):
    """Young's modulus in pascals, Poisson's ratio."""

    young: Positive
    poisson: Annotated[float, Field(gt=-1.0, lt=0.5, strict=True)]


_NEWTON: dict[str, type[NewtonSystem]] = {
    "recycling": RecyclingSystem,
    "augmented": AugmentedSystem,
    "schur": SchurComplementSystem,
    "dense": DenseSystem,
    "condensed": CondensedSystem,
}


class ClampTable(_Table):
    """Prescribed displacement in metres on a face."""

    face: Face
    components: Literal["x", "y", "z", "xy", "xz", "yz", "xyz"] = "xyz"
    value: Vector = (0.0, 0.0, 0.0)


class TractionTable(_Table):
    """Surface load in pascals on a face."""

    face: Face
    value: Vector


class FoundationTable(_Table):
    """A rigid plane: a point of it in metres, and its normal towards the body."""

    point: Vector
    normal: Vector


class RegionTable(_Table):
    """A part of the contact face, inside a box given by two corners in metres, that rubs differently."""

    box: tuple[Vector, Vector]
    friction: NotNegative | None = None
    slip_stress: NotNegative | None = None

    @model_validator(mode="after")
    def _corners(self) -> RegionTable:
        if any(low > high for low, high in zip(*self.box, strict=True)):
            raise ValueError(f"box must be [least corner, greatest corner], but is {[list(c) for c in self.box]}")
        return self

    def holds(self, x: FloatArray) -> Any:
        """Which of the points x (3, k) lie in it, to 1e-9 of its size; shape (k,)."""
        low, high = np.array(self.box)[:, :, None]
        margin = 1e-9 * float(np.max(high - low))
        return np.all((x >= low - margin) & (x <= high + margin), axis=0)


class ContactTable(_Table):
    """The contact face, and one of two friction laws: friction (Coulomb) or slip_stress in pascals (Tresca)."""

    face: Face
    friction: NotNegative | None = None
    slip_stress: NotNegative | None = None
    region: tuple[RegionTable, ...] = ()
    foundation: FoundationTable | None = None

    @model_validator(mode="after")
    def _one_law(self) -> ContactTable:
        if (self.friction is None) == (self.slip_stress is None):
            raise ValueError("give either friction (Coulomb) or slip_stress (Tresca), one of the two")
        law = "friction" if self.slip_stress is None else "slip_stress"
        other = "slip_stress" if law == "friction" else "friction"
        for number, region in enumerate(self.region):
            if getattr(region, law) is None or getattr(region, other) is not None:
                raise ValueError(f"region.{number} must give {law}, as the contact does, and nothing else but its box")
        return self

    def coefficient(self, law: Literal["friction", "slip_stress"]) -> Coefficient | None:
        """Of this law: nothing, a number, or a function of place by region; where regions overlap, the last counts."""
        base = getattr(self, law)
        if base is None or not self.region:
            return base  # type: ignore[no-any-return]

        def by_region(x: FloatArray) -> FloatArray:
            values = np.full(x.shape[1], float(base))
            for region in self.region:
                values[region.holds(x)] = getattr(region, law)
            return values

        return by_region


class SolverTable(_Table):
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


class OutputTable(_Table):
    """Where results go, and whether to draw them."""

    directory: str = "results"
    picture: bool = True


class Case(_Table):
    """A whole case file."""

    mesh: MeshTable
    material: MaterialTable
    clamp: tuple[ClampTable, ...] = ()
    traction: tuple[TractionTable, ...] = ()
    body_force: Vector = (0.0, 0.0, 0.0)
    contact: ContactTable
    solver: SolverTable = SolverTable()
    output: OutputTable = OutputTable()

    def problem(self, comm: MPI.Comm = MPI.COMM_WORLD) -> ContactProblem:
        """Mesh and problem of the case.

        Raises:
            ValueError: If the parts do not fit together, on every rank.
        """
        if self.solver.newton == "dense" and comm.size > 1:
            raise ValueError('solver.newton = "dense" works on one rank: run on one, or leave it at "recycling"')
        condensed = self.solver.newton == "condensed"
        foundation = self.contact.foundation
        problem = ContactProblem(
            box(self.mesh.box, self.mesh.cells, self.mesh.cell, comm),
            Material(self.material.young, self.material.poisson),
            [Clamp(table.face, table.components, table.value) for table in self.clamp],
            Contact(
                self.contact.face,
                self.contact.coefficient("friction"),
                self.contact.coefficient("slip_stress"),
                Plane(foundation.point, foundation.normal) if foundation is not None else None,
            ),
            [Traction(table.face, table.value) for table in self.traction],
            self.body_force,
            linear_solver={
                "auto": IterativeSolver if condensed else None,
                "direct": DirectSolver,
                "iterative": IterativeSolver,
            }[self.solver.linear_solver],
            explicit={"auto": False if condensed else None, "explicit": True, "matrix-free": False}[
                self.solver.compliance
            ],
        )
        for number, region in enumerate(self.contact.region):
            if not comm.allreduce(int(np.sum(region.holds(problem.surface.x.T))), op=MPI.SUM):
                raise ValueError(f"contact.region.{number}: there is no contact node in its box {list(region.box)}")
        return problem

    @model_validator(mode="after")
    def _method_fits_the_law(self) -> Case:
        if self.contact.friction is None and self.solver.method != "auto":
            raise ValueError('solver.method is for Coulomb friction; with slip_stress leave it at "auto"')
        return self

    def contact_solver(self) -> CoulombSolver | QPSolver:
        """The solver the case asks for; a Newton system that is the paper's asks for successive Tresca."""
        table = self.solver
        path_following = PathFollowing(tolerance=table.tolerance, newton=_NEWTON[table.newton])
        if self.contact.friction is None:
            return path_following
        if table.method == "fixed-point" or table.newton in ("augmented", "schur"):
            most = SuccessiveTresca.max_iterations if table.max_outer is None else table.max_outer
            return SuccessiveTresca(table.tolerance, path_following, max_iterations=most)
        if table.newton == "dense":
            return OneLoop(table.tolerance, newton=DenseConeSystem)
        if table.newton == "condensed":
            return OneLoop(table.tolerance, newton=CondensedConeSystem)
        return OneLoop(table.tolerance) if table.method == "one-loop" else Automatic(table.tolerance)


def read_case(path: str | Path, changes: Sequence[str] = (), comm: MPI.Comm = MPI.COMM_WORLD) -> Case:
    """Read a case file; rank 0 reads, all ranks get the same case or the same error.

    Args:
        path: The TOML file.
        changes: Settings "key.key=value" that replace or add to those of the file, values in TOML.
        comm: The ranks.

    Raises:
        ValueError: If the file cannot be read, is no TOML, or does not describe a case: key, value, what is allowed.
    """
    text, fault = "", ""
    if comm.rank == 0:
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            fault = f"{path}: cannot be read: {reason}"
    text, fault = comm.bcast((text, fault))
    if fault:
        raise ValueError(fault)
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: is not TOML: {error}") from None
    for change in changes:
        _apply(tables, change)
    try:
        return Case.model_validate(tables)
    except ValidationError as error:
        raise ValueError("\n".join(f"{path}: {_explain(entry)}" for entry in error.errors())) from None


def _apply(tables: dict[str, Any], change: str) -> None:
    key, equals, value = change.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts):
        raise ValueError(f"--set {change}: must be key.key=value, for example mesh.cells=[18,6,6]")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value.strip()
    place: Any = tables
    try:
        for part in parts[:-1]:
            place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
        if isinstance(place, list):
            place[int(parts[-1])] = parsed
        else:
            place[parts[-1]] = parsed
    except (ValueError, IndexError, TypeError, AttributeError):
        raise ValueError(f"--set {change}: there is no such place in the case; lists count from 0") from None


def _explain(entry: Any) -> str:
    """One fault of pydantic's in the words of the case file: key, value, what is allowed."""
    key = ".".join(str(part) for part in entry["loc"]) or "case"
    if entry["type"] == "extra_forbidden":
        allowed = _keys(entry["loc"][:-1])
        close = difflib.get_close_matches(str(entry["loc"][-1]), allowed, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        return f"{key} = {entry['input']!r}: there is no such key{hint} (known here: {', '.join(allowed)})"
    if entry["type"] == "missing":
        return f"{key}: is missing"
    message = str(entry["msg"]).removeprefix("Value error, ").removeprefix("Input ").replace("Input", "it")
    return f"{key} = {entry['input']!r}: {message}"


def _keys(location: tuple[int | str, ...]) -> list[str]:
    """The keys known at a place of the case."""
    model: type[BaseModel] = Case
    for part in location:
        if isinstance(part, int):
            continue
        annotation: Any = model.model_fields[part].annotation
        candidates = [annotation, *getattr(annotation, "__args__", ())]
        model = next(c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel))
    return list(model.model_fields)
