"""Check of a run without its problem: what the files alone tell.

They are complete, finite and fit each other; the rows of the certificate pass as their values and limits say; contact
forces lie in the cone of friction and press only where nothing is open; the fields and totals of the contact follow
from forces, displacement and axes as written; loads, supports and contact are in balance.  What takes the problem is
named: equilibrium, stresses, loads and supports, normals, gaps and weights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..contact_fields import ANSWER, COMPLIANCES, sides_of
from ..fem.geometry import inverse_frames
from ..fem.meshes import SEPARATOR
from ..io.field_files import NODE, OPPOSITE, WHOLE, Grid, data_of
from ..io.result_grids import OURS
from ..io.run_directory import CONTACT, OLD, SOLUTION, SUMMARY, RunDirectory
from ..model.nodal_answer import HELD, Accumulated, NodalAnswer
from ..solvers.laws import FrictionLaw
from ..units import amount, use
from .comparison import Comparison, Field, named, perturbed
from .fields import Grids, sound
from .findings import Findings, unread

Fields = dict[str, FloatArray]

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

_PERTURBED: Final = ("displacement", "load", "contact_force", "slip")
"""Fields whose rounding errors are followed to those of the others."""

_BALANCED: Final = 1e-6
"""Accepted sum of all forces over the sum of their sizes."""


def check_alone(files: RunDirectory, why: str) -> Findings:
    """Check the files of a run, or of a load step, whose problem is not there, `why` in words.

    Raises:
        ValueError: If a file is missing, cannot be read, or does not match the others.
    """
    (contents, grids, times), compared, random = sound(files), Comparison(), np.random.default_rng(1)
    use(**{name: str(unit) for name, unit in contents.get("units", {}).items() if name in ("length", "stress")})

    def near(of: Grid) -> Grid:
        fields = {name: perturbed(one, random) if name in _PERTURBED else one for name, one in of.fields.items()}
        return of._replace(fields=fields)

    around = {file: {name: near(of) for name, of in there.items()} for file, there in grids.items()}
    (written_fields, answer, forces), (_, other, near_them) = (_contact(files, contents, of) for of in (grids, around))
    written, fields = _fields(written_fields, answer)
    compared.tree(written, fields, [{**_fields(written_fields, other)[1], "status": None}], (CONTACT, WHOLE), ANSWER)
    numbers = _numbers(contents, grids, answer, forces)
    strain = contents.get("small_strain") or {}
    violations = () if strain.get("accepted") else tuple(strain.get("violations", ()))
    numbers["valid"] = numbers["certificate"]["passed"] and not violations
    loads = np.sum([np.zeros(3), *(one["force"] for one in contents.get("loads", ()))], axis=0)
    said = {**contents, "sum of loads": loads.tolist()}
    compared.tree(said, numbers, [_numbers(contents, around, other, near_them)], (SUMMARY,), "the fields")
    for name, time in times.items():
        compared.tree(time, contents.get("step", {}).get("time", time), (), (name, WHOLE, "time"))
    _judge(contents, grids, answer, forces, compared)
    taken = (f"judged from the files alone, since {why}: {_JUDGED}", f"not judged without the problem: {_LEFT}")
    names = dict.fromkeys(field for grid in grids[SOLUTION].values() for field in grid.fields if field not in OURS)
    left = named(compared.left) + [f"{one} of {SOLUTION}" for one in names]
    return Findings(contents, None, violations, compared.faults, taken, [*left, *unread(files)])


Forces = list[tuple[str, int | None, FloatArray]]
"""Of every grid of contact.xdmf its body, the number of the face that it is opposite to in a pair, and its contact
forces in newtons, shape (k, 3)."""


def _contact(files: RunDirectory, contents: Mapping[str, Any], grids: Grids) -> tuple[Fields, NodalAnswer, Forces]:
    """The fields of all contact points, with their coordinates "points", the answer that they are, and the forces of
    the grids; ValueError if they do not match the other files."""
    sides, bodies = sides_of(contents["faces"]), grids[SOLUTION]
    faces, forces = dict[str, Fields](), Forces()
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
        here = np.round(own["status"]) != HELD
        forces.append((body, None, own["contact_force"][here]))
        faces[name] = {field: values[here] for field, values in {"points": points, **own}.items()}
    if list(faces) not in ([slave for slave, _ in sides], [WHOLE]):
        raise ValueError(f"{files.contact}: has other contact faces, {list(faces)}, than summary.json: {OLD}")
    at = {name: np.concatenate([fields[name] for fields in faces.values()]) for name in next(iter(faces.values()))}
    return at, _answer(at, contents, len(bodies) > 1), forces


def _fields(points: Fields, answer: NodalAnswer) -> tuple[dict[str, Field], dict[str, Field]]:
    """Fields that follow from the others, and forces and the bound of friction within those of the law: as they are in
    the files, and as they follow."""
    force, bound, fields = answer.force, answer.bound, answer.fields()
    largest, none = float(np.max(np.abs(force), initial=0.0)), np.zeros(len(force))
    pairs: dict[str, tuple[Any, Any, float]] = {name: (points[name], fields[name], 0.0) for name in _FIELDS}
    pairs["length of normal"] = np.linalg.norm(answer.frames[:, 0], axis=1), none + 1.0, 0.0
    pairs["tension"] = np.maximum(-force[:, 0], 0.0), none, 1e-6 * largest
    beyond = np.maximum(np.hypot(force[:, 1], force[:, 2]) - bound, 0.0)
    pairs["friction beyond its bound"] = beyond, none, 1e-6 * largest
    pairs["slip_bound"] = answer.slip_bound, bound, 1e-5 * largest
    written = {name: Field(values, answer.x) for name, (values, *_) in pairs.items()}
    return written, {name: Field(follows, answer.x, floor) for name, (_, follows, floor) in pairs.items()}


def _numbers(contents: Mapping[str, Any], grids: Grids, answer: NodalAnswer, forces: Forces) -> dict[str, Any]:
    """The entries of the summary that follow from the fields: totals, and sums of the nodal forces of loads, faces
    opposite and bodies; and rows of the certificate, which pass if their values are from 0 to their limits."""
    solids, numbers = grids[SOLUTION], answer.numbers()
    u, load = (np.concatenate([solid.fields[name] for solid in solids.values()]) for name in ("displacement", "load"))

    def resultant(on: Sequence[FloatArray]) -> list[float]:
        return (answer.copies * np.concatenate([load[:0], *on]).sum(axis=0)).tolist()

    # points of 10-node faces and of pairs are not at the nodes that files have
    totals, *faces = (
        {name: value for name, value in of.items() if name not in _AT_POINTS}
        for of in (numbers["totals"], *map(answer.totals, range(len(answer.faces))))
    )
    for _, face, on in forces:
        if face is not None:
            faces[face]["opposite_force"] = resultant([on])
    bodies = [{"name": name, "contact_force": resultant([on for of, _, on in forces if of == name])} for name in solids]
    rows = {name: row for name, row in contents["certificate"].items() if isinstance(row, Mapping)}
    passed = {name: row["value"] is not None and 0.0 <= row["value"] <= row["limit"] for name, row in rows.items()}
    certificate = {**{name: {"passed": within} for name, within in passed.items()}, "passed": all(passed.values())}
    return {
        **{name: numbers[name] for name in ("force_on_body", "nodes") if name in numbers},
        **{"totals": totals, "faces": faces, "sum of loads": resultant([load])},
        **({"bodies": bodies} if len(bodies) > 1 else {}),
        "maximum": {
            "displacement": float(np.max(np.linalg.norm(u, axis=1))),
            "contact_pressure": totals["greatest_pressure"],
        },
        "certificate": certificate,
    }


def _judge(contents: Mapping[str, Any], grids: Grids, answer: NodalAnswer, forces: Forces, found: Comparison) -> None:
    """Judge the natural residual by its limit, and the sum of all forces by their sizes, if these rows pass."""
    rows, none = contents["certificate"], np.zeros(len(answer.x))
    remaining = np.column_stack([answer.gap, none, none]) - answer.relative_displacement
    force, unit, law = answer.force, answer.compliance, FrictionLaw.tresca(answer.bound)
    size = float(np.linalg.norm(law.left_over(force.ravel(), (remaining / unit).ravel(), 0.0)))
    row = rows.get("natural_residual", {})
    if row.get("passed") and not size <= 1.001 * row["limit"] * float(np.linalg.norm(force)):
        found.faults.append(
            f"{CONTACT}: forces, gaps and slip leave a natural residual of {amount(size, 'N')}, beyond its limit"
        )
    acting = [one for name in ("loads", "reactions", "rigid_faces") for one in contents.get(name, ())]
    parts = [one["force"] for one in (*acting, *(one for one in contents["faces"] if "against" not in one))]
    sector = any(one["kind"] == "cyclic symmetry" for one in contents.get("understood", {}).get("ties", ()))
    nodal = [*(one.fields["load"] for one in grids[SOLUTION].values()), *(on for _, face, on in forces if face is None)]
    size = sum(float(np.linalg.norm(part)) for part in parts)
    size += answer.copies * sum(float(np.sum(np.abs(on))) for on in nodal)
    over = float(np.linalg.norm(np.sum([np.zeros(3), *parts], axis=0)))
    if not (over <= _BALANCED * size or sector) and rows.get("force_balance", {}).get("passed"):
        found.faults.append(
            f"{SUMMARY}: loads, reactions and contact leave a force of {amount(over, 'N')} of {amount(size, 'N')}"
        )


def _answer(points: Fields, contents: Mapping[str, Any], several: bool) -> NodalAnswer:
    """The answer at the contact points, by their fields; ValueError if they have no axes or area.  The largest friction
    of a face is that in the summary, or where it is a function of place the bound in the files, between the smallest
    and the largest."""
    faces, part = contents["faces"], np.round(points["face"]).astype(np.int64)
    frames = np.stack([points["normal"], points["tangent_1"], points["tangent_2"]], axis=1)
    if np.any(np.abs(np.linalg.det(frames)) < 1e-6):
        raise ValueError(f"{CONTACT}: normal and tangents of a contact point are no axes")
    if np.any(points["area"] <= 0.0):
        raise ValueError(f"{CONTACT}: area of a contact point is not positive")
    given, limit = [face.get("friction_limit") for face in faces], None
    if any(one is not None for one in given):
        ends = [(one["min"], one["max"]) if isinstance(one, Mapping) else (one or np.inf,) * 2 for one in given]
        limit = np.clip(points["slip_bound"], *(np.array(ends)[part].T * points["area"]))
    rows = np.einsum("kij,kj->ki", frames, points["slip"])
    rows[:, 0] = points["initial_gap"] - points["gap"]
    return NodalAnswer(
        comm=MPI.COMM_SELF,
        law=FrictionLaw(points["cohesion"] * points["area"], points["friction"], limit),
        faces=tuple(face["faces"][0] for face in faces),
        part=part,
        x=points["points"],
        frames=frames,
        gap=points["initial_gap"],
        given_gap=points["given_gap"],
        chord=np.zeros((len(points["points"]), 2)),
        area=points["area"],
        slip_origin=np.zeros_like(rows),
        displacement=rows,
        force=-np.einsum("kij,kj->ki", inverse_frames(frames), points["contact_force"]),
        slip_bound=points["slip_bound"],
        compliance=np.column_stack([points[name] for name in COMPLIANCES]),
        spins=(None,) * len(faces),
        earlier=Accumulated.none(len(rows)),
        force_before=np.zeros_like(rows),
        against=tuple(face.get("against") for face in faces),
        several=several,
        copies=float(contents.get("slice", {}).get("layers", 1.0)),
    )
