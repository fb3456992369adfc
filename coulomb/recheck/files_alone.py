"""Check of a run without its problem: what the files alone tell.

They are complete, finite and fit each other; the rows of the certificate pass as their values and limits say; contact
forces lie in the cone of friction and press only where nothing is open; the fields and totals of the contact follow
from forces, displacement and axes as written; loads, supports and contact are in balance.  What takes the problem is
named: equilibrium, stresses, loads and supports, normals, gaps and weights.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..contact_fields import ANSWER, COMPLIANCES, sides_of
from ..fem.geometry import inverse_frames
from ..fem.meshes import SEPARATOR
from ..io.field_files import NODE, OPPOSITE, WHOLE, data_of
from ..io.result_grids import OURS
from ..io.run_directory import CONTACT, OLD, SOLUTION, SUMMARY, RunDirectory
from ..model.nodal_answer import HELD, Accumulated, NodalAnswer
from ..solvers.laws import FrictionLaw
from ..units import amount, use
from .comparison import Comparison, Field, named, perturbed
from .fields import Grids, sound
from .findings import Findings, unread

_FIELDS: Final = ("pressure", "friction_traction", "friction_use", "status", "coefficient")
"""Fields of contact points that follow from their others."""

_AT_POINTS: Final = ("moment", "centre_of_pressure")
"""Totals that depend on the places of the contact points."""

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


def check_alone(files: RunDirectory, why: str) -> Findings:
    """Check the files of a run, or of a load step, whose problem is not there, `why` in words.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others.
    """
    (contents, grids, times), found = sound(files), Comparison()
    use(**{name: str(unit) for name, unit in contents.get("units", {}).items() if name in ("length", "stress")})
    solids = grids[SOLUTION].values()
    u, load = (np.concatenate([one.fields[name] for one in solids]) for name in ("displacement", "load"))
    fields, forces = _contact(files, contents, grids)
    touching = np.round(fields["status"]) != HELD
    at = {name: values[touching] for name, values in fields.items()}
    copies = float(contents.get("slice", {}).get("layers", 1.0))
    random, faces = np.random.default_rng(1), contents["faces"]
    near = {**at, **{name: perturbed(at[name], random) for name in ("contact_force", "slip")}}
    answer, other = (_answer(fields, faces, len(solids) > 1, copies) for fields in (at, near))
    _compare_fields(at, answer, contents["certificate"].get("natural_residual", {}), found)
    follow, others = (
        {name: of for name, of in one.numbers().items() if name in ("force_on_body", "totals", "nodes")}
        for one in (answer, other)
    )
    for one in (follow, others):  # points of 10-node faces and of pairs are not at the nodes that files have
        one["totals"] = {name: of for name, of in one["totals"].items() if name not in _AT_POINTS}
    certificate, moved = _certificate(contents["certificate"]), np.max(np.linalg.norm(u, axis=1))
    strain = contents.get("small_strain") or {}
    violations = () if strain.get("accepted") else tuple(strain.get("violations", ()))
    follow["maximum"] = {"displacement": moved, "contact_pressure": follow["totals"]["greatest_pressure"]}
    follow |= {"certificate": certificate, "valid": certificate["passed"] and not violations}
    found.tree(contents, follow, [others], (SUMMARY,), ANSWER)
    _compare_sums(contents, forces, load, grids[SOLUTION], copies, found)
    for name, time in times.items():
        found.tree(time, contents.get("step", {}).get("time", time), (), (name, WHOLE, "time"))
    taken = (f"judged from the files alone, since {why}: {_JUDGED}", f"not judged without the problem: {_LEFT}")
    names = dict.fromkeys(one for grid in solids for one in grid.fields if one not in OURS)
    left = named(found.left) + [f"{one} of {SOLUTION}" for one in names]
    return Findings(contents, None, violations, found.faults, taken, [*left, *unread(files)])


def _contact(
    files: RunDirectory, contents: Mapping[str, Any], grids: Grids
) -> tuple[dict[str, FloatArray], list[tuple[str, int | None, FloatArray]]]:
    """The fields of all contact faces, with their coordinates "points"; and of every grid its body, the number of the
    face that it is opposite to in a pair, and its contact forces; ValueError if they do not match the other files."""
    sides, bodies = sides_of(contents["faces"]), grids[SOLUTION]
    faces, forces = dict[str, dict[str, FloatArray]](), list[tuple[str, int | None, FloatArray]]()
    for name, (_, cells, points, own, *_) in grids[CONTACT].items():
        body = name.partition(SEPARATOR)[0]
        body = body if body in bodies else next(iter(bodies))
        node, x = own[NODE].astype(np.int64), bodies[body].points
        if np.any(node >= len(x)) or not np.array_equal(x[node], points):
            unfit = f"{data_of(files.contact)} does not match the mesh of {SOLUTION}"
            raise ValueError(f"{unfit}: its points are not the nodes there that {NODE!r} names")
        if OPPOSITE in own:
            forces.append((body, [master for _, master in sides].index(name), own["contact_force"]))
            continue
        between = cells[:, 3:] if cells.shape[1] == 6 else cells[:0]  # of 10-node tetrahedra, no contact nodes
        own["status"][np.unique(between)] = HELD
        here = (np.round(own["status"]) != HELD)[:, None]
        forces.append((body, None, np.where(here, own["contact_force"], 0.0)))
        faces[name] = {"points": points, **own}
    if list(faces) not in ([slave for slave, _ in sides], [WHOLE]):
        raise ValueError(f"{files.contact}: has other contact faces, {list(faces)}, than summary.json: {OLD}")
    names = next(iter(faces.values()))
    return {name: np.concatenate([fields[name] for fields in faces.values()]) for name in names}, forces


def _certificate(certificate: Mapping[str, Any]) -> dict[str, Any]:
    """Rows of the certificate pass if their values are from 0 to their limits, and it passes if all do."""
    rows = {name: row for name, row in certificate.items() if isinstance(row, Mapping)}
    passed = {name: row["value"] is not None and 0.0 <= row["value"] <= row["limit"] for name, row in rows.items()}
    return {**{name: {"passed": within} for name, within in passed.items()}, "passed": all(passed.values())}


def _answer(at: Mapping[str, FloatArray], faces: list[dict[str, Any]], several: bool, copies: float) -> NodalAnswer:
    """The answer at the contact points, by their fields; ValueError if they have no axes or area."""
    frames = np.stack([at["normal"], at["tangent_1"], at["tangent_2"]], axis=1)
    if np.any(np.abs(np.linalg.det(frames)) < 1e-6):
        raise ValueError(f"{CONTACT}: normal and tangents of a contact point are no axes")
    if np.any(at["area"] <= 0.0):
        raise ValueError(f"{CONTACT}: area of a contact point is not positive")
    rows = np.einsum("kij,kj->ki", frames, at["slip"])
    rows[:, 0] = at["initial_gap"] - at["gap"]
    return NodalAnswer(
        comm=MPI.COMM_SELF,
        law=FrictionLaw(at["cohesion"] * at["area"], at["friction"], _limits(faces, at)),
        faces=tuple(face["faces"][0] for face in faces),
        part=np.round(at["face"]).astype(np.int64),
        x=at["points"],
        frames=frames,
        gap=at["initial_gap"],
        given_gap=at["given_gap"],
        chord=np.zeros((len(at["points"]), 2)),
        area=at["area"],
        slip_origin=np.zeros_like(rows),
        displacement=rows,
        force=-np.einsum("kij,kj->ki", inverse_frames(frames), at["contact_force"]),
        slip_bound=at["slip_bound"],
        compliance=np.column_stack([at[name] for name in COMPLIANCES]),
        spins=(None,) * len(faces),
        earlier=Accumulated.none(len(rows)),
        force_before=np.zeros_like(rows),
        against=tuple(one.get("against") for one in faces),
        several=several,
        copies=copies,
    )


def _limits(faces: list[dict[str, Any]], at: Mapping[str, FloatArray]) -> FloatArray | None:
    """Largest friction at the contact points, newtons, shape (m,): of every face that in the summary, or where it is a
    function of place the bound in the files, between the smallest and the largest; None without limits."""
    given = [face.get("friction_limit") for face in faces]
    if all(one is None for one in given):
        return None
    ends = [(one["min"], one["max"]) if isinstance(one, Mapping) else (one or np.inf,) * 2 for one in given]
    low, high = np.array(ends)[np.round(at["face"]).astype(np.int64)].T * at["area"]
    return np.clip(at["slip_bound"], low, high)


def _compare_fields(
    at: Mapping[str, FloatArray], answer: NodalAnswer, row: Mapping[str, Any], found: Comparison
) -> None:
    """Compare the fields that follow from others, forces with the bounds of friction, and the natural residual with its
    limit, that of a row of the certificate."""
    x, force, bound = answer.x, answer.force, answer.bound
    largest, none = float(np.max(np.abs(force), initial=0.0)), np.zeros(len(x))
    beyond = np.hypot(force[:, 1], force[:, 2]) - bound

    def compare(name: str, written: FloatArray, follows: FloatArray, floor: float, source: str) -> None:
        found.tree(Field(written, x), Field(follows, x, floor), (), (CONTACT, WHOLE, name), source)

    compare("length of normal", np.linalg.norm(answer.frames[:, 0], axis=1), none + 1.0, 0.0, "its direction")
    fields = answer.fields()
    for name in _FIELDS:
        size = float(np.max(np.abs(fields["pressure" if name == "friction_traction" else name]), initial=0.0))
        size = max(size, 1.0) if name == "friction_use" else size
        compare(name, at[name], fields[name], 1e-9 * size, ANSWER)
    for name, written, follows, floor in (
        ("tension", np.maximum(-force[:, 0], 0.0), none, 1e-6 * largest),
        ("friction beyond its bound", np.maximum(beyond, 0.0), none, 1e-6 * largest),
        ("slip_bound", answer.slip_bound, bound, 1e-5 * largest),
    ):
        compare(name, written, follows, floor, "the law of friction")
    remaining = np.column_stack([answer.gap, none, none]) - answer.relative_displacement
    left = FrictionLaw.tresca(bound).left_over(force.ravel(), (remaining / answer.compliance).ravel(), 0.0)
    size = float(np.linalg.norm(left))
    if row.get("passed") and not size <= 1.001 * row["limit"] * float(np.linalg.norm(force)):
        found.faults.append(
            f"{CONTACT}: forces, gaps and slip leave a natural residual of {amount(size, 'N')}, beyond its limit"
        )


def _compare_sums(
    contents: Mapping[str, Any],
    forces: list[tuple[str, int | None, FloatArray]],
    load: FloatArray,
    bodies: Collection[str],
    copies: float,
    found: Comparison,
) -> None:
    """Compare sums of nodal forces with the loads and the forces of faces and bodies, and all together with none."""
    loads = [np.array(one["force"]) for one in contents.get("loads", ())]
    parts = [*loads, *(np.array(one["force"]) for one in contents.get("reactions", ()))]
    parts += [np.array(one["force"]) for one in contents.get("rigid_faces", ())]
    parts += [np.array(one["force"]) for one in contents["faces"] if "against" not in one]
    sector = any(one["kind"] == "cyclic symmetry" for one in contents.get("understood", {}).get("ties", ()))
    size = sum(float(np.linalg.norm(part)) for part in parts)
    size += copies * sum(float(np.sum(np.abs(of))) for of in (load, *(on for _, face, on in forces if face is None)))
    over = float(np.linalg.norm(np.sum(parts, axis=0))) if parts else 0.0
    if not (over <= _BALANCED * size or sector) and contents["certificate"].get("force_balance", {}).get("passed"):
        found.faults.append(
            f"{SUMMARY}: loads, reactions and contact leave a force of {amount(over, 'N')} of {amount(size, 'N')}"
        )

    def compare(said: list[float], forces: FloatArray, *place: str | int) -> None:
        """Compare a force with the sum of nodal ones (k, 3) of all layers, to the rounding errors of their sizes."""
        sums, rounding = copies * forces.sum(axis=0), 1e-12 * copies * float(np.sum(np.abs(forces)))
        found.tree(said, sums.tolist(), [(sums + rounding).tolist()], place, "the nodal forces")

    for _, face, on_face in forces:
        if face is not None:
            compare(contents["faces"][face]["opposite_force"], on_face, SUMMARY, "faces", face, "opposite_force")
    for number, name in enumerate(bodies if len(bodies) > 1 else ()):
        one, on_body = contents["bodies"][number], [load[:0], *(on for body, _, on in forces if body == name)]
        found.tree(one["name"], name, (), (SUMMARY, "bodies", number, "name"), SOLUTION)
        compare(one["contact_force"], np.concatenate(on_body), SUMMARY, "bodies", number, "contact_force")
    compare(np.sum([np.zeros(3), *loads], axis=0).tolist(), load, f"{SUMMARY}: loads")
