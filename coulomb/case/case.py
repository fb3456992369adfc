"""A case file: read, validated, and converted to a problem."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

import coulomb

from ..model.times import refuse_missed
from ..ranks import launched, on_rank_0
from ..units import use
from .bodies import BodyTable, MeshTable, fault_of_body, fault_of_face
from .contact import AutoContactTable, ContactTable, ContactTables
from .curves import (
    AmplitudeTable,
    FactorCurveTable,
    Factors,
    MotionCurveTable,
    Translations,
    amplitude_of,
    columns_of,
    in_one_history,
    read_curves,
    refuse_ended,
)
from .decks import is_deck, read_deck
from .error_messages import fault_of, tables_of_several
from .files import LARGEST, RECORDED, apply, named_files, parsed, read_text, recorded, rename_files
from .loads import (
    ClampTable,
    HeatTable,
    LastingTable,
    LoadTable,
    NodalForceTable,
    PlacedTable,
    PointLoadTable,
    PrescribedDisplacementTable,
    PrescribedRotationTable,
    PressureTable,
    SpringTable,
    SupportTable,
    SymmetryTable,
    TotalForceTable,
    TractionTable,
    VolumeForceTable,
    refuse_unfit_heat,
    with_nodes,
)
from .material import MaterialTable, MaterialTables, TemperatureTable, materials_of, refuse_groups, tables_of
from .solver import HistoryTable, OutputTable, ProbeTable, SolverTable, UnitsTable
from .ties import CyclicSymmetryTable, EquationTable, FacePairTable, PretensionTable, RigidFaceTable, TieTable
from .tolerances import refuse_others
from .values import TABLES, Number, SpatialVector, Table, Vector, field

if TYPE_CHECKING:  # modules that need DOLFINx or PETSc are loaded after validation
    from mpi4py import MPI

    from ..decks.tables import Translation
    from ..fem.bodies import AnyMaterial, Load, Support, Temperatures, ThermalLoad
    from ..fem.contact import FoundPair, FoundPairs
    from ..fem.meshes import JoinedMesh
    from ..solvers.friction_problem import Solver


class Case(Table):
    """A whole case file."""

    body: Annotated[tuple[BodyTable, ...], Field(max_length=TABLES)] = ()
    mesh: MeshTable | None = Field(default=None, validate_default=True)
    material: MaterialTables | None = Field(default=None, validate_default=True)
    temperature: TemperatureTable | None = None
    heat: Annotated[tuple[HeatTable, ...], Field(max_length=TABLES)] = ()
    reference_temperature: Number | None = None
    clamp: Annotated[tuple[ClampTable, ...], Field(max_length=TABLES)] = ()
    prescribed_displacement: Annotated[tuple[PrescribedDisplacementTable, ...], Field(max_length=TABLES)] = ()
    prescribed_rotation: Annotated[tuple[PrescribedRotationTable, ...], Field(max_length=TABLES)] = ()
    symmetry: Annotated[tuple[SymmetryTable, ...], Field(max_length=TABLES)] = ()
    traction: Annotated[tuple[TractionTable, ...], Field(max_length=TABLES)] = ()
    pressure: Annotated[tuple[PressureTable, ...], Field(max_length=TABLES)] = ()
    total_force: Annotated[tuple[TotalForceTable, ...], Field(max_length=TABLES)] = ()
    point_load: Annotated[tuple[PointLoadTable, ...], Field(max_length=TABLES)] = ()
    nodal_force: Annotated[tuple[NodalForceTable, ...], Field(max_length=TABLES)] = ()
    volume_force: Annotated[tuple[VolumeForceTable, ...], Field(max_length=TABLES)] = ()
    body_force: SpatialVector = (0.0, 0.0, 0.0)
    body_force_amplitude: AmplitudeTable | None = None
    gravity: Vector = (0.0, 0.0, 0.0)
    gravity_amplitude: AmplitudeTable | None = None
    small_strain: Literal["enforce", "warn"] = "enforce"
    spring: Annotated[tuple[SpringTable, ...], Field(max_length=TABLES)] = ()
    auto_contact: AutoContactTable | None = None
    contact: ContactTables | None = Field(default=None, validate_default=True)
    rigid_face: Annotated[tuple[RigidFaceTable, ...], Field(max_length=TABLES)] = ()
    tie: Annotated[tuple[TieTable, ...], Field(max_length=TABLES)] = ()
    cyclic_symmetry: Annotated[tuple[CyclicSymmetryTable, ...], Field(max_length=TABLES)] = ()
    pretension: Annotated[tuple[PretensionTable, ...], Field(max_length=TABLES)] = ()
    equation: Annotated[tuple[EquationTable, ...], Field(max_length=TABLES)] = ()
    probe: Annotated[tuple[ProbeTable, ...], Field(max_length=TABLES)] = ()
    history: HistoryTable | None = None
    units: UnitsTable = UnitsTable()
    solver: SolverTable = SolverTable()
    output: OutputTable = OutputTable()

    _found: FoundPairs | None = PrivateAttr(None)
    _deck: Translation | None = PrivateAttr(None)

    @property
    def deck(self) -> Translation | None:
        """What has become of the cards of the input file that the case was read from; None of another."""
        return self._deck

    def resolved(self, comm: MPI.Comm) -> Case:
        """The same case, in which the pairs that auto_contact finds are among the contacts, after those that are given;
        without pairs that are given or tied; collective.

        Raises:
            ValueError: On every rank, if the mesh cannot be read, or there is no pair.
        """
        if self.auto_contact is None or self._found is not None:
            return self
        found = self.auto_contact.pairs_on(self._given_mesh(comm))
        given = list(self.contacts.values())
        known = [{table.face, table.against} for table in given] + [
            {tie.face, tie.against} for tie in self.ties.values()
        ]
        more = [one for one in self.auto_contact.tables(found.pairs) if {one.face, one.against} not in known]
        if not given and not more:
            raise ValueError("auto_contact: all pairs found are left out or tied, and there is no [contact]")
        case = self.model_copy(update={"contact": (*given, *more)})
        case._found = found
        return case

    @property
    def found(self) -> list[tuple[ContactTable, FoundPair]]:
        """The contacts of a case that is `resolved` that are of a pair found, with what was found."""
        pairs = () if self._found is None else self._found.pairs
        by_faces = {frozenset((pair.face, pair.against)): pair for pair in pairs}
        keyed = [
            (table, by_faces.get(frozenset((table.face, table.against or "")))) for table in self.contacts.values()
        ]
        return [(table, pair) for table, pair in keyed if pair is not None]

    def poisson(self, body: str) -> float:
        """`largest_poisson` of a body, by its name; 0 where tables name nodes, since these are those of the file, whose
        order is kept."""
        from ..fem.bodies import largest_poisson

        heated = self.temperature is not None and bool(self.temperature.at)
        if heated or self.equation or any(map(_at_nodes, self._on_faces.values())):
            return 0.0
        return largest_poisson({str(k): table.material() for k, table in enumerate(self.material_tables[body])})

    @property
    def made_faces(self) -> tuple[str, ...]:
        """Names of the faces that auto_contact has made, of a case that is `resolved`."""
        return () if self._found is None else self._found.made

    def problem(self, comm: MPI.Comm | None = None) -> coulomb.ContactProblem:
        """Mesh and problem on these ranks, by default all; ValueError on every rank, if the parts are inconsistent."""
        from mpi4py import MPI

        from ..linalg.compliance import DirectSolver, IterativeSolver

        comm = comm or MPI.COMM_WORLD
        if self.auto_contact is not None and self._found is None:
            return self.resolved(comm).problem(comm)
        if self.solver.newton == "dense" and comm.size > 1:
            raise ValueError('solver.newton = "dense" works on one rank: run on one, or leave it at "recycling"')
        condensed = self.solver.newton == "condensed"
        clamps, loads, springs = self._supports_and_loads
        thermal = self._thermal
        problem = coulomb.ContactProblem(
            self._mesh(comm),
            self.materials(),
            clamps,
            [table.contact() for table in self.contacts.values()],
            loads,
            field(self.body_force),
            springs,
            body_force_amplitude=amplitude_of(self.body_force_amplitude),
            gravity=self._gravity,
            gravity_amplitude=amplitude_of(self.gravity_amplitude),
            temperature=None if self.heat else self._of_body(thermal),
            reference_temperature=0.0 if thermal is None else thermal.reference,
            temperature_amplitude=1.0 if thermal is None else thermal.amplitude,
            heat=[table.load() for table in self.heat],
            linear_solver={
                "auto": IterativeSolver if condensed else None,
                "direct": DirectSolver,
                "iterative": IterativeSolver,
            }[self.solver.linear_solver],
            explicit={"auto": False if condensed else None, "explicit": True, "matrix-free": False}[
                self.solver.compliance
            ],
            small_strain=self.small_strain,
            probes=[table.probe() for table in self.probe],
            kinematics=self.solver.kinematics,
            branch=self.solver.branch,
            rigid_faces=[table.rigid_face() for table in self.rigid_face],
            ties=[*(table.tie() for table in self.ties.values()), *(one.equation() for one in self.equation)],
        )
        problem.body.chosen += tuple(table.raised for table in self.meshes.values() if table.raised)
        if self.history is not None:
            problem.body.stiffness.expect_load_steps(len(self.history.ends))
        if condensed and problem.rigid is not None:
            raise ValueError(
                'solver.newton = "condensed" needs bodies that supports hold: leave it at "recycling", or add a clamp'
            )
        regions = {f"{key}.region.{k}": region for key, t in self.contacts.items() for k, region in enumerate(t.region)}
        for key, region in regions.items():
            if not comm.allreduce(int(np.sum(region.holds(problem.surface.x.T)))):
                raise ValueError(f"{key}: there is no contact node in its box {list(region.box)}")
        return problem

    def _mesh(self, comm: MPI.Comm) -> coulomb.NamedMesh | JoinedMesh:
        """With the faces that auto_contact makes."""
        if self.auto_contact is None:
            return self._given_mesh(comm)
        found = self._found
        if found is None or found.mesh.comm.size != comm.size:
            found = self.auto_contact.pairs_on(self._given_mesh(comm))
        return found.mesh

    def _given_mesh(self, comm: MPI.Comm) -> coulomb.NamedMesh | JoinedMesh:
        from ..fem.meshes import JoinedMesh

        meshes = {name: table.mesh(comm, self.poisson(name)) for name, table in self.meshes.items()}
        mesh = JoinedMesh(meshes) if self.mesh is None else meshes[""]
        return with_nodes(mesh, [table for table in self._on_faces.values() if isinstance(table, PlacedTable)])

    @property
    def meshes(self) -> dict[str, MeshTable]:
        """The table of the mesh of each body, by the body's name; "" for a body that is alone."""
        return {table.name: table for table in self.body} if self.mesh is None else {"": self.mesh}

    @property
    def _gravity(self) -> Vector | dict[str, Vector]:
        """Of all bodies, or of each by its name if one has its own."""
        if all(table.gravity is None for table in self.body):
            return self.gravity
        return {table.name: self.gravity if table.gravity is None else table.gravity for table in self.body}

    @property
    def _thermal(self) -> ThermalLoad | None:
        if self.heat:
            from ..fem.bodies import ThermalLoad

            reference = self.reference_temperature or 0.0
            return ThermalLoad(reference, reference)  # no change, before conduction gives one
        return None if self.temperature is None else self.temperature.thermal()

    def _of_body(self, thermal: ThermalLoad | None) -> Temperatures | dict[str, Temperatures] | None:
        """Its temperature, of all bodies or of each."""
        if thermal is None or self.temperature is None:
            return None if thermal is None else thermal.temperature
        return self.temperature.of_bodies(thermal.temperature, [one.name for one in self.body])

    @property
    def _supports_and_loads(self) -> tuple[list[Support], list[Load], list[coulomb.Spring]]:
        tables = self._on_faces.values()
        supports: list[Support] = [t.support() for t in tables if isinstance(t, SupportTable)]
        return supports, [t.load() for t in tables if isinstance(t, LoadTable)], [t.spring() for t in self.spring]

    @property
    def _on_faces(self) -> dict[str, SupportTable | SpringTable | LoadTable]:
        """The tables of supports, loads and springs, by their key in the case."""
        supports = ("clamp", "prescribed_displacement", "prescribed_rotation", "symmetry")
        loads = ("traction", "pressure", "total_force", "point_load", "nodal_force", "volume_force", "spring")
        return {f"{kind}.{k}": table for kind in supports + loads for k, table in enumerate(getattr(self, kind))}

    @property
    def ties(self) -> dict[str, FacePairTable]:
        """Sections of bolts, ties and cyclic symmetries, by their key in the case."""
        kinds = ("pretension", "tie", "cyclic_symmetry")
        return {f"{kind}.{k}": table for kind in kinds for k, table in enumerate(getattr(self, kind))}

    @property
    def contacts(self) -> dict[str, ContactTable]:
        """The contact faces, by their key in the case; of a case that is `resolved` those found, too."""
        if isinstance(self.contact, ContactTable):
            return {"contact": self.contact}
        return {f"contact.{k}": table for k, table in enumerate(self.contact or ())}

    def materials(self) -> AnyMaterial | dict[str, AnyMaterial]:
        """The material of the whole body, or per group of cells; of several bodies by their names."""
        if self.material is None:
            return {name: material for table in self.body for name, material in table.materials().items()}
        if isinstance(self.material, MaterialTable):
            return self.material.material()
        return materials_of(self.material)

    @property
    def material_tables(self) -> dict[str, Sequence[MaterialTable]]:
        """The tables of the materials of each body, by the body's name; "" for a body that is alone."""
        given = {table.name: table.material for table in self.body} if self.material is None else {"": self.material}
        return {name: [one] if isinstance(one, MaterialTable) else one for name, one in given.items()}

    @property
    def small(self) -> bool:
        return all(mesh.small for mesh in self.meshes.values())

    @field_validator("mesh", "material", mode="after")
    @classmethod
    def _of_one_body_or_of_each(cls, given: Any, info: ValidationInfo) -> Any:
        bodies = info.data.get("body")  # None if these are wrong themselves
        if bodies == () and given is None:
            raise PydanticCustomError("missing", "is missing")
        if bodies and given is not None:
            own = "[body.material]" if info.field_name == "material" else "box or file"
            raise ValueError(f"every [[body]] has its own, {own}; leave out [{info.field_name}]")
        return given

    @field_validator("contact", mode="after")
    @classmethod
    def _given_or_found(cls, given: Any, info: ValidationInfo) -> Any:
        if given is None and info.data.get("auto_contact", True) is None:
            raise PydanticCustomError("missing", "is missing")
        return given

    @model_validator(mode="before")
    @classmethod
    def _large_by_itself(cls, given: Any) -> Any:
        return in_one_history(given) if isinstance(given, dict) else given

    @model_validator(mode="after")
    def _tolerances_of_inputs(self) -> Case:
        refuse_others(self)
        return self

    @model_validator(mode="after")
    def _groups_of_the_mesh(self) -> Case:
        if self.mesh is not None and self.material is not None:
            refuse_groups(self.material, self.mesh.box is not None, "[material]")
        return self

    @model_validator(mode="after")
    def _faces_of_bodies(self) -> Case:
        """Check faces of boxes, and that faces of several bodies name them; those of files when these are read."""
        for name in dict.fromkeys(body.name for body in self.body):
            numbers = [f"body.{k}" for k, body in enumerate(self.body) if body.name == name]
            if len(numbers) > 1:
                raise ValueError(f"{' and '.join(numbers)} have the name {name!r}; give each body its own")
        heated = None if self.temperature is None else self.temperature.body
        if heated is not None and (fault := fault_of_body(heated, self.body)):
            raise ValueError(f"temperature.body = {heated!r}: {fault}")
        named = {key: one for key, one in self._on_faces.items() if not isinstance(one, VolumeForceTable)}
        faces = {f"{key}.face": table.face for key, table in named.items() if not _at_nodes(table)}
        faces |= {f"heat.{k}.face": table.face for k, table in enumerate(self.heat) if table.face is not None}
        for key, table in self.contacts.items():
            faces[f"{key}.face"] = table.face
            if table.against is not None:
                faces[f"{key}.against"] = table.against
        faces |= {f"rigid_face.{k}.face": table.face for k, table in enumerate(self.rigid_face)}
        for key, tie in self.ties.items():
            faces |= {f"{key}.face": tie.face, f"{key}.against": tie.against}
        for key, face in faces.items():
            fault = fault_of_face(face, self.body, self.mesh is not None and self.mesh.box is not None)
            if fault:
                raise ValueError(f"{key} = {face!r}: {fault}")
        return self

    @model_validator(mode="after")
    def _kinematics(self) -> Case:
        """Laws of materials are for large motions, which go by load steps."""
        given = [self.material, *(body.material for body in self.body)]
        laws = [one.law for materials in given for one in tables_of(materials) if one.law is not None]
        if self.solver.kinematics == "small":
            if laws:
                raise ValueError(
                    f'law = {laws[0]!r} of a material is for large motions: set solver.kinematics = "large"'
                )
            return self
        for k, tie in enumerate(self.tie):
            if tie.begin is not None:
                raise ValueError(f'tie.{k}.begin: not with solver.kinematics = "large", where ties may end')
        return self

    @model_validator(mode="after")
    def _heat_fits(self) -> Case:
        thermal = [key for key, table in self.contacts.items() if table.thermal is not None]
        others = {"temperature": self.temperature, "large motions": self.solver.kinematics == "large"}
        unfit = [name for name, given in others.items() if given]
        refuse_unfit_heat(self.heat, self.reference_temperature, thermal, unfit)
        return self

    @model_validator(mode="after")
    def _method_fits_the_law(self) -> Case:
        tresca = all(table.friction is None for table in self.contacts.values()) and self.auto_contact is None
        if tresca and self.solver.method != "auto":
            raise ValueError('solver.method is for Coulomb friction; with slip_stress leave it at "auto"')
        return self

    @model_validator(mode="after")
    def _time_needs_a_history(self) -> Case:
        timed = {key: rows for key, (_, rows) in self.timed.items()}
        if self.history is None:
            for key in timed:
                if not key.endswith("friction_amplitude"):
                    raise ValueError(f"{key} depends on time: it needs a [history]")
            for key in self._limits:
                raise ValueError(f"{key}: load steps end there: it needs a [history]")
        end = self.history.ends[-1] if self.history is not None else 0.0
        if self.history is not None:
            refuse_missed(list(self._limits.values()), 0.0, self.history.ends)
        ends = {f"pretension.{k}.amplitude": one.lock for k, one in enumerate(self.pretension) if one.lock is not None}
        for key, rows in timed.items():
            try:
                refuse_ended(rows, min(end, ends.get(key, end)))
            except ValueError as error:
                raise ValueError(f"{key}: {error}") from None
        return self

    @property
    def _limits(self) -> dict[str, float]:
        """The times at which load steps must end, by their keys in the case."""
        times = {f"pretension.{k}.lock": one.lock for k, one in enumerate(self.pretension)}
        for key, table in {**self._on_faces, **self.ties}.items():
            if isinstance(table, LastingTable):
                times |= {f"{key}.begin": table.begin, f"{key}.end": table.end}
        return {key: time for key, time in times.items() if time is not None}

    @property
    def timed(self) -> dict[str, tuple[Table, Factors | Translations]]:
        """What depends on time, by its key in the case: the table that has it, and its rows."""
        several = ("pretension", "heat", "rigid_face", "equation")
        tables: dict[str, Table | None] = {"": self, "temperature": self.temperature, **self._on_faces, **self.contacts}
        tables |= {f"{kind}.{k}": table for kind in several for k, table in enumerate(getattr(self, kind))}
        tables |= {f"{key}.rotation": table.rotation for key, table in self.contacts.items()}
        by_key: dict[str, tuple[Table, Factors | Translations]] = {}
        for key, table in tables.items():
            for name, rows in table or ():
                if (
                    table is not None
                    and columns_of(name)
                    and isinstance(rows, tuple | FactorCurveTable | MotionCurveTable)
                ):
                    by_key[f"{key}.{name}".removeprefix(".")] = table, rows
        return by_key

    def load_history(self) -> coulomb.LoadHistory:
        assert self.history is not None
        return coulomb.LoadHistory(
            self.history.ends,
            tolerance=self.solver.tolerance,
            solver=self.contact_solver(),
            halvings=self.history.halvings,
            friction_error=self.history.friction_error,
        )

    def contact_solver(self) -> Solver:
        unknown = self.auto_contact is not None and self._found is None
        return self.solver.contact_solver(unknown or any(table.sloped for table in self.contacts.values()))


def _at_nodes(table: Table) -> bool:
    return isinstance(table, PlacedTable) and table.nodes is not None


def read_case(path: str | Path, changes: Sequence[str] = (), deck: Translation | None = None) -> Case:
    """Read a case file; rank 0 reads, all ranks get the same case or the same error.  Its units are those of what this
    process says from then on (`units.use`).

    Args:
        path: The TOML file, the JSON file that a run has written, or an input file of CalculiX or Abaqus (.inp); names
            of mesh files in it are relative to its directory.
        changes: Settings "key.key=value" that replace or add to those of the file, values in TOML.
        deck: What has been made of an input file; by default it is read.

    Raises:
        ValueError: If the file cannot be read, is not TOML, or is not a valid case, with key, value and allowed values.
    """
    written = Path(path).suffix == ".json"
    if is_deck(path):
        deck = deck or read_deck(path)
        deck.refuse(str(path))
        tables = copy.deepcopy(deck.tables)
    else:
        try:
            text = on_rank_0(launched(), lambda: read_text(path, RECORDED if written else LARGEST))
        except OSError as error:
            raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None
        tables = recorded(text, path) if written else parsed(text, path, tables_of_several(Case))
    for change in changes:
        apply(tables, change)
    rename_files(tables, {place: str(Path(path).parent / name) for place, name in named_files(tables).items()})
    read_curves(Path(path), tables, written)
    try:
        case = Case.model_validate(tables)
    except ValidationError as error:
        raise fault_of(error, str(path), Case) from None
    use(case.units.length, case.units.stress)
    case._deck = deck
    return case
