"""Data that follow from displacement and contact forces in the files of a run: fields, numbers, certificate,
strains."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray
from ...fem import compat
from ...fem.bodies import EXPANSION, ORTHOTROPIC_EXPANSION, TEMPERATURE, ElasticBody, range_of
from ...fem.contact import face_samples
from ...fem.geometry import RigidFoundation, Spin
from ...linalg.reductions import Reductions
from ...model.accumulated import ACCUMULATED
from ...model.certificate import Certificate, judge
from ...model.evidence import Evidence, rounding_forces
from ...model.load_step import Forces
from ...model.nodal_answer import NodalAnswer
from ...model.resultants import Acting, resultant_of_ground
from ...model.small_strain import SmallStrain, small_strain
from ..field_names import ROUNDING
from ..run_files import WrittenRun
from ..summary import derived
from ..written_faces import WrittenFace
from .comparison import Rounding
from .face_nodes import FaceNodes
from .written_opposite import opposite_fields, written_actions


class Probing(Protocol):
    """The probes of a run."""

    def values(
        self,
        u: FloatArray,
        answer: NodalAnswer,
        nodes: npt.NDArray[np.int64],
        taken: Callable[..., FloatArray],
    ) -> list[dict[str, Any]]:
        """Their entries in summary.json.

        Args:
            u: Displacement of the run's nodes in metres, shape (k, 3).
            answer: The answer at its contact nodes.
            nodes: Their numbers, shape (m,).
            taken: Replaces numbers by perturbed ones; besides perhaps the largest number of their kind.
        """
        ...


class Supported(Protocol):
    """Loads and supports of a body, each by itself, as the case has them."""

    def acting(
        self, u: FloatArray, held: FloatArray, on_body: FloatArray, taken: Callable[[FloatArray], FloatArray]
    ) -> Acting:
        """Resultants and balance.

        Args:
            u: Displacement of the run's nodes in metres, shape (k, 3).
            held: Forces of the supports on the body along held directions in newtons, shape (k, 3).
            on_body: Contact forces on the body in newtons, shape (k, 3).
            taken: Replaces numbers by perturbed ones.
        """
        ...


THERMAL = {EXPANSION, ORTHOTROPIC_EXPANSION}
"""Constants of cells that have a thermal strain."""

_FOLLOW = ("pressure", "friction_traction", "slip", "gap", "status", "friction_use", *ACCUMULATED, "coefficient")
"""Fields of contact.xdmf that follow from displacement and contact forces; the others are input data."""


@dataclass(frozen=True)
class Variant:
    """Data recomputed from displacement and contact forces, as written or perturbed.

    Attributes:
        at: Displacement and forces at the nodes of the body.
        forces: Contact forces on the body at the contact points among the nodes of the written face, shape (q, 3).
        fields: Fields of the written contact nodes.
        stress: By name the stresses of the cells of every body in pascals; empty for one of the user's forms.
        opposite: Fields of every face opposite in a pair.
        numbers: Entries of summary.json.
        certificate: Certificate with all nodes of the contact face.
        outside: Violations of the theory of small strains, unless they were accepted.
        sums: Force and moment of all loads together, and of all supports and springs.
    """

    at: Forces
    forces: FloatArray
    fields: dict[str, FloatArray]
    stress: list[dict[str, FloatArray]]
    opposite: list[dict[str, FloatArray]]
    numbers: dict[str, Any]
    certificate: Certificate
    outside: tuple[str, ...]
    sums: dict[str, dict[str, list[float]]]


def recomputed(
    run: WrittenRun,
    nodes: FaceNodes,
    foundations: list[RigidFoundation | None] | None,
    spins: tuple[Spin | None, ...],
    rounding: Rounding | None,
    supported: Supported | None,
    probes: Probing,
    between: Sequence[tuple[WrittenFace, npt.NDArray[np.int32]]],
    accepted: bool,
) -> Variant:
    """Data recomputed from the written or perturbed numbers.

    Args:
        run: The files.
        nodes: The contact nodes.
        foundations: Those of the contact faces; None if they are unknown.
        spins: Rotation of the foundation of each contact face; None where it does not rotate.
        rounding: Perturbs the numbers; None for those as written.
        supported: Loads and supports; None if they are unknown.
        probes: The probes.
        between: Each contact face with its facets.
        accepted: Whether violations of the theory of small strains are accepted.
    """

    def taken(values: FloatArray, scale: float = 0.0) -> FloatArray:
        return values if rounding is None else rounding.of(values, scale)

    gap = taken(nodes.gap, float(np.max(np.abs(run.body.x))))
    nodes = replace(nodes, gap=gap, origin=taken(nodes.origin))
    body, spring, held = run.body, taken(run.on_body["spring_force"]), run.held
    u, x = taken(run.on_body["displacement"]), taken(run.on_face["x"])
    on_face = taken(np.where(run.touching[:, None], run.on_face["contact_force"], 0.0))
    on_body = nodes.nodal_forces(run, on_face)
    internal = body.internal_force(u)
    for part in body.parts:
        if part.elastic is None:
            internal[part.nodes] = taken(internal[part.nodes])
    judged = nodes.answer(run, u, on_face, x, spins)
    written = nodes.only(nodes.written).answer(run, u, on_face, x, spins)
    heated = {TEMPERATURE: taken(run.on_body[TEMPERATURE])} if TEMPERATURE in run.on_body else {}
    certificate = judge(
        Evidence(
            comm=MPI.COMM_SELF,
            x=body.x,
            displacement=u,
            internal=internal,
            load=run.on_body["load"],
            spring=spring,
            held=held,
            prescribed=run.on_body["prescribed"],
            on_body=on_body,
            force=judged.force,
            closure=judged.closure,
            gap=judged.gap,
            bound=judged.bound,
            rounding=_rounding(run, u),
            compliance=float(run.summary["mean_compliance"]),
            blocked=_blocked(run, heated),
            ground=run.ground,
            averaged=nodes.averaged,
            component=body.component,
            bodies=tuple(body.slices.values()),
            actions=written_actions(run, nodes, on_face),
        )
    )
    body_x = taken(body.x)
    stress = [
        _stress(part.elastic, u[part.nodes], _of(heated, part.nodes) if THERMAL & part.on_cells.keys() else {})
        for part in body.parts
    ]
    reactions = held.held_part(internal - spring - run.on_body["load"] - on_body)
    acting = None if supported is None else supported.acting(u, reactions, on_body, taken)
    probed = probes.values(u, written, run.node[nodes.index[nodes.written]], taken)
    numbers = derived(written, certificate, u, spring, held, acting)
    strain: dict[str, Any] = {"gradient": body.largest_gradient(u)}
    if foundations is None:
        outside = SmallStrain(**{**_recorded_strain(run), **strain}).violations
    else:
        samples = [face_samples(face.part.body, facets, u[face.part.nodes]) for face, facets in between]
        measured = small_strain(written, foundations, body, u, samples, _blocked(run, heated))
        outside = measured.violations
        strain = {**asdict(measured), "warnings": list(measured.warnings), "violations": list(outside)}
    if acting is None:
        numbers |= _contact_on_bodies(run, on_body, body_x)
    for check in certificate.checks:
        del numbers["certificate"][check.name.replace(" ", "_")]["meaning"]
    return Variant(
        at=Forces(u, run.on_body["load"], internal - spring, on_body),
        forces=on_face,
        fields={name: v for name, v in written.fields().items() if name in _FOLLOW} | {"slip_bound": written.bound},
        stress=stress,
        opposite=[opposite_fields(run, nodes.only(nodes.written), written, one) for one in run.opposite],
        numbers={
            **numbers,
            **{name: range_of(change, MPI.COMM_SELF) for name, change in heated.items()},
            "probes": probed,
            "small_strain": strain,
            "valid": certificate.passed and (accepted or not outside),
        },
        certificate=certificate,
        outside=() if accepted else outside,
        sums={
            "loads": _sums(taken(run.on_body["load"]), body_x, None, u),
            "reactions": _sums(reactions, body_x, run.ground, u),
        },
    )


def _sums(forces: FloatArray, x: FloatArray, ground: FloatArray | None, u: FloatArray) -> dict[str, list[float]]:
    """Force and moment of nodal forces (k, 3) at nodes x, and of springs and elastic foundations."""
    force, moment = forces.sum(axis=0), np.cross(x, forces).sum(axis=0)
    if ground is not None:
        terms = resultant_of_ground(ground, u, x, Reductions(MPI.COMM_SELF))
        force, moment = force + terms.force, moment + terms.moment
    return {"force": force.tolist(), "moment": moment.tolist()}


def _stress(body: ElasticBody | None, u: FloatArray, heated: dict[str, FloatArray]) -> dict[str, FloatArray]:
    """By name the stresses of the cells in pascals; none of a body of the user's forms."""
    found = [] if body is None else body.stresses(body.function(u), heated.get(TEMPERATURE))
    return {stress.name: stress.x.array[compat.cell_dofs(stress.function_space)[:, 0]] for stress in found}


def _contact_on_bodies(run: WrittenRun, on_body: FloatArray, x: FloatArray) -> dict[str, Any]:
    """Force and moment of the contact on each of several bodies, as in summary.json, with the balance there."""
    found, recorded = [], run.summary.get("bodies")
    for number, (name, nodes) in enumerate(run.body.slices.items()):
        sums = _sums(on_body[nodes], x[nodes], None, on_body)
        entry = {"name": name, "contact_force": sums["force"], "contact_moment": sums["moment"]}
        found.append({**entry, "balance": recorded[number]["balance"] if recorded else math.nan})
    return {"bodies": found} if found else {}


def _of(fields: dict[str, FloatArray], nodes: slice) -> dict[str, FloatArray]:
    return {name: values[nodes] for name, values in fields.items()}


def _rounding(run: WrittenRun, u: FloatArray) -> FloatArray:
    """Nodal forces of rounding errors; of bodies of the user's forms as recorded."""
    rounding = rounding_forces(run.body, u)
    for part in run.body.parts:
        if part.elastic is None:
            rounding[part.nodes] = run.on_body[ROUNDING][part.nodes]
    return rounding


def _blocked(run: WrittenRun, heated: dict[str, FloatArray]) -> float:
    """`Deformable.blocked_displacement`; where a body is of the user's forms as recorded."""
    if not run.body.elastic:
        return float(run.summary["blocked_displacement"])
    found = [
        part.elastic.thermal_displacement(change[part.nodes])
        for change in heated.values()
        for part in run.body.parts
        if part.elastic is not None and THERMAL & part.on_cells.keys()
    ]
    return max(found, default=0.0)


def _recorded_strain(run: WrittenRun) -> dict[str, float]:
    """The measures of small_strain; null becomes nan.

    Raises:
        ValueError: If summary.json lacks them.
    """
    given = run.summary.get("small_strain")
    try:
        values = {field.name: given[field.name] for field in fields(SmallStrain)}  # type: ignore[index]
        return {name: math.nan if value is None else float(value) for name, value in values.items()}
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"{run.files.summary}: has no 'small_strain' with all its measures") from None
