"""Check of a run without its problem: what the files alone tell.

They are complete, finite and fit each other; the rows of the certificate pass as their values and limits say; contact
forces lie in the cone of friction and press only where nothing is open; the fields and totals of the contact follow
from forces, displacement and axes as written; loads, supports and contact are in balance.  What takes the problem is
named: equilibrium, stresses, loads and supports, normals, gaps and weights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ...contact_fields import ANSWER, COMPLIANCES, sides_of
from ...fem.geometry import inverse_frames
from ...fem.meshes import SEPARATOR
from ...model.nodal_answer import ACCUMULATED, HELD, Accumulated, NodalAnswer
from ...solvers.laws import FrictionLaw
from ...units import amount, use
from ..field_files import NODE, OPPOSITE, data_of, fields_in, grids_of
from ..result_grids import OURS
from ..run_directory import CONTACT, FIELDS, OLD, SOLUTION, SUMMARY, RunDirectory
from .comparison import Comparison, unjudged
from .fields import described_fields, sound
from .findings import Findings, unread

Numbers = npt.NDArray[np.int64]

_FIELDS: Final = ("pressure", "friction_traction", "friction_use", "status", "coefficient")
"""Fields of contact points that follow from their others."""

_TOTALS: Final = (
    "faces",
    "force",
    "normal_force",
    "friction_force",
    "contact_area",
    "greatest_slip",
    "greatest_pressure",
    "dissipated_energy",
)

_JUDGED: Final = (
    "formats, rows of the certificate against their limits, friction cone and complementarity of every contact point, "
    "totals and balance of forces; in Python coulomb.check(directory, problem) judges all"
)
_LEFT: Final = (
    "equilibrium, stresses, mesh, materials, loads, supports, normals, gaps, areas, coefficients of friction, slip "
    "origin, ties, heat"
)

_BALANCED: Final = 1e-6
"""Accepted sum of all forces over the sum of their sizes."""


@dataclass(frozen=True)
class _Written:
    """What the files of a run have.

    Attributes:
        summary: summary.json.
        bodies: The nodes of every body, by its name, among the k of all.
        displacement, load: At these nodes, shape (k, 3).
        on_face: Fields at the q nodes of the contact faces, and their coordinates "x".
        node: Their numbers among the k nodes, shape (q,).
        touching: Which of them are contact nodes, shape (q,).
        opposite: Of every face opposite in a pair the number of the pair, nodes and forces there.
    """

    summary: dict[str, Any]
    bodies: Mapping[str, slice]
    displacement: FloatArray
    load: FloatArray
    on_face: Mapping[str, FloatArray]
    node: Numbers
    touching: npt.NDArray[np.bool_]
    opposite: Sequence[tuple[int, Numbers, FloatArray]]


def _read(files: RunDirectory) -> _Written:
    """Read the files of a run.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others.
    """
    summary, bodies = sound(files), dict[str, slice]()
    x: FloatArray = np.empty((0, 3))
    displacement: FloatArray = x
    load: FloatArray = x
    for name, group in grids_of(files.solution).items():
        points, _, fields = fields_in(files.solution, group)
        bodies[name] = slice(len(x), len(x) + len(points))
        x, displacement, load = (
            np.concatenate(both)
            for both in ((x, points), (displacement, fields["displacement"]), (load, fields["load"]))
        )
    sides = sides_of(summary["faces"])
    slaves, masters = [one for one, _ in sides], {master: k for k, (_, master) in enumerate(sides) if master}
    faces, opposite, names = list[tuple[Mapping[str, FloatArray], Numbers]](), [], []
    for name, group in grids_of(files.contact).items():
        points, cells, fields = fields_in(files.contact, group)
        body = bodies.get(name.partition(SEPARATOR)[0]) or next(iter(bodies.values()))
        node = body.start + fields[NODE].astype(np.int64)
        if np.any((node < body.start) | (node >= body.stop)) or not np.array_equal(x[node], points):
            unfit = f"{data_of(files.contact)} does not match the mesh of {SOLUTION}"
            raise ValueError(f"{unfit}: its points are not the nodes there that {NODE!r} names")
        if OPPOSITE in fields:
            opposite.append((masters[name], node, fields["contact_force"]))
            continue
        between = cells[:, 3:] if cells.shape[1] == 6 else cells[:0]  # of 10-node tetrahedra, no contact nodes
        fields["status"][np.unique(between)] = HELD
        faces.append(({**fields, "x": points}, node))
        names.append(name)
    if names != slaves and any(names):
        raise ValueError(f"{files.contact}: has the contact faces {names}, but summary.json {slaves}: {OLD}")
    on_face = {name: np.concatenate([fields[name] for fields, _ in faces]) for name in faces[0][0]}
    touching = np.round(on_face["status"]) != HELD
    node = np.concatenate([node for _, node in faces])
    return _Written(summary, bodies, displacement, load, on_face, node, touching, opposite)


def check_alone(files: RunDirectory, why: str) -> Findings:
    """Check the files of a run, or of a load step, whose problem is not there, `why` in words.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others.
    """
    run, written = _read(files), described_fields(files.path)
    use(**{name: str(unit) for name, unit in run.summary.get("units", {}).items() if name in ("length", "stress")})
    contents, found = run.summary, Comparison(1e-12)
    _compare_certificate(contents, found)
    answer, here = _answer(run)
    x, fields = run.on_face["x"][here], answer.fields()
    lengths = np.linalg.norm(answer.frames, axis=2)
    found.field(f"{CONTACT}: length of normal", lengths[:, 0], np.ones(len(x)), x, "its direction")
    for name in _FIELDS:
        floor = 1e-9 * float(np.max(np.abs(fields["pressure" if name == "friction_traction" else name]), initial=0.0))
        found.field(f"{CONTACT}: {name}", run.on_face[name][here], fields[name], x, ANSWER, floor=floor)
    _compare_cone(run, answer, here, found)
    numbers = answer.numbers()
    totals = {name: value for name, value in numbers["totals"].items() if name in _TOTALS}
    moved = float(np.max(np.linalg.norm(run.displacement, axis=1)))
    work = 1e-12 * moved * float(np.sum(np.abs(answer.force)))
    near = {name: totals[name] + by for name, by in (("greatest_slip", 1e-12 * moved), ("dissipated_energy", work))}
    expected = {"totals": totals, "nodes": numbers["nodes"]}
    found.tree(SUMMARY, contents, expected, [{"totals": {**totals, **near}, "nodes": numbers["nodes"]}], ANSWER)
    largest = {"displacement": moved, "contact_pressure": numbers["totals"]["greatest_pressure"]}
    found.tree(f"{SUMMARY}.maximum", contents["maximum"], largest, source=ANSWER)
    _compare_forces(run, contents, found)
    taken = (f"judged from the files alone, since {why}: {_JUDGED}", f"not judged without the problem: {_LEFT}")
    for name, described in zip(FIELDS, written, strict=True):
        found.tree(f"{name}: time", described.time, contents.get("step", {}).get("time", described.time))
    strain = contents.get("small_strain") or {}
    outside = () if strain.get("accepted") else tuple(strain.get("violations", ()))
    left = unjudged(SUMMARY, contents, found.judged)
    left += [f"{name} of {SOLUTION}" for name in written[0].fields if name not in OURS]
    return Findings(contents, None, outside, tuple(found.faults), taken, (*left, *unread(files)))


def _compare_certificate(contents: Mapping[str, Any], found: Comparison) -> None:
    """Rows of the certificate pass if their values are within their limits, and it passes if all do."""
    rows = {name: row for name, row in contents["certificate"].items() if isinstance(row, Mapping)}
    within = {}
    for name, row in rows.items():
        value, limit = row.get("value"), row.get("limit")
        within[name] = isinstance(value, float | int) and isinstance(limit, float | int) and value <= limit
        if isinstance(value, float | int) and isinstance(limit, float | int) and min(value, limit) < 0.0:
            found.fault(f"{SUMMARY}.certificate.{name}: {value:g} and its limit {limit:g} must be 0 or more")
    expected = {**{name: {"passed": passed} for name, passed in within.items()}, "passed": all(within.values())}
    found.tree(f"{SUMMARY}.certificate", contents["certificate"], expected, source="its values and limits")
    strain = contents.get("small_strain") or {}
    valid = expected["passed"] and (bool(strain.get("accepted")) or not strain.get("violations"))
    found.tree(f"{SUMMARY}.valid", contents.get("valid"), valid, source="certificate and small_strain")


def _answer(run: _Written) -> tuple[NodalAnswer, Any]:
    """The answer at the contact points of the files, by their fields, and which nodes these are."""
    here = run.touching
    at = {name: values[here] for name, values in run.on_face.items()}
    frames = np.stack([at["normal"], at["tangent_1"], at["tangent_2"]], axis=1)
    if np.any(np.abs(np.linalg.det(frames)) < 1e-6):
        raise ValueError(f"{CONTACT}: normal and tangents of a contact point are no axes")
    if np.any(at["area"] <= 0.0):
        raise ValueError(f"{CONTACT}: area of a contact point is not positive")
    origin = np.einsum("kij,kj->ki", frames, at["slip_origin"])
    rows = origin + np.einsum("kij,kj->ki", frames, at["slip"])
    rows[:, 0] = at["initial_gap"] - at["gap"]
    answer = NodalAnswer(
        comm=MPI.COMM_SELF,
        law=FrictionLaw(at["cohesion"] * at["area"], at["friction"], _limits(run, at)),
        faces=tuple(face["faces"][0] for face in run.summary["faces"]),
        part=np.round(at["face"]).astype(np.int64),
        x=at["x"],
        frames=frames,
        gap=at["initial_gap"],
        given_gap=at["given_gap"],
        chord=np.zeros(len(at["x"])),
        area=at["area"],
        slip_origin=origin,
        displacement=rows,
        force=-np.einsum("kij,kj->ki", inverse_frames(frames), at["contact_force"]),
        slip_bound=at["slip_bound"],
        compliance=np.column_stack([at[name] for name in COMPLIANCES]),
        spins=(None,) * len(run.summary["faces"]),
        earlier=Accumulated(*(at[name] for name in ACCUMULATED)),
        against=tuple(one.get("against") for one in run.summary["faces"]),
        several=len(run.bodies) > 1,
    )
    return answer, here


def _limits(run: _Written, at: Mapping[str, FloatArray]) -> FloatArray | None:
    """Largest friction at the contact points, newtons, shape (m,): of every face that in the summary, or where it is a
    function of place the bound in the files, between the smallest and the largest; None without limits."""
    given = [face.get("friction_limit") for face in run.summary["faces"]]
    if all(one is None for one in given):
        return None
    ends = [(one["min"], one["max"]) if isinstance(one, Mapping) else (one or np.inf,) * 2 for one in given]
    low, high = np.array(ends)[np.round(at["face"]).astype(np.int64)].T * at["area"]
    limits: FloatArray = np.clip(at["slip_bound"], low, high)
    return limits


def _compare_cone(run: _Written, answer: NodalAnswer, here: Any, found: Comparison) -> None:
    """Compare forces with the bounds of friction, and the natural residual with its limit."""
    x, force, bound = run.on_face["x"][here], answer.force, answer.bound
    largest = float(np.max(np.abs(force), initial=0.0))
    rubbing = np.hypot(force[:, 1], force[:, 2])
    none, limit = np.zeros(len(x)), 1e-6 * largest
    source = "the law of friction"
    found.field(f"{CONTACT}: tension", np.maximum(-force[:, 0], 0.0), none, x, source, floor=limit)
    found.field(f"{CONTACT}: friction beyond its bound", np.maximum(rubbing - bound, 0.0), none, x, source, floor=limit)
    found.field(f"{CONTACT}: slip_bound", answer.slip_bound, bound, x, source, floor=1e-5 * largest)
    remaining = np.column_stack([answer.gap, none, none]) - answer.relative_displacement
    left = FrictionLaw.tresca(bound).left_over(force.ravel(), (remaining / answer.compliance).ravel(), 0.0)
    size, row = float(np.linalg.norm(left)), run.summary["certificate"].get("natural_residual", {})
    if row.get("passed") and not size <= 1.001 * row["limit"] * float(np.linalg.norm(force)):
        found.fault(
            f"{CONTACT}: forces, gaps and slip leave a natural residual of {amount(size, 'N')}, beyond its limit"
        )


def _compare_forces(run: _Written, contents: Mapping[str, Any], found: Comparison) -> None:
    """Compare the sums of nodal forces with the loads, and all forces together with none."""
    parts = [np.array(one["force"]) for name in ("loads", "reactions") for one in contents.get(name, ())]
    parts += [np.array(one["force"]) for one in contents["faces"] if "against" not in one]
    size = sum(float(np.linalg.norm(part)) for part in parts)
    size += sum(float(np.sum(np.abs(of))) for of in (run.load, run.on_face["contact_force"]))
    over = float(np.linalg.norm(np.sum(parts, axis=0))) if parts else 0.0
    if not over <= _BALANCED * size and contents["certificate"].get("force_balance", {}).get("passed"):
        found.fault(
            f"{SUMMARY}: loads, reactions and contact leave a force of {amount(over, 'N')} of {amount(size, 'N')}"
        )
    on_body = np.zeros_like(run.displacement)
    np.add.at(on_body, run.node, np.where(run.touching[:, None], run.on_face["contact_force"], 0.0))
    for number, node, forces in run.opposite:
        np.add.at(on_body, node, forces)
        what, said = f"{SUMMARY}.faces[{number}].opposite_force", contents["faces"][number]["opposite_force"]
        _compare_sum(what, said, forces, found)
    for number, (name, nodes) in enumerate(run.bodies.items() if len(run.bodies) > 1 else ()):
        what, one = f"{SUMMARY}.bodies[{number}]", contents["bodies"][number]
        found.tree(f"{what}.name", one["name"], name, source=SOLUTION)
        _compare_sum(f"{what}.contact_force", one["contact_force"], on_body[nodes], found)
    total = np.sum([one["force"] for one in contents.get("loads", ())] or [np.zeros(3)], axis=0)
    _compare_sum(f"{SUMMARY}: loads", total.tolist(), run.load, found)


def _compare_sum(what: str, said: list[float], forces: FloatArray, found: Comparison) -> None:
    """Compare a force in a summary with the sum of nodal ones (k, 3), to the rounding errors of their sizes."""
    rounding = 1e-12 * float(np.sum(np.abs(forces)))
    sums = forces.sum(axis=0)
    found.tree(what, said, sums.tolist(), [(sums + rounding).tolist()], "the nodal forces")
