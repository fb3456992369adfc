"""Input data in the files of a run as the case defines them: law, coefficients, materials, supports, loads,
foundations.

Computed from the tables of case.json and the mesh to which they refer, on one rank, without the surface, the frames and
the matrices that the solver uses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from pydantic import ValidationError

from ...arrays import FloatArray
from ...case.case import Case
from ...case.files import named_files
from ...case.values import FieldTable
from ...fem import compat
from ...fem.bodies import TEMPERATURE, Bolt, Deformable, LoadedBody, Loading, Member, NodalForces, rigid_modes
from ...fem.contact import ContactPoints, free_lengths, plane_of_face
from ...fem.geometry import RigidFoundation, RigidMotion, moved
from ...fem.meshes import SEPARATOR
from ...linalg.reductions import Reductions
from ...model.problem import ContactProblem
from ...model.resultants import ForceBalance, force_balance
from ..case_record import lasting_part, written_case
from ..result_grids import GROUND
from ..run_bodies import WrittenBody, midpoints, midpoints_of_facets, places
from ..run_directory import CASE, CONTACT, SOLUTION, SUMMARY, RunDirectory
from ..run_files import WrittenRun
from ..summary import material_entries
from .comparison import Comparison

_SOURCE = "the case"

_UNFIT = "has another mesh than the case"

_PROJECTOR: Final = 1e-12
"""Accepted difference of the entries of projectors: normals of faces are sums that are rounded."""

Perturbed = Callable[..., FloatArray]
"""Replaces numbers by perturbed ones; besides perhaps the largest number of their kind."""


class CaseReference:
    """The input data that a run of a case must have written.

    Attributes:
        settings: The case.
        contacts: Its contact faces.
        absent: Files that are no longer there: then the body and what acts on it cannot be compared.
        absent_gaps: Files with given gaps that are no longer there.
    """

    def __init__(self, settings: Case):
        self.settings = settings
        self.contacts = [table.contact() for table in settings.contacts.values()]
        named = named_files(settings.model_dump(mode="json"))
        lost = {place: name for place, name in named.items() if not Path(name).exists()}
        self.absent = [name for place, name in lost.items() if place[0] != "contact"]
        self.absent_gaps = [name for place, name in lost.items() if place[0] == "contact"]
        self._foundations: dict[int, RigidFoundation] = {}

    @staticmethod
    def of(folder: Path) -> CaseReference | None:
        """Reference of a directory with case.json; None without one, as after a run from Python."""
        return CaseReference(written_case(folder)) if RunDirectory(folder).case.exists() else None

    @cached_property
    def bodies(self) -> dict[str, LoadedBody]:
        """The bodies of the case by name; "" for the only one."""
        return self.settings.loaded_bodies(MPI.COMM_SELF)

    @cached_property
    def members(self) -> list[Member]:
        """The bodies one after the other, as those of a `Deformable`."""
        bodies: dict[str, Any] = dict(self.bodies)
        ends = np.cumsum([0, *(len(body.x) for body in bodies.values())])
        return [Member(name, body, slice(*ends[k : k + 2])) for k, (name, body) in enumerate(bodies.items())]

    @property
    def tied(self) -> bool:
        """Whether it has ties or rigid faces."""
        return bool(self.settings.ties or self.settings.rigid_face)

    @cached_property
    def tied_body(self) -> Deformable:
        """All bodies with their ties and rigid faces, on the meshes of the case."""
        return self.problem.elasticity

    def nodes_of_tied_body(self, run: WrittenRun) -> npt.NDArray[np.int64]:
        """As `nodes_of`, of the tied body."""
        return run.body.numbers_in([member.body for member in self.tied_body.members], f"{run.folder}: {_UNFIT}")

    @cached_property
    def problem(self) -> ContactProblem:
        """The problem of the case, posed anew on one rank."""
        return self.settings.problem(MPI.COMM_SELF)

    def accepts(self, summary: Mapping[str, Any]) -> bool:
        """Whether the case accepts answers outside the theory of small strains; of a load step also the case that it
        was computed from, if that is recorded: the setting may change between steps."""
        before: Any = summary.get("step", {}).get("case", {}).get("tables", {"small_strain": "warn"})
        return bool(self.settings.small_strain == "warn" == before.get("small_strain"))

    def free_lengths(self, run: WrittenRun, weights: scipy.sparse.csr_matrix, n: FloatArray, time: float) -> FloatArray:
        """`free_lengths` along unit normals n (m, 3) of points that are averages of a run's nodes by weights (m, k),
        with the ties of the case; shape (m,)."""
        body, node = self.tied_body.at_time(time), self.nodes_of_tied_body(run)
        of_case = scipy.sparse.csr_matrix((weights.data, node[weights.indices], weights.indptr), weights.shape)
        points = ContactPoints(body, np.zeros(len(n), dtype=np.int32), np.zeros(len(n)), of_case, False)
        return free_lengths(points, n, body)

    def orient(self, run: WrittenRun) -> None:
        """Take the slave of every pair to be the face that has the contact points in the files."""
        slave, master = dict(enumerate(run.face_names)), {one.contact: one.against for one in run.opposite}
        for number, contact in enumerate(self.contacts):
            exchanged = (slave.get(number), master.get(number)) == (contact.against, contact.face)
            if contact.against is not None and exchanged:
                self.contacts[number] = contact.exchanged()

    def rigid_motions(self, time: float) -> list[RigidMotion]:
        """Of the foundations of the faces at a time."""
        return [contact.rigid_motion(time, "contact") for contact in self.contacts]

    def foundation(
        self, part: int, time: float, x: FloatArray, area: FloatArray, outward: FloatArray
    ) -> RigidFoundation:
        """Foundation of a face at a time; by default the plane of the face, by all its nodes x (k, 3), their areas (k,)
        and the integrals of the normal over the face there, m^2, shape (k, 3)."""
        if part not in self._foundations:
            contact = self.contacts[part]
            given = contact.foundation or plane_of_face(contact.face, x, area, outward, MPI.COMM_SELF)
            self._foundations[part] = given
        return moved(self._foundations[part], self.rigid_motions(time)[part])

    def distance_given(self, part: int, x: FloatArray) -> FloatArray:
        """Distance of points x (k, 3) to the foundation of a face where it was given, metres, shape (k,); after
        `foundation`."""
        return self._foundations[part].signed_distance(x)

    def foundations(self, time: float | None) -> list[RigidFoundation | None]:
        """Foundations of all faces for which `foundation` was called, moved to a time, or before any motion; None for
        pairs."""
        found = self._foundations
        if time is None:
            return [found.get(k) for k in range(len(self.contacts))]
        motions = self.rigid_motions(time)
        paired = [k for k, contact in enumerate(self.contacts) if contact.against is not None]
        return [moved(found[k], motions[k]) if k in found else None for k in sorted({*found, *paired})]

    def given_gap(self, part: int, time: float, x: FloatArray) -> FloatArray:
        """The gap given with a contact at a time, metres, at nodes x (k, 3) of its face, shape (k,)."""
        contact = self.contacts[part]
        return contact.gap_factor(time, MPI.COMM_SELF) * contact.gap_at(x, MPI.COMM_SELF)

    def lacks_gap(self, part: int) -> bool:
        """Whether the gap of a contact is in a file that is no longer there."""
        gap = list(self.settings.contacts.values())[part].gap
        return isinstance(gap, FieldTable) and gap.file in self.absent_gaps

    def compare_record(self, run: WrittenRun, found: Comparison) -> None:
        """Compare the case from which a load step was computed, if it is recorded, but for what may change between
        steps."""
        record = run.summary.get("step", {}).get("case")
        if record is None:
            return
        what = f"{SUMMARY}.step.case"
        try:
            written, _ = lasting_part(Case.model_validate(record["tables"]))
        except ValidationError:
            found.fault(f"{what}.tables: is no case")
            return
        tables, digests = self._lasting
        found.tree(f"{what}.tables", written, tables, source=CASE)
        found.tree(f"{what}.files", record["files"], digests, source=f"the files of {CASE}")

    @cached_property
    def _lasting(self) -> tuple[dict[str, Any], dict[str, str]]:
        return lasting_part(self.settings)

    def compare_numbers(self, run: WrittenRun, found: Comparison) -> None:
        """Compare the input data in summary.json: names of faces, materials."""
        expected: dict[str, Any] = {
            "totals": {"faces": [contact.face for contact in self.contacts]},
            "material": material_entries(self.settings.materials()),
        }
        if self.settings.temperature is not None:
            expected["reference_temperature"] = self.settings.temperature.reference
        if self.settings.heat:
            expected["reference_temperature"] = self.settings.reference_temperature
        found.tree(SUMMARY, run.summary, expected, source=_SOURCE)

    def compare_bodies(self, run: WrittenRun, time: float, found: Comparison) -> npt.NDArray[np.int64] | None:
        """Compare meshes, materials, clamps, springs, loads and contact faces.

        Returns:
            Number of the contact face of each of the run's facets; None if a mesh differs.
        """
        try:
            bodies = self.bodies
            loadings = {name: body.at(time) for name, body in bodies.items()}
        except ValueError as error:
            found.fault(f"case.json: {error}")
            return None
        if list(bodies) != [part.name for part in run.body.parts]:
            names = ", ".join(repr(part.name) for part in run.body.parts)
            found.fault(f"{SOLUTION}: has the bodies {names}, but the case has {', '.join(map(repr, bodies))}")
            return None
        if not all([self._same_body(run, part, loadings[part.name], found) for part in run.body.parts]):
            return None
        if self.tied:
            self._same_springs(run, found)
        return self._faces_of_facets(run, found)

    def _same_springs(self, run: WrittenRun, found: Comparison) -> None:
        """Compare the forces of springs, those of rigid faces included."""
        node, modes = self.nodes_of_tied_body(run), rigid_modes(run.body.x, MPI.COMM_SELF)
        order, body, nothing = np.argsort(node), self.tied_body, np.zeros_like(run.body.x)
        expected = {"spring_force": body.spring_force(run.on_body["displacement"][order])}
        expected |= {name: -body.spring_force(modes[order, :, k]) for k, name in enumerate(GROUND)}
        for name, values in expected.items():
            found.field(f"{SOLUTION}: {name}", run.on_body.get(name, nothing), values[node], run.body.x, _SOURCE)

    def _same_body(self, run: WrittenRun, part: WrittenBody, loading: Loading, found: Comparison) -> bool:
        """Compare one of the bodies; whether the mesh is that of the case."""
        body, x = self.bodies[part.name], part.body.x
        of = f" of {part.name}" if part.name else ""
        node, middle = part.nodes_in(body), midpoints(part.body.domain)
        cell = places(midpoints(body.domain), middle)
        if len(body.x) != len(node) or np.any(node < 0) or len(np.unique(cell)) != len(cell) or np.any(cell < 0):
            found.fault(f"{SOLUTION}: its mesh{of} is not the one that the case describes")
            return False
        on_body = {name: values[part.nodes] for name, values in run.on_body.items()}
        u, modes = np.empty_like(x), np.empty((*x.shape, 6))
        u[node], modes[node] = on_body["displacement"], rigid_modes(run.body.x, MPI.COMM_SELF)[part.nodes]
        if self.settings.heat:  # the temperature is judged by itself (`heat_of_case`)
            change = np.zeros(len(x))
            change[node] = on_body.get(TEMPERATURE, np.zeros(len(x)))
            loading = body.heated(loading, change)
        expected = {"prescribed": loading.prescribed, "load": loading.load}
        if not self.tied:
            expected["spring_force"] = body.spring_force(u)
            expected |= {name: -body.spring_force(modes[:, :, k]) for k, name in enumerate(GROUND)}
        if loading.temperature is not None:
            expected[TEMPERATURE] = loading.temperature.change
        elif np.any(on_body.get(TEMPERATURE, np.zeros(1))) or (TEMPERATURE in on_body and not part.name):
            found.fault(f"{SOLUTION}: has a {TEMPERATURE}{of}, but the case has no temperature")
        for name, values in (body.held.fields | expected).items():
            floor = _PROJECTOR if name in body.held.fields else 0.0
            written = on_body.get(name, np.zeros_like(values))
            found.field(f"{SOLUTION}: {name}{of}", written, values[node], x, _SOURCE, floor=floor)
        if part.elastic is None:
            found.fault("case.json: has materials, but these are results of a body of the user's own forms")
            return True
        constants = part.elastic.constants
        for name in sorted(constants.keys() ^ body.constants.keys()):
            found.fault(f"{SOLUTION}: {'lacks' if name in body.constants else 'has'} {name}, unlike the case")
        for name in constants.keys() & body.constants.keys():
            function, written = body.constants[name], part.on_cells[name]
            rows = function.x.array.reshape(-1, *written.shape[1:])[compat.cell_dofs(function.function_space)[:, 0]]
            found.field(f"{SOLUTION}: {name}", written, rows[cell], middle, _SOURCE)
        return True

    def _faces_of_facets(self, run: WrittenRun, found: Comparison) -> npt.NDArray[np.int64] | None:
        """Number of the contact face of each of the run's facets; None if they are others than those of the case.
        Compared by their midpoints; several faces of one body have one grid unless each has its own."""
        opposite = {one.contact: one.face for one in run.opposite}
        slaves = [(k, contact.face) for k, contact in enumerate(self.contacts)]
        masters = [(k, contact.against) for k, contact in enumerate(self.contacts) if contact.against is not None]
        sides: list[tuple[list[tuple[int, str]], Any]]
        if run.faces[0].name:
            sides = [([side], run.faces[side[0]] if side[0] < len(run.faces) else None) for side in slaves]
            sides += [([side], opposite.get(side[0])) for side in masters]
        else:
            sides = [([*slaves, *masters], run.faces[0])]
        parts = []
        for of_case, grid in sides:
            middles = [self._midpoints(name) for _, name in of_case]
            written = np.empty((0, 6)) if grid is None else midpoints_of_facets(grid.part.body, grid.number)
            there = places(np.concatenate(middles), written)
            expected = sum(map(len, middles))
            if np.any(there < 0) or len(written) != expected or len(np.unique(there)) != expected:
                names = ", ".join(repr(name) for _, name in of_case)
                found.fault(
                    f"{CONTACT}: has {len(written)} facets, of which {np.count_nonzero(there >= 0)} are on {names}; "
                    f"the case has {expected} facets there"
                )
                return None
            numbers = [number for number, _ in of_case]
            parts.append(np.repeat(numbers, list(map(len, middles)))[there].astype(np.int64))
        if run.faces[0].name and (len(run.faces) != len(slaves) or len(opposite) != len(masters)):
            found.fault(f"{CONTACT}: has {len(run.faces)} contact faces, but the case has {len(slaves)}")
            return None
        return np.concatenate(parts[: len(run.faces)])

    def _midpoints(self, name: str) -> FloatArray:
        """Those of the facets of a face."""
        body_name, _, own = ("", "", name) if "" in self.bodies else name.partition(SEPARATOR)
        body = self.bodies[body_name]
        return midpoints_of_facets(body, body.mesh.facets(own, "contact"))

    def nodes_of(self, run: WrittenRun) -> npt.NDArray[np.int64]:
        """The number of every node of a run among those of the case, shape (k,); ValueError if the mesh differs."""
        return run.body.numbers_in([member.body for member in self.members], f"{run.folder}: {_UNFIT}")


class CaseForces:
    """Loads at a time and supports of a case, each by itself, at the nodes in the files of a run."""

    def __init__(self, case: CaseReference, time: float, run: WrittenRun):
        self._members, self._node, self._run = case.members, case.nodes_of(run), run
        self._tied = (case.tied_body, case.nodes_of_tied_body(run)) if case.tied else None
        self._loads = {name: list(body.loads_at(time)) for name, body in case.bodies.items()}
        if case.settings.heat and TEMPERATURE in run.on_body:
            change = np.zeros(len(self._node))
            change[self._node] = run.on_body[TEMPERATURE]
            for member in self._members:
                body = case.bodies[member.name]
                loading = body.heated(body.at(time), change[member.nodes])
                self._loads[member.name] = list(body.loads_in(loading))

    def force_balance(
        self,
        u: FloatArray,
        held: FloatArray,
        on_body: FloatArray,
        taken: Perturbed,
        of_ties: FloatArray,
        ties: Iterable[NodalForces],
        motions: Iterable[tuple[str, FloatArray, FloatArray]],
        bolts: Iterable[Bolt],
    ) -> ForceBalance:
        """Resultants and balance with displacements u, forces of the supports along held directions, contact forces and
        forces of ties on the body at the run's nodes, shapes (k, 3), and of every tie on its slave nodes."""
        order = np.argsort(self._node)  # of the run's nodes in the order of the case

        def parts(of: Callable[[Member], Iterable[NodalForces]]) -> Iterator[NodalForces]:
            for member in self._members:
                for part in of(member):
                    forces = np.zeros_like(u)
                    forces[member.nodes] = part.forces
                    yield NodalForces(part.kind, member.called(part.face), taken(forces[self._node]))

        loads = parts(lambda member: self._loads[member.name])
        shares = parts(lambda member: member.body.shares(held[order][member.nodes]))
        springs = parts(lambda member: member.body.spring_forces(u[order][member.nodes]))
        if self._tied is not None:
            body, node = self._tied
            given = body.spring_forces(u[np.argsort(node)])
            springs = (replace(one, forces=taken(one.forces[node])) for one in given)
        x, over, slices = taken(self._run.body.x), Reductions(MPI.COMM_SELF), self._run.body.slices
        return force_balance(loads, chain(shares, springs), on_body, x, over, (), slices, ties, of_ties, motions, bolts)


@dataclass(frozen=True)
class TiesFound:
    """What ties do at the nodes in the files of a run: their forces and the jump of the displacement, shapes (k, 3),
    their stresses by name, shapes (k,), the forces of each on its slave nodes, the motions of rigid faces, and the
    bolts."""

    forces: FloatArray
    jump: FloatArray
    stresses: dict[str, FloatArray]
    shares: tuple[NodalForces, ...]
    motions: tuple[tuple[str, FloatArray, FloatArray], ...]
    bolts: tuple[Bolt, ...]


class CaseTies:
    """The ties of a case, computed anew on the meshes of the case, at the nodes in the files of a run."""

    def __init__(self, case: CaseReference, time: float, run: WrittenRun):
        self._body, self._node, self._time = case.tied_body.at_time(time), case.nodes_of_tied_body(run), time

    def found(self, u: FloatArray, imbalance: FloatArray) -> TiesFound:
        """By displacements and the internal forces less all forces but those of ties, shapes (k, 3)."""
        order, node, body = np.argsort(self._node), self._node, self._body
        left, time = imbalance[order], self._time
        return TiesFound(
            body.forces_of_ties(left, time)[node],
            body.jump(u[order], body.after(time, u[order]))[node],
            {name: values[node] for name, values in body.stresses_of_ties(left, time).items()},
            tuple(NodalForces(one.kind, one.face, one.forces[node]) for one in body.shares_of_ties(left, time)),
            tuple(body.motions_of_faces(u[order], time)),
            tuple(body.bolts(u[order])),
        )
