"""Input data in the files of a run as the case defines them: law, coefficients, materials, supports, loads,
foundations.

Computed from the tables of case.json and the mesh to which they refer, on one rank, without the surface, the frames and
the matrices that the solver uses.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from pydantic import ValidationError

from ...arrays import FloatArray
from ...case.case import Case
from ...case.files import named_files
from ...case.values import FieldTable
from ...fem import compat
from ...fem.bodies import TEMPERATURE, LoadedBody, Loading, rigid_modes
from ...fem.contact import plane_of_face, way_along
from ...fem.geometry import RigidFoundation, RigidMotion, moved
from ...fem.meshes import SEPARATOR, corners_of
from ...solvers.laws import FrictionLaw
from ..case_record import lasting_part
from ..field_names import GROUND
from ..matched_points import midpoints, places
from ..run_directory import CASE, SOLUTION, SUMMARY, RunDirectory
from ..run_files import WrittenRun
from ..summary import material_entries
from ..written_bodies import WrittenBody
from ..written_case import written_case
from ..written_faces import midpoints_of_facets
from .comparison import Comparison
from .face_nodes import face_names

_SOURCE = "the case"

_PROJECTOR = 1e-12
"""Accepted difference of the entries of projectors: normals of faces are sums that are rounded."""


class CaseReference:
    """The input data that a run of a case must have written.

    Args:
        settings: The case.

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
        """Reference of a directory with case.json; None without one, as after a run from Python.

        Raises:
            ValueError: If it cannot be read or is not a case.
        """
        return CaseReference(written_case(folder)) if RunDirectory(folder).case.exists() else None

    @cached_property
    def bodies(self) -> dict[str, LoadedBody]:
        """The bodies of the case by name; "" for the only one.

        Raises:
            ValueError: If the parts of the case are inconsistent.
        """
        return self.settings.loaded_bodies(MPI.COMM_SELF)

    def face(self, name: str) -> tuple[LoadedBody, str]:
        """The body of a face, and the name that the face has there."""
        if "" in self.bodies:
            return self.bodies[""], name
        body, _, own = name.partition(SEPARATOR)
        return self.bodies[body], own

    def accepts(self, summary: Mapping[str, Any]) -> bool:
        """Whether the case accepts answers outside the theory of small strains; of a load step also the case that it
        was computed from, if that is recorded: the setting may change between steps."""
        before: Any = summary.get("step", {}).get("case", {}).get("tables", {"small_strain": "warn"})
        return bool(self.settings.small_strain == "warn" == before.get("small_strain"))

    def orient(self, run: WrittenRun) -> None:
        """Take the slave of every pair to be the face that has the contact points in the files."""
        master, slave = {one.contact: one.against for one in run.opposite}, face_names(run)
        for number, contact in enumerate(self.contacts):
            against = contact.against
            if (
                against is not None
                and number < len(slave)
                and (slave[number], master.get(number))
                == (
                    against,
                    contact.face,
                )
            ):
                self.contacts[number] = contact.exchanged()

    def rigid_motions(self, time: float) -> list[RigidMotion]:
        """Of the foundations of the faces at a time."""
        return [contact.rigid_motion(time, "contact") for contact in self.contacts]

    def law(self, part: int, x: FloatArray, area: FloatArray, time: float, slip_rate: FloatArray) -> FrictionLaw:
        """The law of friction of a face at a time, at points x (k, 3) in metres with areas (k,) in m^2, and slip rates
        (k,) of the load step before in m/s."""
        return self.contacts[part].law(x, area, time, slip_rate, MPI.COMM_SELF)

    def frames(self, part: int, n: FloatArray, H: FloatArray, x: FloatArray) -> FloatArray:
        """Rows n, t1, t2 of nodes x (k, 3) in metres of a face with normals n (k, 3) and projectors onto their held
        directions H (k, 3, 3), shape (k, 3, 3)."""
        return self.contacts[part].frames(n, H, x, MPI.COMM_SELF)

    def foundation(self, part: int, x: FloatArray, area: FloatArray, outward: FloatArray) -> RigidFoundation:
        """Foundation of a face before any motion; by default the plane of the face.

        Args:
            part: Number of the face.
            x: All its nodes, shape (k, 3).
            area: Their areas in m^2, shape (k,).
            outward: Integrals of the normal over the face at the nodes, m^2, shape (k, 3).

        Raises:
            ValueError: If none is given and the face is not plane.
        """
        if part not in self._foundations:
            contact = self.contacts[part]
            given = contact.foundation or plane_of_face(contact.face, x, area, outward, MPI.COMM_SELF)
            self._foundations[part] = given
        return self._foundations[part]

    def foundations(self, time: float) -> list[RigidFoundation | None]:
        """Foundations of all faces for which `foundation` was called, moved to a time; None for pairs."""
        motions, found = self.rigid_motions(time), self._foundations
        paired = [k for k, contact in enumerate(self.contacts) if contact.against is not None]
        return [moved(found[k], motions[k]) if k in found else None for k in sorted({*found, *paired})]

    def given_gap(self, part: int, time: float, x: FloatArray) -> FloatArray:
        """The gap given with a contact at a time, metres, at nodes x (k, 3) of its face, shape (k,).

        Raises:
            ValueError: If its file cannot be read: see `lacks_gap`.
        """
        contact = self.contacts[part]
        return contact.gap_factor(time, MPI.COMM_SELF) * contact.gap_at(x, MPI.COMM_SELF)

    def lacks_gap(self, part: int) -> bool:
        """Whether the gap of a contact is in a file that is no longer there."""
        gap = list(self.settings.contacts.values())[part].gap
        return isinstance(gap, FieldTable) and gap.file in self.absent_gaps

    def distances(self, part: int, time: float, x: FloatArray, area: FloatArray, outward: FloatArray) -> FloatArray:
        """Distances in metres of all nodes of a face from its `foundation`, along its normals there, shape (k,).

        Raises:
            ValueError: If the foundation has no distance or normal at a node.
        """
        self.foundation(part, x, area, outward)
        there = self._there(part, time)
        distance: FloatArray = there.signed_distance(x)
        if self.contacts[part].normals == "foundation":
            return distance
        return way_along(outward / np.linalg.norm(outward, axis=1)[:, None], x, distance, there)

    def normals(self, part: int, time: float, x: FloatArray) -> FloatArray:
        """Normals into the foundation of a face at points x (k, 3) in metres, after `distances`, shape (k, 3)."""
        normals: FloatArray = -self._there(part, time).normal(x)
        return normals

    def _there(self, part: int, time: float) -> RigidFoundation:
        return moved(self._foundations[part], self.rigid_motions(time)[part])

    def compare_body(self, run: WrittenRun, time: float, found: Comparison) -> npt.NDArray[np.int64] | None:
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
            found.fault(f"solution.xdmf: has the bodies {names}, but the case has {', '.join(map(repr, bodies))}")
            return None
        if not all([self._compare_one(run, part, loadings[part.name], found) for part in run.body.parts]):
            return None
        return self._faces_of_facets(run, found)

    def _compare_one(self, run: WrittenRun, part: WrittenBody, loading: Loading, found: Comparison) -> bool:
        """Compare one of the bodies; whether the mesh is that of the case."""
        body, x, file = self.bodies[part.name], part.body.x, SOLUTION
        of = f" of {part.name}" if part.name else ""
        node = places(body.x, x)
        cell = places(midpoints(body.domain), midpoints(part.body.domain))
        if len(body.x) != len(node) or np.any(node < 0) or len(np.unique(cell)) != len(cell) or np.any(cell < 0):
            found.fault(f"solution.xdmf: its mesh{of} is not the one that the case describes")
            return False
        on_body = {name: values[part.nodes] for name, values in run.on_body.items()}
        u, modes = np.empty_like(x), np.empty((*x.shape, 6))
        u[node], modes[node] = on_body["displacement"], rigid_modes(run.body.x, MPI.COMM_SELF)[part.nodes]
        acting = {"prescribed": loading.prescribed, "load": loading.load, "spring_force": body.spring_force(u)}
        acting |= {name: -body.spring_force(modes[:, :, k]) for k, name in enumerate(GROUND)}
        for name, expected in (body.held.fields | acting).items():
            written = on_body.get(name, np.zeros_like(x))
            floor = _PROJECTOR if name in body.held.fields else 0.0
            found.field(f"{file}: {name}{of}", written, expected[node], x, _SOURCE, floor=floor)
        if loading.temperature is not None:
            written, expected = on_body.get(TEMPERATURE, np.zeros(len(x))), loading.temperature.change[node]
            found.field(f"{file}: {TEMPERATURE}{of}", written, expected, x, _SOURCE)
        elif np.any(on_body.get(TEMPERATURE, np.zeros(1))) or (TEMPERATURE in on_body and not part.name):
            found.fault(f"{file}: has a {TEMPERATURE}{of}, but the case has no temperature")
        self._compare_constants(part, body, cell, found)
        return True

    def _compare_constants(
        self, part: WrittenBody, body: LoadedBody, cell: npt.NDArray[np.int64], found: Comparison
    ) -> None:
        """Compare the elastic constants of the cells."""
        if part.elastic is None:
            found.fault("case.json: has materials, but these are results of a body of the user's own forms")
            return
        middle, constants = midpoints(part.body.domain), part.elastic.constants
        for name in sorted(constants.keys() ^ body.constants.keys()):
            found.fault(f"{SOLUTION}: {'lacks' if name in body.constants else 'has'} {name}, unlike the case")
        for name in constants.keys() & body.constants.keys():
            function = body.constants[name]
            width = part.on_cells[name].shape[1:]
            expected = function.x.array.reshape(-1, *width)[compat.cell_dofs(function.function_space)[:, 0]][cell]
            found.field(f"{SOLUTION}: {name}", part.on_cells[name], expected, middle, _SOURCE)

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
        found.tree(SUMMARY, run.summary, expected, source=_SOURCE)

    def _faces_of_facets(self, run: WrittenRun, found: Comparison) -> npt.NDArray[np.int64] | None:
        """Number of the contact face of each of the run's facets; None if they are others than those of the case."""
        if run.faces[0].name:
            return self._faces_of_grids(run, found)
        (face,), given = run.faces, []
        for contact in self.contacts:
            body, own = self.face(contact.face)
            corners = corners_of(body.domain, body.mesh.facets(own, "contact"))
            x = body.domain.geometry.x[corners].reshape(-1, 3)
            given.append(places(run.on_face["x"], x).reshape(corners.shape))
        missing = sum(int(np.sum(np.any(rows < 0, axis=1))) for rows in given)
        part = np.full(len(face.facets), -1)
        rows = np.sort(face.facets, axis=1)
        for number, of_case in enumerate(given):
            _, same = np.unique(np.vstack([np.sort(of_case, axis=1), rows]), axis=0, return_inverse=True)
            part[np.isin(same.ravel()[len(of_case) :], same.ravel()[: len(of_case)])] = number
        if missing or np.any(part < 0) or len(part) != sum(map(len, given)):
            names = ", ".join(repr(contact.face) for contact in self.contacts)
            found.fault(
                f"contact.xdmf: has {len(part)} facets, of which {np.count_nonzero(part >= 0)} are on {names}; "
                f"the case has {sum(map(len, given))} facets there"
            )
            return None
        return part

    def _faces_of_grids(self, run: WrittenRun, found: Comparison) -> npt.NDArray[np.int64] | None:
        """The same where every face has its own grid."""
        opposite = {one.contact: one.face for one in run.opposite}
        grids = [
            (contact.face, run.faces[k] if k < len(run.faces) else None) for k, contact in enumerate(self.contacts)
        ]
        grids += [(c.against, opposite.get(k)) for k, c in enumerate(self.contacts) if c.against is not None]
        for name, grid in grids:
            body, own = self.face(name)
            corners = corners_of(body.domain, body.mesh.facets(own, "contact"))
            of_case = body.domain.geometry.x[corners].mean(axis=1)
            written = np.empty((0, 3)) if grid is None else midpoints_of_facets(grid)
            there = places(written, of_case)
            if grid is None or len(there) != len(written) or np.any(there < 0):
                found.fault(
                    f"contact.xdmf: has {len(written)} facets for {name!r}, and the case {len(there)}, of which "
                    f"{np.count_nonzero(there >= 0)} are the same"
                )
                return None
        if len(run.faces) != len(self.contacts) or len(opposite) != len(grids) - len(self.contacts):
            found.fault(f"contact.xdmf: has {len(run.faces)} contact faces, but the case has {len(self.contacts)}")
            return None
        return np.repeat(np.arange(len(run.faces)), [len(face.facets) for face in run.faces])
