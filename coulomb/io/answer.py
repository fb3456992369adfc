"""What is compared of an answer for its error bars, and what the tolerance of the solver leaves of its totals.

With a residual of r, |x - P(x - w/a)| is r |x|, with a the mean diagonal of A.  The error of the force on a node is
larger by a over its own entry of the diagonal, that of all by the root mean square k of these.  k is 1 to 3 as a rule,
and hundreds where bodies of very different stiffness are in contact.

The algebraic part of a total is k r times its natural scale (`accuracy`), where r is the solver's tolerance, or its
residual if that is larger.  Of few totals more is needed.  Moments about the origin have the errors of forces times
their distance from it; centres of pressure, quotients c = M/F, the error (dM + |c| dF)/F.  A single node may have all
of the error of x: so has a largest pressure.  Areas and largest slips are uncertain by the nodes that the residual does
not tell to be open or closed, closed ones with a small force x_n, and open ones with a small gap w_n.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ..arrays import FloatArray
from ..contact_fields import named_faces, side_names
from ..fem.bodies import Deformable
from ..fem.contact import clamped_nodes
from ..fem.meshes import JoinedMesh, NamedMesh, few_chords, polygon, volume
from ..linalg.reductions import Reductions
from ..model.discrete_problem import DiscreteProblem
from ..model.heated import AGREEMENT
from ..model.nodal_answer import OPEN
from ..model.problem import ContactProblem
from ..model.solution import Solution
from ..solvers.automatic import Automatic
from .accuracy import accuracy
from .energy_error import StressOfAnswer, stress_of
from .summary import summary

UNIT_OF = {
    **dict.fromkeys(("force", "normal_force", "friction_force", "opposite_force", "contact_force", "shear"), "N"),
    **dict.fromkeys(("moment", "opposite_moment", "contact_moment", "torque", "bending", "torsion"), "N m"),
    **dict.fromkeys(("displacement", "slip", "greatest_slip", "centre_of_pressure"), "m"),
    **dict.fromkeys(("translation", "shortening"), "m"),
    **dict.fromkeys(("greatest_pressure", "pressure"), "Pa"),
    **dict.fromkeys(("dissipated_energy", "strain_energy"), "J"),
    **{"contact_area": "m²", "rotation": "rad", "power": "W"},
}
"""The totals of summary.json that have error bars, and their units."""


Totals = Mapping[str, tuple[FloatArray, str]]
"""Value (1,) or (3,) and unit of every total, by its place in summary.json."""


@dataclass(frozen=True)
class Answer:
    """What is compared of an answer.

    Attributes:
        totals: Values and units.
        algebraic: Error of every total that the tolerance of the solver leaves, in its unit, by its place.
        size: Edge of a cube with the mean volume of a cell, relative to that of the bodies: cells^(-1/3).
        order: Of the elements; the mean of those of the bodies.
        unknowns: Of the displacement.
        border: Error of the contact area from the half cells along the border of the contact, m^2.
        stress_error: By recovery, over the stress; nan where it is not known or does not decide (`even_contact`).
        single: Whether the largest displacement is that of a single node, so that it may be larger between nodes.
        seconds: That the answer took.
        stress: None where it is not known.
        energies: Strain energy of every body by its name, joules.
        missed: Of each contact face without contact, by its name, the smallest part by which the displacement would
            have to be larger to close a gap.
        nearer: The totals if the displacement at these faces were larger by a part of it; None where all have contact.
        polygon: Volume between plane facets and the smooth surface for which they stand, over that of the body, the
            largest of all bodies.
        volume: Of the bodies by the corners of their cells, m^3.
        few_chords: What to say of faces that may stand for curved ones, but have fewer than ten chords in a circle.
        chord: Of the facets in contact, over the approach (`SmallStrain.chord`).
    """

    totals: Totals
    algebraic: Mapping[str, float]
    size: float
    order: float
    unknowns: int
    border: float
    stress_error: float
    single: bool
    seconds: float
    stress: StressOfAnswer | None = None
    energies: Mapping[str, float] = field(default_factory=dict)
    missed: Mapping[str, float] = field(default_factory=dict)
    nearer: Callable[[float], Totals] | None = field(default=None, repr=False, compare=False)
    polygon: float = 0.0
    volume: float = 0.0
    few_chords: tuple[str, ...] = ()
    chord: float = 0.0


def answer_of(solution: Solution, tolerance: float) -> Answer:
    """What is compared of an answer, of a solver with this tolerance; collective."""
    problem, u, over = solution.problem, solution.displacement, Reductions(solution.problem.comm)
    contents, totals, work = _totals(solution)
    members = problem.elasticity.members
    copies = problem.elasticity.copies
    energies = {member.name: 0.5 * copies * over.sum(work[member.nodes]) for member in members}
    meshes = [NamedMesh(member.body.domain, {}) for member in members]
    cells = sum(member.body.domain.topology.index_map(3).size_global for member in members)
    closed, area = contents["nodes"]["contact"] - contents["nodes"]["open"], contents["totals"]["contact_area"]
    inside = 0 < contents["nodes"]["open"] and closed > 0
    sizes, largest = np.linalg.norm(u, axis=1), contents["maximum"]["displacement"]
    size, order = cells ** (-1.0 / 3.0), sum(member.body.degree for member in members) / len(members)
    stress = stress_of(solution, size, order)
    decides = stress is not None and even_contact(problem, contents["nodes"])
    missed, moved = _without_contact(solution)
    return Answer(
        totals=totals,
        algebraic=_algebraic(totals, contents, solution, max(tolerance, solution.result.residual)),
        size=size,
        order=order,
        unknowns=problem.unknowns["displacement"],
        border=0.5 * area * math.sqrt(math.pi / closed) if inside else 0.0,
        stress_error=stress.relative if stress is not None and decides else math.nan,
        single=over.sum(float(np.sum(sizes > (1.0 - 1e-9) * largest))) == 1.0,
        seconds=problem.seconds.get("total", sum(problem.seconds.values())),
        stress=stress,
        energies=energies,
        missed=missed,
        nearer=partial(_nearer, solution, moved, tolerance) if missed and stress is not None else None,
        polygon=max(map(polygon, meshes)),
        volume=over.sum(sum(map(volume, meshes))),
        few_chords=_few_chords(problem),
        chord=solution.small_strain.chord,
    )


def _totals(solution: Solution) -> tuple[dict[str, Any], Totals, FloatArray]:
    """The summary of an answer with its strain energy, the totals in it, and twice the strain energy by this rank's
    nodes, joules, shape (k,); collective."""
    contents, elasticity, u = summary(solution), solution.problem.elasticity, solution.displacement
    work = np.sum(elasticity.internal_force(u) * u, axis=1)
    contents["strain_energy"] = 0.5 * Reductions(elasticity.comm, elasticity.copies).sum(work)
    totals = {name: (value, unit) for name, value, unit in totals_in(contents)}
    return contents, {**totals, FREE: (largest_free(elasticity, u), "m")}, work


def _without_contact(solution: Solution) -> tuple[dict[str, float], FloatArray]:
    """Of each contact face without contact, by its name, the smallest remaining gap over the displacement there; and
    these displacements along the normal, of both bodies of a pair together, metres, shape (m,), 0 on other faces;
    collective."""
    problem, answer, over = solution.problem, solution.at_nodes, Reductions(solution.problem.comm)
    gap = problem.surface.gap - problem.relative_displacement(solution.change)[:, 0]
    moved, shares = np.zeros_like(gap), dict[str, float]()
    for member in problem.elasticity.members:
        u = np.zeros_like(solution.displacement)
        u[member.nodes] = solution.displacement[member.nodes]
        moved += np.abs(problem.surface.rows(u)[:, 0])
    for part, (name, _) in enumerate(side_names((contact.face, contact.against) for contact in problem.contacts)):
        here = answer.part == part
        if over.sum(float(np.sum(here & (answer.status != OPEN)))):
            moved[here] = 0.0
        elif over.max(moved[here]) > 0.0:
            shares[name] = over.min(gap[here] / np.maximum(moved[here], 1e-300))
    return shares, moved


def _nearer(solution: Solution, moved: FloatArray, tolerance: float, part: float) -> Totals:
    """The totals of an answer if gaps were smaller by a part of the displacements `moved` (m,) in metres; NotConverged
    if there is none; collective."""
    problem = solution.problem
    assert isinstance(problem, ContactProblem)
    surface = replace(problem.surface, gap=problem.surface.gap - part * moved)
    posed = problem.in_state(replace(problem.state, surface=surface), before=problem.before)
    posed.linear.prepare_products()
    return _totals(posed.solution(Automatic(tolerance).solve(posed.friction_problem)))[1]


def _few_chords(problem: DiscreteProblem) -> tuple[str, ...]:
    """What to say of the faces of a problem on meshes that are no boxes with `few_chords`; collective."""
    if not isinstance(problem, ContactProblem) or isinstance(mesh := problem.made_of, Deformable):
        return ()
    bodies = mesh.bodies if isinstance(mesh, JoinedMesh) else {"": mesh}
    return tuple(
        f"facets of {f'{name}:{face}' if name else face!r} meet at {math.degrees(angle):.0f} degrees: if they stand "
        f"for a curved face, with {round(math.tau / angle)} chords in a circle or so, what these are off is not in the "
        "error bars: use ten or more, or curved second-order cells"
        for name, body in bodies.items()
        if body.grid is None
        for face, angle in few_chords(body).items()
    )


def _algebraic(totals: Totals, contents: Mapping[str, Any], solution: Solution, residual: float) -> dict[str, float]:
    """Error of every total that the residual of the solver leaves, in its unit; collective."""
    heat, problem, over = contents.get("heat") or {}, solution.problem, Reductions(solution.problem.comm)
    diagonal = problem.A.diagonal()
    inverse = 1.0 / diagonal[diagonal > 1e-8 * problem.mean_compliance]  # others are known
    k = problem.mean_compliance * over.norm(inverse) / math.sqrt(over.sum(float(len(inverse))) or 1.0)
    part = k * max(residual, AGREEMENT if heat else 0.0)
    least = accuracy(contents, part)
    flows = [abs(flow["power"]) for flow in heat.get("flows", ())]
    spins = [abs(face.get("angular_velocity") or 0.0) for face in contents["faces"]]
    x = problem.elasticity.x
    least["N m"] = max(least["N m"], least["N"] * over.max(np.linalg.norm(x, axis=1)))
    least["W"] = part * max(flows, default=0.0) + least["N m"] * max(spins, default=0.0)
    narrowest = float(np.min(over.extent(x)))
    turning = (*contents.get("rigid_faces", ()), *contents.get("loaded_foundations", ()))
    turned = [float(np.max(np.abs(face["rotation"]))) for face in turning]
    least["rad"] = part * max(turned, default=0.0) + least["m"] / narrowest
    area, slip, pressure = _of_nodes(solution, part)
    least["Pa"] = max(least["Pa"], pressure)
    errors = {}
    for name, (value, unit) in totals.items():
        place, _, what = name.rpartition(".")
        if what == "centre_of_pressure":
            far = float(np.max(np.abs(value)))
            errors[name] = (least["N m"] + far * least["N"]) / float(totals[f"{place}.normal_force"][0][0])
        elif what == "contact_area":
            errors[name] = area + part * float(value[0])
        else:
            errors[name] = least[unit] + (slip if what == "greatest_slip" else 0.0)
    return errors


def _of_nodes(solution: Solution, error: float) -> tuple[float, float, float]:
    """What an error of the forces x, relative to |x|, leaves uncertain of the nodes: the area in m^2 of those that may
    be open as well as closed, by how much at most they change the largest slip of a contact face, metres, and a largest
    pressure, pascals; collective."""
    problem, answer, over = solution.problem, solution.at_nodes, Reductions(solution.problem.comm)
    gap = problem.surface.gap - problem.relative_displacement(solution.change)[:, 0]
    small = error * over.norm(solution.contact_force)
    closed = answer.status != OPEN
    either = np.where(closed, answer.force[:, 0] <= small, gap <= small * problem.mean_compliance)
    moving, slip, pressure = np.linalg.norm(answer.slip, axis=1), 0.0, 0.0
    for part in range(len(answer.faces)):
        here = answer.part == part
        most, least = (over.max(moving[here & who]) for who in (closed | either, closed & ~either))
        slip = max(slip, most - max(least, 0.0))
        most, least = (over.max(answer.pressure[here] + add / answer.area[here]) for add in (small, 0.0))
        pressure = max(pressure, most - least)
    return answer.copies * over.sum(answer.area[either]), slip, pressure


def totals_in(contents: Mapping[str, Any]) -> Iterator[tuple[str, FloatArray, str]]:
    """Place, value and unit of every total in a summary that has an error bar."""
    faces = named_faces(contents["faces"])
    for name, face in faces:
        yield from _totals_in("totals" if len(faces) == 1 else f"faces.{name}", face)
    for section in ("reactions", "ties", "rigid_faces", "bolts", "bodies", "probes", "loaded_foundations"):
        yield from _totals_in(section, contents.get(section, ()))
    yield from _totals_in("heat.flows", (contents.get("heat") or {}).get("flows", ()))
    yield from _totals_in("maximum", {"displacement": contents["maximum"]["displacement"]})
    if "strain_energy" in contents:  # in the files it is among the error bars alone
        yield "strain_energy", np.array([contents["strain_energy"]]), "J"


def _totals_in(place: str, part: Any) -> Iterator[tuple[str, FloatArray, str]]:
    if not isinstance(part, Mapping):
        for one in part:
            yield from _totals_in(f"{place}.{one.get('name') or one['face']}", one)
        return
    for name, unit in UNIT_OF.items():
        if (value := part.get(name)) is not None:
            yield f"{place}.{name}", np.atleast_1d(np.array(value, dtype=np.float64)), unit


def even_contact(problem: DiscreteProblem, nodes: Mapping[str, int]) -> bool:
    """Whether all contact points stick, or all slip, or all are open, and no node of a contact face is held along the
    normal; collective.

    Otherwise totals have errors of the order of cells along the borders of sticking, slip and contact, and along edges
    of held faces that are in contact, whose nodes are no contact points.  Not after load steps either, since slip
    before may have left borders behind.

    Args:
        nodes: Its numbers of contact points "contact", "open", "stick" and "slip".
    """
    if problem.before is not None or max(nodes["open"], nodes["stick"], nodes["slip"]) < nodes["contact"]:
        return False
    faces = [face for contact in problem.contacts for face in (contact.face, contact.against) if face is not None]
    held = 0
    for member, facets in (problem.elasticity.face(face, "contact") for face in faces):
        held += len(clamped_nodes(member.body, facets))
    return Reductions(problem.comm).sum(float(held)) == 0.0


ValueAndBar = tuple[FloatArray, FloatArray]
"""Shapes (1,)."""

LARGEST = "maximum.displacement"

FREE = "maximum.displacement of free nodes"
"""Place among the totals of what only the bar of the largest displacement is made of."""


def largest_free(elasticity: Deformable, u: FloatArray) -> FloatArray:
    """Largest displacement u (n, 3) in metres of nodes that are free along some direction, shape (1,); collective."""
    held = elasticity.held
    free = np.delete(u, held.nodes[np.trace(held.projector, axis1=1, axis2=2) > 2.5], axis=0)
    largest = Reductions(elasticity.comm).max(np.linalg.norm(free, axis=1))
    return np.array([max(largest, 0.0)])


def least_bar(value: FloatArray, energy: ValueAndBar, free: ValueAndBar, single: bool, safety: float) -> FloatArray:
    """The least bar of the largest displacement, shape (1,).

    Where a single node has the largest displacement, it may be between nodes that all meshes share: their difference is
    then 0.  The strain energy is that of the loads on their displacements (Clapeyron), so that these have errors as it
    has: its relative bar.  Where a prescribed displacement is the largest, all meshes agree on it as well, but free
    nodes may have more on finer ones: by (bar/safety) - (prescribed - free), extrapolated, times the safety factor, and
    at most that bar.

    Args:
        value: The largest displacement.
        energy: The strain energy and its bar.
        free: The largest displacement of free nodes and its bar.
        single: Whether a single node has the largest displacement.
        safety: The factor in all bars.
    """
    if not energy[0][0] > 0.0:
        return np.zeros(1)
    least: FloatArray = value * np.minimum(1.0, energy[1] / energy[0])
    return least if single else np.clip(free[1] - safety * (value - free[0]), 0.0, least)
