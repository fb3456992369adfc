"""A stack of five blocks that friction alone holds, pulled sideways: Coulomb's formula for every interface.

The blocks lie on each other, and the lowest on a rigid plane; no clamp, no spring.  The weights of the blocks and a
force on the top press the interface below block k with N_k.  A horizontal pull T on block j is carried by all
interfaces below it.  The largest is

    T = min over k <= j of F_k N_k

and the stack slides in the interface of the minimum alone: it is predicted.  Below this limit the elastic stack is in
equilibrium, and every interface below block j carries T, those above nothing, on any meshes: the blocks are of
hexahedra and tetrahedra that do not match.  Beyond it there is no equilibrium, and the problem is refused.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Material, TotalForce, join
from coulomb.fem.meshes import box, moved
from coulomb.linalg.reductions import Reductions
from coulomb.model.contact import Contact
from coulomb.model.equilibrium import NoEquilibrium, along_foundations
from coulomb.model.problem import ContactProblem
from coulomb.solvers.equilibrium import LimitLoad

from .table import Curve, Panel, Row, Verified, absolute, relative

STEEL = Material(young=2.1e11, poisson=0.3, density=7850.0)
HEIGHT, GRAVITY, PRESSING = 0.2, 9.81, 3000.0
"""Height of a block of 1 m^2 in metres, m/s^2, and the force on the top in newtons."""

FRICTION = (0.2, 0.28, 0.3, 0.5, 0.6)
"""Below each block, from the floor up: the limits are at the interfaces 1, 2, 2, 4 and 5 for a pull on block 1 to 5."""

CELLS = (((3, 2, 1), "hexahedron"), ((4, 3, 2), "tetrahedron"), ((2, 2, 2), "hexahedron"))
"""Of the blocks, in turn."""

PULLED = (5, 4, 3, 1)
"""The blocks that are pulled, one after the other."""


def normal_forces() -> FloatArray:
    """N_k below every block, newtons, shape (5,)."""
    weight = STEEL.density * GRAVITY * HEIGHT if STEEL.density is not None else 0.0
    return PRESSING + weight * np.arange(len(FRICTION), 0, -1)


def limits(block: int) -> FloatArray:
    """F_k N_k of the interfaces that carry a pull on a block, newtons, shape (block,)."""
    carried: FloatArray = (np.array(FRICTION) * normal_forces())[:block]
    return carried


def problem(block: int, pull: float) -> ContactProblem:
    """The stack with a pull in newtons on a block, 1 to 5, at its lower edge."""
    blocks = {}
    for number in range(len(FRICTION)):
        cells, kind = CELLS[number % len(CELLS)]
        blocks[f"b{number + 1}"] = moved(box((1.0, 1.0, HEIGHT), cells, kind), translate=(0, 0, HEIGHT * number))
    contacts = [Contact("b1:bottom", FRICTION[0])]
    contacts += [Contact(f"b{k}:bottom", FRICTION[k - 1], against=f"b{k - 1}:top") for k in range(2, len(FRICTION) + 1)]
    pressed = TotalForce(f"b{len(FRICTION)}:top", (0.0, 0.0, -PRESSING))
    pulled = TotalForce(f"b{block}:right", (pull, 0.0, 0.0))
    return ContactProblem(join(**blocks), STEEL, [], contacts, [pressed, pulled], gravity=(0.0, 0.0, -GRAVITY))


def shears(block: int, pull: float) -> tuple[FloatArray, FloatArray]:
    """Friction along x and normal force of every interface of the stack in equilibrium, newtons, shapes (5,)."""
    solution = problem(block, pull).solve(tolerance=1e-10)
    assert solution.valid
    parts = [solution.at_nodes.totals(part)["force"] for part in range(len(FRICTION))]
    return np.array([abs(force[0]) for force in parts]), np.array([abs(force[2]) for force in parts])


def slipping(stack: ContactProblem, motion: FloatArray) -> FloatArray:
    """Mean slip of every interface in a motion of the bodies (q,), relative to the largest, shape (5,)."""
    assert stack.rigid is not None
    moved_by = stack.rigid.displacement(motion).reshape(-1, 3)
    slip, part = np.hypot(moved_by[:, 1], moved_by[:, 2]), stack.surface.part
    means = np.array([slip[part == number].mean() for number in range(len(FRICTION))])
    relative_slips: FloatArray = means / means.max()
    return relative_slips


def refused(stack: ContactProblem) -> bool:
    """Whether the problem is refused for want of an equilibrium."""
    try:
        stack.solve()
    except NoEquilibrium:
        return True
    return False


def verify(pulled: Sequence[int] = PULLED) -> Verified:
    """Limits and sliding interfaces for several pulled blocks; the stack in equilibrium just below."""
    rows: list[Row] = []
    curves: list[Curve] = []
    numbers, N = np.arange(1.0, len(FRICTION) + 1.0), normal_forces()
    for block in pulled:
        largest, expected = float(limits(block).min()), int(np.argmin(limits(block))) + 1
        stack = problem(block, 1.001 * largest)
        assert stack.rigid is not None
        limit = LimitLoad(stack.rigid, stack.law, Reductions(stack.comm))
        motion, part = limit.unbalanced(), limit.held_part(along_foundations(stack.rigid, limit.over))
        assert motion is not None and part is not None
        slips = slipping(stack, motion)
        rows.append(
            relative(
                f"block {block} pulled: largest pull, N",
                *(largest, 1.001 * largest * part, 1e-6, "exact, beside the rounding of linear programmes"),
            )
        )
        others = np.delete(slips, int(np.argmax(slips)))
        rows.append(
            absolute(
                f"block {block} pulled: interface that slides",
                *(expected, float(np.argmax(slips)) + 1.0, 0.0, "predicted by Coulomb's formula"),
            )
        )
        rows.append(
            absolute(f"block {block} pulled: slip of the others", 0.0, float(others.max()), 1e-3, "none slides")
        )
    for block in pulled[:2]:
        pull = 0.95 * float(limits(block).min())
        friction, normal = shears(block, pull)
        carried = np.where(numbers <= block, pull, 0.0)
        wrong = float(np.max([np.abs(friction - carried), np.abs(normal - N)])) / float(N.max())
        rows.append(
            absolute(
                f"block {block} pulled by 0.95 of it: forces of all interfaces, error over the largest",
                *(0.0, wrong, 1e-8, "equilibrium of every block, on any meshes; residual 1e-10"),
            )
        )
        curves.append(Curve(f"T below block {block}", numbers, carried, formula=True))
        curves.append(Curve(f"computed, block {block} pulled", numbers, friction, line=False))
    beyond = refused(problem(5, 1.01 * float(limits(5).min())))
    rows.append(absolute("pulled by 1.01 of it: refused", 1.0, float(beyond), 0.0, "there is no equilibrium"))
    curves.append(Curve("F N", numbers, np.array(FRICTION) * N, formula=True))
    return Verified(tuple(rows), (Panel("A stack pulled sideways", "interface", "friction, N", tuple(curves)),))
