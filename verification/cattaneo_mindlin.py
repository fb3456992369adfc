"""Cattaneo and Mindlin: a sphere pressed onto an elastic block, then moved along it: partial slip, and its hysteresis.

K. L. Johnson, Contact Mechanics, 7.2 and 7.4.  Under P (Hertz: a, p0) and Q < F P, the inside r < c sticks,

    c = a (1 - Q/(F P))^(1/3),   q = F p0 sqrt(1 - r^2/a^2) - F p0 (c/a) sqrt(1 - r^2/c^2)   (the last for r < c)
    delta = d (1 - (1 - Q/(F P))^(2/3)),   d = 3 F P/(16 a G*),   G* = G/(2 - nu)

When Q decreases from Q*, reverse slip begins at the edge, and the changes are those of a first loading with twice F:

    c' = a (1 - (Q* - Q)/(2 F P))^(1/3),   delta = d (2 (1 - (Q* - Q)/(2 F P))^(2/3) - (1 - Q*/(F P))^(2/3) - 1)

Between Q* and -Q* this is a loop, which dissipates, with k = Q*/(F P),

    W = 9 F^2 P^2/(10 a G*) (1 - (1 - k)^(5/3) - (5 k/6) (1 + (1 - k)^(2/3)))

Half of the block of `hertz`, with its far face held; the sphere moves to delta = 0.85 d, to -0.85 d, and back.

What the formulas neglect.  They hold for two equal bodies; with a rigid sphere, pressure also shifts the surface along
itself (Dundurs' beta = (1 - 2 nu)/(2 - 2 nu), 0.29 here), and pressing alone would cause shear and slip.  So the block
is pressed without friction, and slip is measured from that state (`slip_origin`), as in the theory. Shear then changes
the pressure by beta F, 3 % at F = 0.1, increasing it on one side and decreasing it on the other.  Slip is assumed along
x, but is inclined by nu/(4 - 2 nu), 0.09: the traction has a transverse part of this order (Johnson, 7.2).

Two like spheres (`verify_pair`), pressed together, then moved along each other there and back: the same formulas with
the radius R of the summed curvatures and

    1/E* = 2 (1 - nu^2)/E,   1/G* = 2 (2 - nu)/G:   all displacements of one sphere against the other.

They shift alike along their common surface: pressing causes no shear, and shear no change of the pressure (beta is 0),
so that they are pressed with friction.  On meshes that do not match, small shears remain.  Halves of both between a
plane of symmetry and the far faces, at 16 a: the lower far face is held, the upper one moves.  Each far face has the
displacement that a half space has there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, PrescribedDisplacement, join
from coulomb.fem.geometry import Sphere
from coulomb.fem.meshes import NamedMesh, box
from coulomb.model.contact import Contact
from coulomb.model.load_history import LoadHistory
from coulomb.model.nodal_answer import STICK
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .hertz import RADIUS, STEEL, UNIFORM, WIDTH, A, Hertz, grading
from .table import Curve, Panel, Verified, absolute, relative

FRICTION = 0.1
UNIFORM_CELLS = 6
PRESSED, LOADED, UNLOADED, RELOADED = 1.0, 2.0, 4.0, 6.0
"""Times at which the motion reverses."""

PAIR_CELLS = (6, 5)
"""Cells in 4 a/3 of the lower and the upper sphere: the slave and the master."""

_APPROACH = A**2 / RADIUS


@dataclass(frozen=True)
class PartialSlip:
    """The formulas; tangential forces over F P, displacements over d, radii and tractions over a and F p0.

    Attributes:
        hertz: The pressure.
    """

    hertz: Hertz

    @property
    def d(self) -> float:
        """Displacement at which all nodes slip, of one body against the other."""
        G_star = 1.0 / sum(2.0 * (1.0 + m.poisson) * (2.0 - m.poisson) / m.young for m in self.hertz.materials)
        return 3.0 * FRICTION * self.hertz.P / (16.0 * self.hertz.a * G_star)

    def radius(self, q: float) -> float:
        """c/a under a first load q."""
        return float(np.cbrt(1.0 - q))

    def displacement(self, q: float) -> float:
        """delta/d under a first load q."""
        return float(1.0 - (1.0 - q) ** (2.0 / 3.0))

    def traction(self, r: FloatArray, q: float) -> FloatArray:
        """Under a first load q, r over a."""
        c = self.radius(q)
        inner: FloatArray = np.sqrt(np.maximum(c**2 - r**2, 0.0))
        outer: FloatArray = np.sqrt(np.maximum(1.0 - r**2, 0.0))
        return outer - inner

    def loop_energy(self, q: float) -> float:
        """W in joules of a loop between q and -q."""
        rest = 1.0 - (1.0 - q) ** (5.0 / 3.0) - 5.0 * q / 6.0 * (1.0 + (1.0 - q) ** (2.0 / 3.0))
        return float(4.8 * FRICTION * self.hertz.P * self.d * rest)


@dataclass(frozen=True)
class Moment:
    """One step: forces over F P, displacements over d, radii over a, tractions over F p0.

    Attributes:
        time: Its time.
        force: Q of the sphere on the block.
        travel: Displacement of the sphere along x.
        stick: Radius of a circle of the area of sticking nodes.
        traction: On the block along x and y, shape (m, 2).
        stick_by_moment: Radius from the mean square distance of F p - |q|, which is a Hertzian pressure of radius c.
        dissipated: Energy dissipated by both halves since the end of pressing, joules.
    """

    time: float
    force: float
    travel: float
    stick: float
    traction: FloatArray
    stick_by_moment: float
    dissipated: float


@dataclass(frozen=True)
class Experiment:
    """The history, and its contact nodes: x over a, shape (m, 3), and areas, shape (m,)."""

    theory: PartialSlip
    x: FloatArray
    area: FloatArray
    moments: list[Moment]

    @property
    def r(self) -> FloatArray:
        """Distances of the contact nodes from the centre, over a, shape (m,)."""
        r: FloatArray = np.hypot(self.x[:, 0], self.x[:, 1])
        return r

    def mean_square(self, traction: FloatArray) -> float:
        """Root mean square of tractions (m,), over that of the whole contact slipping."""
        slipping = self.theory.traction(self.r, 1.0)
        return math.sqrt(self.area @ traction**2 / (self.area @ slipping**2))


def half_block(friction: float, motion: Sequence[tuple[float, float, float, float]]) -> ContactProblem:
    """Half of the block above the sphere, which moves after it has been pressed on."""
    place, cells = grading(UNIFORM_CELLS, 2 * UNIFORM_CELLS, WIDTH), 2 * UNIFORM_CELLS
    middle = np.array([[cells], [0.0], [0.0]])
    return ContactProblem(
        box((2 * cells, cells, cells), (2 * cells, cells, cells), place=lambda x: place(x - middle)),
        STEEL,
        [Clamp("front", "y"), Clamp("top")],
        Contact("bottom", friction, foundation=Sphere((0.0, 0.0, -RADIUS), RADIUS), motion=motion),
        time=PRESSED,
    )


def experiment() -> Experiment:
    """Press without friction; then, with friction, move right, left and right."""
    up = A**2 / RADIUS
    normal = half_block(0.0, [(0.0, 0.0, 0.0, 0.0), (PRESSED, 0.0, 0.0, up)]).solve()
    hertz = Hertz(2.0 * float(normal.contact_force[0::3].sum()), RADIUS, STEEL)
    theory, surface = PartialSlip(hertz), normal.problem.surface

    far = 0.85 * theory.d
    ends = [(PRESSED, 0.0, 0.0, up), (LOADED, far, 0.0, up), (UNLOADED, -far, 0.0, up), (RELOADED, far, 0.0, up)]
    block = half_block(FRICTION, ends)
    history = LoadHistory([PRESSED + k / 4 for k in range(1, 21)], start=PRESSED)
    pressed_on = replace(
        history.beginning(block),
        displacement=normal.displacement,
        force_on_body=normal.force_on_body,
    )
    moments = [
        moment(
            *(step.state.time, step.solution, theory, 2.0 * step.state.energy.dissipated),
            travel=float(step.solution.problem.motions[0, 0]) / theory.d,
        )
        for step in history.steps(block, pressed_on)
    ]
    return Experiment(theory, surface.x / hertz.a, surface.area, moments)


def moment(time: float, solution: Solution, theory: PartialSlip, dissipated: float, travel: float) -> Moment:
    """The measures of one step of a half, whose contact points are `x` of the surface, centre (0, 0)."""
    surface, hertz = solution.problem.surface, theory.hertz
    x_n, friction = solution.contact_force[0::3], -solution.contact_force.reshape(-1, 3)[:, 1:]
    strength = np.hypot(friction[:, 0], friction[:, 1])
    sticking = solution.at_nodes.status == STICK
    unused = FRICTION * x_n - strength
    spread = unused @ np.sum(surface.x[:, :2] ** 2, axis=1) / unused.sum()
    along = np.einsum("mi,mij->mj", friction, surface.frames[:, 1:])[:, :2]
    pull = along[:, 0].sum() - x_n @ surface.frames[:, 0, 0]
    return Moment(
        time,
        force=2.0 * float(pull) / (FRICTION * hertz.P),
        travel=travel,
        stick=math.sqrt(2.0 * surface.area[sticking].sum() / math.pi) / hertz.a,
        traction=along / surface.area[:, None] / (FRICTION * hertz.p0),
        stick_by_moment=math.sqrt(2.5 * spread) / hertz.a,
        dissipated=dissipated,
    )


@dataclass(frozen=True)
class Known:
    """The formulas for a moment with the same force, in the same units."""

    travel: float
    stick: float
    traction: FloatArray


def known(theory: PartialSlip, moment: Moment, r: FloatArray, largest: float) -> Known:
    """Loading, unloading or reloading, by the time; r over a, shape (m,); `largest` is Q*/(F P)."""
    q = moment.force
    if moment.time <= LOADED:
        return Known(theory.displacement(q), theory.radius(q), theory.traction(r, q))
    sign = 1.0 if moment.time <= UNLOADED else -1.0  # reloading is the mirror image of unloading
    back = 0.5 * (largest - sign * q)
    return Known(
        sign * (theory.displacement(largest) - 2.0 * theory.displacement(back)),
        theory.radius(back),
        sign * (theory.traction(r, largest) - 2.0 * theory.traction(r, back)),
    )


def verify() -> Verified:
    """The whole loop."""
    nu = STEEL.poisson
    beta = (1.0 - 2.0 * nu) / (2.0 - 2.0 * nu)
    odd = (beta * FRICTION) ** 2 / 8.0
    even = f"(beta F)^2/8 = {odd:.1g}: shear changes the pressure by beta F x/a, odd in x: half its mean square in Q"
    return compared(experiment(), UNIFORM / A / UNIFORM_CELLS, odd, even)


def compared(run: Experiment, size: float, odd: float, even: str, shear: float = 0.0) -> Verified:
    """The loop beside the formulas.

    Args:
        run: The loop.
        size: Edge of the cells at the contact over a.
        odd: Tolerance of the forces at both ends of the loop, relative.
        even: Its reason.
        shear: Root mean square of friction that pressing alone may leave, over that of the whole contact slipping.
    """
    theory, nu = run.theory, STEEL.poisson
    at = {moment.time: moment for moment in run.moments}
    q = at[LOADED].force
    formulas = [known(theory, moment, run.r, q) for moment in run.moments]
    pairs = list(zip(run.moments, formulas, strict=True))
    held = A / WIDTH * (3.0 - 2.0 * nu) / (math.pi * (2.0 - nu))
    inclined = nu / (4.0 - 2.0 * nu)
    edge = f"h/a = {size:.2g}: the boundary of the zones is located to a cell"
    node = size**2 / 6.0
    second = f"5/12 (h/a)^2 = {2.5 * node:.2g}: a node's force represents the traction over its hat function (hertz)"
    upright = f"h/a = {size:.2g}: the last cell cannot resolve the vertical tangents at r = c and a"
    reason = (
        f"the half space continues behind the held face: Cerruti's displacement, {held:.1%}; (h/a)^2/6 = {node:.2g}"
    )
    work = (
        f"Cerruti's {held:.1%}, and (h/a)^2 = {size**2:.2g}: the slip zone's boundary moves through cells in 16 steps"
    )
    loading = [pair for pair in pairs if pair[0].time <= LOADED]
    later = [pair for pair in pairs if pair[0].time > LOADED]

    def stick_off(chosen: list[tuple[Moment, Known]]) -> float:
        return max(abs(ours.stick - formula.stick) for ours, formula in chosen)

    def traction_off(chosen: list[tuple[Moment, Known]]) -> float:
        return max(run.mean_square(ours.traction[:, 0] - formula.traction) for ours, formula in chosen)

    def travel_error(chosen: list[tuple[Moment, Known]]) -> float:
        return max(abs(ours.travel - formula.travel) for ours, formula in chosen)

    by_moment = max(abs(ours.stick_by_moment - formula.stick) for ours, formula in loading)
    loop = theory.loop_energy(q)
    spent = at[RELOADED].dissipated - at[LOADED].dissipated
    rows = (
        absolute("loading: stick radius by area, worst error over a", 0.0, stick_off(loading), size, edge),
        absolute("loading: stick radius by second moment, worst error over a", 0.0, by_moment, 2.5 * node, second),
        absolute("loop: stick radius by area, worst error over a", 0.0, stick_off(later), size, edge),
        absolute("loading: traction along x, worst root mean square error", 0.0, traction_off(loading), size, upright),
        absolute("loop: traction along x, worst root mean square error", 0.0, traction_off(later), size, upright),
        absolute(
            "traction across, worst root mean square",
            0.0,
            max(run.mean_square(ours.traction[:, 1]) for ours in run.moments),
            inclined + shear,
            f"nu/(4 - 2 nu) = {inclined:.2g}: inclination of slip, which the formulas neglect"
            + (
                f"; {shear:.2g}: shear due to pressing at the edge, where facets do not match: half of h/a"
                if shear
                else ""
            ),
        ),
        absolute("loading: delta/d, worst error", 0.0, travel_error(loading), held + node, reason),
        absolute("loop: delta/d, worst error", 0.0, travel_error(later), held + node, reason),
        relative("energy dissipated in the loop W, J", loop, spent, held + size**2, work),
        relative("at the other end: Q over the largest Q", -1.0, at[UNLOADED].force / q, odd, even),
        relative("the loop closes: Q over the largest Q", 1.0, at[RELOADED].force / q, odd, even),
    )
    return Verified(rows, _panels(run, pairs, q))


def _panels(run: Experiment, pairs: list[tuple[Moment, Known]], q: float) -> tuple[Panel, ...]:
    middle = (run.x[:, 1] < 1e-9) & (np.abs(run.x[:, 0]) < 1.4)
    x, fine = run.x[middle, 0], np.linspace(-1.4, 1.4, 561)
    profiles = []
    for label, time in (("largest Q", LOADED), ("on the return", 2.5)):
        moment = next(ours for ours, _ in pairs if ours.time == time)
        formula = known(run.theory, moment, np.abs(fine), q)
        profiles.append(Curve(f"formula, {label}", fine, formula.traction, formula=True))
        profiles.append(Curve(f"coulomb, {label}", x, moment.traction[middle, 0]))
    grid = np.linspace(-1.0, 1.0, 201) * q
    back = [run.theory.displacement(q) - 2.0 * run.theory.displacement(0.5 * (q - g)) for g in grid]
    first = np.linspace(0.0, q, 101)
    ours, formulas = zip(*pairs, strict=True)
    loads = np.linspace(0.0, 1.0, 201)
    since = 1.0 - np.array([formula.stick for formula in formulas]) ** 3
    return (
        Panel(
            "traction on y = 0",
            "x / a",
            "q / (F p0)",
            tuple(profiles),
        ),
        Panel(
            "hysteresis",
            "delta / d",
            "Q / (F P)",
            (
                Curve("Mindlin", np.array([run.theory.displacement(g) for g in first]), first, formula=True),
                Curve("", np.array(back), grid, formula=True),
                Curve("", -np.array(back), -grid, formula=True),
                Curve("coulomb", np.array([m.travel for m in ours]), np.array([m.force for m in ours])),
            ),
        ),
        Panel(
            "stick radius",
            "Q/(F P) of a first load; since the last turn, half of its change",
            "c / a",
            (
                Curve("formula", loads, np.cbrt(1.0 - loads), formula=True),
                Curve("coulomb, by area", since, np.array([m.stick for m in ours])),
                Curve("coulomb, by second moment", since[:4], np.array([m.stick_by_moment for m in ours[:4]])),
            ),
        ),
    )


# --- two like spheres -----------------------------------------------------------------------------------------------


def half(cells: int, upper: bool) -> NamedMesh:
    """Half of a sphere of the radius 2 RADIUS, y >= 0, above or below z = 0, with its contact face at the origin."""
    place, outer = grading(cells, 2 * cells, WIDTH), 2 * cells
    sign = 1.0 if upper else -1.0

    def at(k: FloatArray) -> FloatArray:
        x, y, depth = place(k[0] - outer), place(k[1]), place(k[2] if upper else outer - k[2])
        rise = 2.0 * RADIUS - np.sqrt(4.0 * RADIUS**2 - x**2 - y**2)
        return np.stack([x, y, sign * (depth + (1.0 - depth / WIDTH) * rise)])

    return box((2 * outer, outer, outer), (2 * outer, outer, outer), place=at)


def spheres(cells: tuple[int, int], far: float) -> ContactProblem:
    """Both halves; the upper far face goes down until PRESSED, then by `far` there and back."""
    along = [(PRESSED, 0.0), (LOADED, 1.0), (UNLOADED, -1.0), (RELOADED, 1.0)]
    return ContactProblem(
        join(lower=half(cells[0], False), upper=half(cells[1], True)),
        {"upper": STEEL, "lower": STEEL},
        [
            Clamp("upper:front", "y"),
            Clamp("lower:front", "y"),
            Clamp("lower:bottom"),
            Clamp("upper:top", "y"),
            PrescribedDisplacement("upper:top", (0.0, 0.0, -_APPROACH), "z", amplitude=[(0.0, 0.0), (PRESSED, 1.0)]),
            PrescribedDisplacement("upper:top", (far, 0.0, 0.0), "x", amplitude=along),
        ],
        Contact("lower:top", against="upper:bottom", friction=FRICTION),
        time=PRESSED,
    )


def pair_experiment(cells: tuple[int, int] = PAIR_CELLS, steps: int = 4) -> Experiment:
    """Press, then move right, left and right, with `steps` steps per unit of time."""
    pressed = spheres(cells, 0.0).solve()
    theory = PartialSlip(Hertz(2.0 * float(pressed.contact_force[0::3].sum()), RADIUS, STEEL, STEEL))
    far = 0.85 * theory.d
    problem = spheres(cells, far)
    times = [PRESSED + k / steps for k in range(round((RELOADED - PRESSED) * steps) + 1)]
    moments = []
    for step in LoadHistory(times).steps(problem):
        time = step.state.time
        if time > PRESSED:
            travel = 0.85 * float(np.interp(time, (PRESSED, LOADED, UNLOADED, RELOADED), (0.0, 1.0, -1.0, 1.0)))
            moments.append(moment(time, step.solution, theory, 2.0 * step.state.energy.dissipated, travel))
    surface = pressed.problem.surface
    return Experiment(theory, surface.x / theory.hertz.a, surface.area, moments)


def verify_pair(cells: tuple[int, int] = PAIR_CELLS, steps: int = 4) -> Verified:
    """The whole loop of two like spheres."""
    size = UNIFORM / A / min(cells)
    even = f"(h/a)^2/6 = {size**2 / 6.0:.2g}: facets that do not match: the pressure of like bodies changes as little"
    return compared(pair_experiment(cells, steps), size, size**2 / 6.0, even, shear=0.5 * size)
