"""The inputs of an answer, by their names, and what each of them changes in the problem."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import End, HyperelasticBody, Loading, ThermalLoad, nonlinear
from ..linalg.reductions import Reductions
from .discrete_problem import DiscreteProblem
from .heat_derivatives import HeatInput
from .sensitivity_totals import Changed


@dataclass(frozen=True, eq=False)
class Input:
    """The change of a problem along the logarithm of an input: bounds of friction in newtons (m,), gaps and the
    displacements from which slip counts in metres (m, 3), and loads and prescribed displacements, where they change;
    of the stiffness of a spring its number, beside its forces as loads, and of a modulus or a temperature what it does
    to the energy of a body; loads along free motions, newtons, (q,); and the factors of the motions of foundations,
    shape (faces,)."""

    bound: FloatArray | float = 0.0
    c: FloatArray | float = 0.0
    loading: Loading | None = None
    spring: int | None = None
    energy: tuple[int, float] | None = None
    e: FloatArray | float = 0.0
    motions: FloatArray | None = None
    changed: Changed | None = None
    heat: HeatInput | None = None


def unloaded(loading: Loading) -> Loading:
    """Without loads, prescribed displacements and forces of bolts."""
    none = None if loading.tension is None else np.zeros_like(loading.tension)
    still = np.zeros_like(loading.load)
    return replace(loading, load=still, prescribed=still, tension=none, apart=0.0)


def _prescribed(problem: DiscreteProblem, still: Loading) -> Loading:
    """What prescribed displacements do by their common factor, from the place after the step before; collective."""
    body, before = problem.elasticity, problem.before
    if problem.body.undeformed is not None:
        start = None if before is None else before.time
        each = [nonlinear(member.body).prescribed_rate(start) for member in body.members]
        apart = body.constraints.apart_rate(problem.time)
        return replace(still, prescribed=body.reduction.led(np.concatenate(each), apart), apart=apart)
    rest = None if before is None else End(before.time, np.zeros_like(body.x))
    given = problem.loading if rest is None else body.after(problem.time, rest)
    return replace(still, prescribed=given.prescribed, apart=given.apart)


def inputs_of(problem: DiscreteProblem, x: FloatArray, u: FloatArray, gap: FloatArray) -> dict[str, Input]:
    """Every input with the change of the problem along its logarithm; a name that occurs again has a number."""
    surface, loading, body, over = problem.surface, problem.loading, problem.elasticity, Reductions(problem.comm)
    inputs: dict[str, Input] = {}

    def put(name: str, one: Input) -> None:
        there = sum(known == name or known.startswith(f"{name} (") for known in inputs)
        inputs[f"{name} ({there + 1})" if there else name] = one

    parts, bounds = [surface.part == part for part in range(len(surface.faces))], problem.law.parts(x[0::3])
    for face, here, contact in zip(surface.faces, parts, problem.contacts, strict=True):
        for name, bound in bounds.items():
            if over.any(bool(np.any(bound[here] > 0.0))):
                alone = name == "cohesion" and contact.slip_stress is not None
                put(f"{'slip stress' if alone else name} of {face!r}", Input(bound=np.where(here, bound, 0.0)))
    for face, here in zip(surface.faces, parts, strict=True):
        if over.any(bool(np.any(gap[here] != 0.0))):
            put(f"gap of {face!r}", Input(c=np.where(here, gap, 0.0)[:, None] * [1.0, 0.0, 0.0]))
    times = (problem.time,) if problem.before is None else (problem.time, problem.before.time)
    motions = zip(*(problem.body.foundation_motions(time) for time in times), strict=True)
    for number, (face, moved) in enumerate(zip(surface.faces, motions, strict=True)):
        if any(np.any(one.translation) or one.angle for one in moved):
            put(f"motion of the foundation of {face!r}", Input(motions=np.eye(len(surface.faces))[number]))
    first = 0
    for one in problem.state.loaded:
        e = np.zeros(0 if problem.rigid is None else problem.rigid.count)
        e[first : first + len(one.load)] = one.load
        first += len(one.load)
        if np.any(e):
            put(f"load on the foundation of {surface.faces[one.number]!r}", Input(e=e))
    still = unloaded(loading)
    for load in body.loads_in(loading):
        thermal = load.kind == ThermalLoad.kind
        if thermal and problem.body.heat is not None:  # it follows from what heats
            continue
        where = "" if load.face is None else f" {'of' if thermal else 'on'} {load.face!r}"
        what = "temperature change" if thermal else load.kind.replace("_", " ")
        put(f"{what}{where}", Input(loading=replace(still, load=load.forces)))
    given = _prescribed(problem, still)
    if over.any(bool(np.any(given.prescribed) or np.any(given.apart))):
        put("prescribed displacements", Input(loading=given))
    for bolt, own in body.constraints.of_bolts:
        if loading.tension is not None and loading.tension[own]:
            tension = np.zeros_like(loading.tension)
            tension[own] = loading.tension[own]
            put(f"pretension of {bolt.face!r}", Input(loading=replace(still, tension=tension)))
    for number, spring in enumerate(body.spring_forces(u)):
        place = "" if spring.face is None else f" on {spring.face!r}"
        put(f"stiffness of the spring{place}", Input(loading=replace(still, load=spring.forces), spring=number))
    for number, (member, part) in enumerate(zip(body.members, loading.parts or [loading], strict=True)):
        if member.body.materials is None:
            continue
        of = f" of {member.name!r}" if member.name else ""
        forces = np.zeros_like(body.x)
        if isinstance(member.body, HyperelasticBody) and part.temperature is not None:
            heat = forces.copy()
            heat[member.nodes], energy = member.body.thermal_rates()
            put(f"temperature change{of}", Input(loading=replace(still, load=heat), energy=(number, energy)))
        # strain energies are in proportion to their moduli
        forces[member.nodes] = -member.body.strain_force(u[member.nodes])
        if not member.body.large:
            forces[member.nodes] += sum(
                one.forces for one in member.body.loads_in(part) if one.kind == ThermalLoad.kind
            )
        energy = member.body.strain_energy(u[member.nodes]) or 0.0
        put(f"young{of}", Input(loading=replace(still, load=forces), energy=(number, energy)))
    return inputs
