"""A block pulled along a plane until it slides, and back: friction is exactly F times the normal force.

A cube of steel of 1 m on a rigid plane: its top, held flat, is pressed down by 0.2 mm, then moved to the right
by s(t), and back.  Friction grows while the block shears, until all nodes slip in the same direction; from then on, by
Coulomb's law summed over the nodes,

    T = -F N sign(ds/dt)

on any mesh.  Sliding by ds dissipates F N ds.  After the reversal the block sticks at first, and the force decreases
with the stiffness of a block bonded to the plane; sliding back is the mirror image of sliding forth.

The slip of a step is multiplied by the mean of friction at both ends, but where a node begins to slip within it, or to
touch: then by that of the end, and over n steps the error of the dissipated energy decreases at least like 1/n.
Pressing alone is proportional loading: slip and friction grow together, all but the first of n steps are exact, and the
energy imbalance is 1/n^2 of that of one step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Elasticity, Material, PrescribedDisplacement
from coulomb.fem.meshes import box
from coulomb.linalg.compliance import DirectSolver
from coulomb.model.contact import Contact
from coulomb.model.load_history import LoadHistory
from coulomb.model.load_step import LoadStep
from coulomb.model.problem import ContactProblem

from .table import Curve, Panel, Row, Verified, at_least, order, relative

STEEL = Material(young=2.1e11, poisson=0.3)
FRICTION, DOWN = 0.3, 2e-4
COHESION, ACROSS = 2e7, (0.3, 0.1)
CELLS = (6, 6, 6)
RESIDUAL = 1e-10

SHEARED, RIGHT, RETURNED, LEFT = 2.0, 7.0, 8.0, 13.0
"""Times at which the top has moved 0.5 mm; slid 20 mm; moved back 0.5 mm; slid back 20 mm."""

WAY = ((0.0, 0.0), (1.0, 0.0), (SHEARED, 5e-4), (RIGHT, 20.5e-3), (RETURNED, 20e-3), (LEFT, 0.0))
"""Displacement of the top along x in metres."""


def problem(contact: Contact | None = None) -> ContactProblem:
    """The block: pressed down until t = 1, moved to the right until t = 7, then to the left.

    Args:
        contact: Of its base; by default with Coulomb friction.
    """
    return ContactProblem(
        box((1.0, 1.0, 1.0), CELLS),
        STEEL,
        [
            PrescribedDisplacement("top", (0.0, 0.0, -DOWN), "z", amplitude=((0.0, 0.0), (1.0, 1.0))),
            PrescribedDisplacement("top", (1.0, 0.0, 0.0), "xy", amplitude=WAY),
        ],
        contact or Contact("bottom", FRICTION),
    )


def other_laws() -> list[Row]:
    """Steady sliding to the right with cohesion, T = c A + F N; and with orthotropic friction.

    The axes of the latter are at 45 degrees to the direction of sliding.  By the associated rule (`FrictionAxes`) the
    components of T along them are as F1^2 to F2^2, so that T_y/T_x = (F1^2 - F2^2)/(F1^2 + F2^2).
    """

    def steady(contact: Contact) -> tuple[FloatArray, float, str]:
        """Force of the plane on the block, its relative change in the last step, and the reason of the tolerance."""
        *_, before, last = LoadHistory([1.0, *np.arange(SHEARED, RIGHT + 1.0)], tolerance=RESIDUAL).steps(
            problem(contact)
        )
        now, then = (np.array(step.solution.at_nodes.totals()["force"]) for step in (last, before))
        change = float(np.max(np.abs(now - then)) / np.linalg.norm(now[:2]))
        return now, change, f"exact on any mesh once sliding is steady; the change of the last step is {change:.1g}"

    (F1, F2), known = ACROSS, (ACROSS[0] ** 2 - ACROSS[1] ** 2) / (ACROSS[0] ** 2 + ACROSS[1] ** 2)
    total, change, why = steady(Contact("bottom", FRICTION, cohesion=COHESION))
    cohesive = total[0] / (COHESION * 1.0 + FRICTION * total[2])
    oblique, turned, reason = steady(Contact("bottom", (F1, F2), direction=(1.0, 1.0, 0.0)))
    return [
        relative("with cohesion, sliding right: T/(c A + F N)", -1.0, cohesive, RESIDUAL + change, why),
        relative(
            "orthotropic, axes at 45 degrees: T_y/T_x", known, oblique[1] / oblique[0], RESIDUAL + 2.0 * turned, reason
        ),
    ]


def bonded_stiffness() -> float:
    """Force on the top along x per metre of displacement with a bonded base, N/m, from linear elasticity."""
    body = Elasticity(
        box((1.0, 1.0, 1.0), CELLS),
        STEEL,
        [Clamp("bottom"), Clamp("top", "yz"), PrescribedDisplacement("top", (1.0, 0.0, 0.0), "x")],
    )
    u = body.K.createVecRight()
    DirectSolver(body.K).solve(body.f(body.at(0.0)), u)
    return float(body.internal_force(u.array.reshape(-1, 3))[body.nodes("top", "reaction"), 0].sum())


def verify() -> Verified:
    """The whole history, and its beginning with increasing numbers of steps."""
    block = problem()
    times = [
        *(1.0 + k / 10 for k in range(11)),
        *(SHEARED + k for k in range(1, 6)),
        *(RIGHT + k / 10 for k in range(1, 11)),
        *(RETURNED + k for k in range(1, 6)),
    ]
    steps = list(LoadHistory(times, tolerance=RESIDUAL).steps(block))
    at = dict(zip(times, steps, strict=True))
    right, left, before, turned = at[RIGHT], at[LEFT], at[RIGHT - 1.0], at[RIGHT + 0.1]
    T, N = force(right)
    bonded = bonded_stiffness()
    slid, retreat = travel(RIGHT) - travel(RIGHT - 1.0), travel(RIGHT) - travel(RIGHT + 0.1)

    change = max(_off(left, at[LEFT - 1.0]), _off(right, before))
    steady = (
        "exact on any mesh once sliding is steady: the residual 1e-10, and the change of T and N in the last of five "
        f"steps of 4 mm, {change:.1g}"
    )
    fall = force(turned)[0] - T
    stuck = "all nodes stick in that step: a linear problem; two forces T to the residual 1e-10, over their difference"
    pressing = [_last(block, [k / n for k in range(1, n + 1)]) for n in (1, 8)]
    press = [abs(last.state.energy.imbalance) for last in pressing]
    reached = sum(last.solution.result.residual / part for last, part in zip(pressing, press, strict=True))
    parts = np.array([4, 8, 16, 32])
    shear = np.array([_imbalance_of_shearing(block, n) for n in parts])

    def done(name: str) -> float:
        now, then = right.state.energy, before.state.energy
        return float(getattr(now, name) - getattr(then, name))

    rows = (
        relative("sliding right: T/(F N)", -1.0, T / (FRICTION * N), RESIDUAL + change, steady),
        relative("sliding left: T/(F N)", 1.0, _ratio(left), RESIDUAL + change, steady),
        relative(
            "sliding left: N over N of sliding right",
            1.0,
            force(left)[1] / N,
            RESIDUAL + change,
            "mirror images; " + steady,
        ),
        relative("reversed by 0.05 mm: dT/ds, N/m", bonded, fall / retreat, 2.0 * RESIDUAL * abs(T / fall), stuck),
        relative(
            "4 mm of sliding: dissipated F N ds, J", FRICTION * N * slid, done("dissipated"), RESIDUAL + change, steady
        ),
        relative(
            "4 mm of sliding: work of the clamp F N ds, J",
            FRICTION * N * slid,
            done("prescribed"),
            RESIDUAL + change,
            steady,
        ),
        relative(
            "pressing: energy imbalance of 1 step over that of 8",
            64.0,
            press[0] / press[1],
            reached * pressing[0].state.energy.elastic,
            "proportional loading: exact up to the last residuals over the imbalance's share of the energy",
        ),
        at_least(
            "shearing: order of the energy imbalance in the step",
            1.0,
            order(1.0 / parts, shear),
            0.0,
            "of nodes that begin to slip within a step: first order; higher if few do",
        ),
        *other_laws(),
    )
    return Verified(rows, _panels(times, steps, bonded, parts, shear))


def travel(time: float) -> float:
    """Displacement of the top along x, metres."""
    return float(np.interp(time, *np.transpose(WAY)))


def force(step: LoadStep) -> tuple[float, float]:
    """Forces T and N of the plane on the block along x and z, newtons."""
    total = step.solution.at_nodes.totals()["force"]
    return total[0], total[2]


def _off(step: LoadStep, then: LoadStep) -> float:
    """Largest relative difference of T and N between two steps."""
    return max(abs(now / before - 1.0) for now, before in zip(force(step), force(then), strict=True))


def _ratio(step: LoadStep) -> float:
    T, N = force(step)
    return T / (FRICTION * N)


def _last(block: ContactProblem, times: Sequence[float]) -> LoadStep:
    *_, last = LoadHistory(times, tolerance=RESIDUAL).steps(block)
    return last


def _imbalance_of_shearing(block: ContactProblem, n: int) -> float:
    """Energy imbalance between t = 1 and 2 in n steps, joules."""
    first, *_, last = LoadHistory([1.0 + k / n for k in range(n + 1)], tolerance=RESIDUAL).steps(block)
    return abs(last.state.energy.imbalance - first.state.energy.imbalance)


def _panels(
    times: Sequence[float], steps: Sequence[LoadStep], bonded: float, parts: FloatArray, shear: FloatArray
) -> tuple[Panel, ...]:
    positions, ratios = np.array([travel(t) for t in times]), np.array([_ratio(step) for step in steps])
    reversed_at = times.index(RIGHT)
    _, N = force(steps[reversed_at])
    full = np.array([0.0, travel(RIGHT)])
    rise = 2.0 * FRICTION * N / bonded
    loop = (
        Curve("sliding: -F N, F N", full, np.array([-1.0, -1.0]), formula=True),
        Curve("", full, np.array([1.0, 1.0]), formula=True),
    )
    bond = Curve("bonded base", travel(RIGHT) - np.array([0.0, rise]), np.array([-1.0, 1.0]), formula=True)
    near = positions > travel(RIGHT) - 6e-4
    near[:reversed_at] = False
    return (
        Panel(
            "to the right, and back",
            "displacement of the top, mm",
            "T / (F N)",
            _scaled((*loop, Curve("coulomb", positions, ratios))),
        ),
        Panel(
            "the reversal",
            "displacement of the top, mm",
            "T / (F N)",
            _scaled((bond, Curve("coulomb", positions[near], ratios[near]))),
        ),
        Panel(
            "energy imbalance of shearing",
            "steps",
            "imbalance, J",
            (
                Curve("first order", parts, shear[0] * parts[0] / parts, formula=True),
                Curve("coulomb", parts, shear),
            ),
            logarithmic=True,
        ),
    )


def _scaled(curves: Sequence[Curve]) -> tuple[Curve, ...]:
    """With x in millimetres."""
    return tuple(replace(curve, x=1e3 * curve.x) for curve in curves)
