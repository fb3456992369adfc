"""Synthetic evidence: exact, of known scales; and functions that put one error of a given size into it."""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from coulomb.fem.bodies.constraints import HeldDirections
from coulomb.fem.bodies.rigid_modes import rigid_modes
from coulomb.model.certificate import LIMIT, Evidence

U, F = 3e-4, 2e3
"""Scales of displacements in metres and of contact forces in newtons."""

FRICTION, CONTACT, PRESSING, STICKING, BODY = 0.4, 100, 80, 40, 160
"""Nodes 0 to 39 stick, 40 to 79 slip, 80 to 99 are open; 100 to 159 are elsewhere in the body."""

STICK, SLIP, OPEN = 5, 45, 85
"""One of each."""


def synthetic_evidence(clamped="yz", stiffness=50.0, sway=1.0):
    """Evidence of an answer without an error.

    Args:
        clamped: Components that are prescribed at three nodes.
        stiffness: Of springs along x (and along y, where that is not clamped), N/m.
        sway: Displacement of the springs along x, over U.
    """
    rng = np.random.default_rng(1)
    x = rng.uniform(0.0, 1.0, (BODY, 3)) * (3.0, 1.0, 1.0)
    x[:CONTACT, 2] = 0.0
    force, relative_displacement, gap = np.zeros((CONTACT, 3)), np.zeros((CONTACT, 3)), np.zeros(CONTACT)
    force[:PRESSING, 0] = rng.uniform(0.3, 0.9, PRESSING) * F
    force[[STICK, SLIP, SLIP + 1], 0] = F  # the largest
    bound = FRICTION * force[:, 0]
    angle = rng.uniform(0.0, 2.0 * np.pi, CONTACT)
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    force[:PRESSING, 1:] = bound[:PRESSING, None] * along[:PRESSING]
    force[:STICKING, 1:] *= 0.5
    relative_displacement[STICKING:PRESSING, 1:] = U * rng.uniform(0.5, 2.0, (STICKING, 1)) * along[STICKING:PRESSING]
    gap[PRESSING:] = rng.uniform(0.1, 4.0, CONTACT - PRESSING) * U

    on_body, load = np.zeros((2, BODY, 3))
    on_body[:CONTACT] = np.column_stack([-force[:, 1:], force[:, 0]])
    load[CONTACT:150] = rng.uniform(-1.0, 1.0, (50, 3)) * F
    load[150, 2] = -100.0 * F  # a single large force: |sum| and norm differ
    spring, displacement = np.zeros((2, BODY, 3))
    soft = "xy" if "y" not in clamped else "x"
    for c in map("xyz".index, soft):
        spring[110:120, c] = stiffness
        displacement[110:120, c] = -sway * U * rng.uniform(0.9, 1.1, 10)
    outer = load + on_body - spring * displacement
    fixed = np.zeros((BODY, 3), dtype=bool)
    for c in map("xyz".index, clamped):
        fixed[155:158, c] = True
    load += balancing(x, outer, fixed)
    internal = load + on_body - spring * displacement
    reaction = np.where(fixed, load, 0.0)
    load[fixed] = 0.0
    parts = (load, -spring * displacement, reaction, on_body)
    turnover = sum(np.linalg.norm(part, axis=1).sum() for part in parts)
    free = spring == 0.0
    rest = U * turnover - 2.0 * np.vdot(displacement, internal)  # of twice the elastic energy
    displacement[free] = 0.5 * rest * internal[free] / np.vdot(internal[free], internal[free])
    return Evidence(
        comm=MPI.COMM_SELF,
        x=x,
        displacement=displacement,
        internal=internal,
        load=load,
        spring=-spring * displacement,
        ground=spring[:, :, None] * rigid_modes(x, MPI.COMM_SELF),
        held=HeldDirections.of_fields(1.0 * fixed, None),
        prescribed=np.where(fixed, displacement, 0.0),
        on_body=on_body,
        force=force,
        relative_displacement=relative_displacement,
        gap=gap,
        bound=bound,
        rounding=np.zeros((BODY, 3)),
        stiffness=np.full(CONTACT, F / U),
        compliance=np.full((CONTACT, 3), U / F),
        component=np.zeros(BODY, dtype=np.int64),
        owner=np.zeros(CONTACT, dtype=np.int64),
        place=np.zeros((CONTACT, 3)),
        part=np.zeros(CONTACT, dtype=np.int64),
    ), turnover


def balancing(x, outer, fixed):
    """The smallest forces at fixed components, and at nodes 150 to 154, with which all add to zero, moments too."""
    can = fixed.copy()
    can[150:155] = True
    columns = np.flatnonzero(can.ravel())
    unit = np.zeros((len(columns), BODY, 3))
    unit.reshape(len(columns), -1)[np.arange(len(columns)), columns] = 1.0
    sums = [np.concatenate([part.sum(axis=0), np.cross(x, part).sum(axis=0)]) for part in (*unit, outer)]
    forces = np.zeros(BODY * 3)
    forces[columns] = np.linalg.lstsq(np.array(sums[:-1]).T, -sums[-1], rcond=None)[0]
    return forces.reshape(BODY, 3)


def failed(certificate):
    return {check.name for check in certificate.checks if not check.passed}


def changed(array, index, value):
    array = array.copy()
    array[index] = value
    return array


# Each takes evidence and a value, and returns evidence in which that is the value of one condition.


def out_of_balance_at_a_node(e, value, turnover):
    nodal = max(np.linalg.norm(part) for part in (e.internal, e.load, e.on_body))
    return replace(e, load=changed(e.load, (120, 2), e.load[120, 2] + value * nodal))


def clamp_given_way(e, value, turnover):
    return replace(e, prescribed=changed(e.prescribed, (156, 2), e.prescribed[156, 2] - value * U))


def net_force(e, value, turnover, component=2):
    """Distributed over the free nodes, so that it is small at each."""
    load = e.load.copy()
    load[CONTACT:150, component] += value * turnover / 50
    return replace(e, load=load)


def net_moment(e, value, turnover):
    """A couple about z: many small forces along y, of opposite signs on the two sides of the middle."""
    r = e.x - e.x.mean(axis=0)
    size = np.sqrt(np.mean(np.sum(r**2, axis=1)))
    some = r[CONTACT:150, 0] - r[CONTACT:150, 0].mean()
    load = e.load.copy()
    load[CONTACT:150, 1] += value * turnover * size * some / np.sum(some**2)
    return replace(e, load=load)


def drift_along_springs(e, value, turnover):
    carried = np.abs(e.spring)[:, 0].sum()
    at_scale = e.ground[:, 0, 0].sum() * U
    return replace(e, load=changed(e.load, (120, 0), e.load[120, 0] + value * max(carried, at_scale)))


def turn_on_springs(e, value, turnover):
    """A couple about z, against springs along x and y."""
    held = e.held.components
    assert held.any() and not held[:, :2].any()
    modes = np.zeros((BODY, 3, 3))
    r = e.x - e.x.mean(axis=0)
    modes[:, 0, 0] = modes[:, 1, 1] = 1.0
    modes[:, 0, 2], modes[:, 1, 2] = -r[:, 1], r[:, 0]
    of_nodes = np.einsum("kcc->kc", e.ground[:, :, :3])
    stiffness = np.einsum("kci,kc,kcj->ij", modes, of_nodes, modes)
    stiff, vectors = np.linalg.eigh(stiffness)
    turn = modes @ vectors[:, 0]
    carried = np.sum(np.abs(turn) * np.abs(e.spring))
    load = e.load + value * max(carried, stiff[0] * U) * against(modes @ vectors, 0)
    return replace(e, load=load)


def against(motions, number):
    """Forces along x and y that do the work 1 on one of some motions and none on the others."""
    flat = motions.reshape(-1, 3)
    return np.linalg.pinv(flat)[number].reshape(BODY, 3)


def penetrating(e, value, turnover):
    return replace(e, gap=changed(e.gap, OPEN, -value * U))


def pulled(e, value, turnover):
    return replace(e, gap=changed(e.gap, OPEN, 0.0), force=changed(e.force, (OPEN, 0), -value * F))


def pressed_across_a_gap(e, value, turnover):
    return replace(e, gap=changed(e.gap, STICK, value * U))


def pressed_across_a_wide_gap(e, value, turnover):
    return replace(e, gap=changed(e.gap, OPEN, 20 * U), force=changed(e.force, (OPEN, 0), value * F / 20))


def pulled_across_a_wide_gap(e, value, turnover):
    return replace(e, gap=changed(e.gap, OPEN, 20 * U), force=changed(e.force, (OPEN, 0), -value * F / 20))


def beyond_the_cone(e, value, turnover):
    t = e.force[SLIP, 1:]
    more = t * (1.0 + value * e.bound.max() / np.linalg.norm(t))
    return replace(e, force=changed(e.force, (SLIP, slice(1, 3)), more))


def friction_without_a_bound(e, value, turnover):
    """No friction is allowed: it is compared with a thousandth of the forces."""
    force = e.force.copy()
    force[:, 1:] = 0.0
    force[STICK, 1] = value * 1e-3 * F
    return replace(e, force=force, bound=np.zeros(CONTACT))


def early_slip(e, value, turnover, direction=(0.6, 0.8)):
    """At a node whose friction is half of the largest bound."""
    return replace(
        e,
        relative_displacement=changed(
            e.relative_displacement, (STICK, slice(1, 3)), 2.0 * value * U * np.array(direction)
        ),
    )


def turned_slip(e, value, turnover, sign=1.0, length=1.0):
    a, t = sign * np.radians(value), e.force[SLIP, 1:] / np.linalg.norm(e.force[SLIP, 1:])
    turned = np.array([t[0] * np.cos(a) - t[1] * np.sin(a), t[0] * np.sin(a) + t[1] * np.cos(a)])
    return replace(
        e,
        relative_displacement=changed(e.relative_displacement, (SLIP, slice(1, 3)), length * U * turned),
        compliance=1e3 * e.compliance,
    )


def turned_the_other_way(e, value, turnover):
    return turned_slip(e, value, turnover, -1.0)


def turned_short_slip(e, value, turnover):
    return turned_slip(e, value, turnover, length=1.01e-3)


def turned_small_friction(e, value, turnover):
    """Friction a little above a hundredth of the largest."""
    small = 1.01e-2 * FRICTION * F
    t = e.force[SLIP, 1:] / np.linalg.norm(e.force[SLIP, 1:])
    e = turned_slip(e, value, turnover)
    force = changed(e.force, (SLIP, slice(1, 3)), small * t)
    return replace(e, force=force, bound=changed(e.bound, SLIP, small))


def off_where_stiff(e, value, turnover):
    """A node off by half of the limit of displacements, where A is stiff: by its own force that is more."""
    distance = 0.5 * LIMIT * U
    own = distance / (value * np.linalg.norm(e.force[STICK]))
    return replace(e, gap=changed(e.gap, STICK, distance), compliance=changed(e.compliance, STICK, own))


CASES = [
    ("equilibrium", out_of_balance_at_a_node, {}),
    ("clamps", clamp_given_way, {}),
    ("force balance", net_force, {}),
    ("force balance", lambda e, v, t: net_force(e, -v, t, 0), {"clamped": "xyz"}),
    ("force balance", lambda e, v, t: net_force(e, v, t, 1), {}),
    ("force balance", net_moment, {}),
    ("rigid motion", drift_along_springs, {}),
    ("rigid motion", drift_along_springs, {"sway": 30.0}),
    ("rigid motion", drift_along_springs, {"sway": 1e-3}),
    ("rigid motion", turn_on_springs, {"clamped": "z"}),
    ("penetration", penetrating, {}),
    ("adhesion", pulled, {}),
    ("complementarity", pressed_across_a_gap, {}),
    ("complementarity", pressed_across_a_wide_gap, {}),
    ("complementarity", pulled_across_a_wide_gap, {}),
    ("friction cone", beyond_the_cone, {}),
    ("friction cone", friction_without_a_bound, {}),
    ("slip inside the cone", early_slip, {}),
    ("slip inside the cone", lambda e, v, t: early_slip(e, v, t, (-1.0, 0.0)), {}),
    ("slip angle", turned_slip, {}),
    ("slip angle", turned_the_other_way, {}),
    ("slip angle", turned_short_slip, {}),
    ("slip angle", turned_small_friction, {}),
    ("natural residual", off_where_stiff, {}),
]
