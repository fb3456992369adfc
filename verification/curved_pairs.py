"""Pairs of curved faces at three mesh sizes, by elements of first and second order: what chords do to an answer.

Ball joint: a hollow ball a < r < b in a socket b < r < c that overlap by d before the fit.  Of a hollow sphere with the
other side free, at the radius f,

    u_r/(r p) = (2 (1 - 2 nu) r^3 + (1 + nu) f^3)/(2 E (f^3 - r^3)) = s,    d = p b (s_socket - s_ball)

the part |x|, |y| < z of x, y > 0 between four planes of symmetry; and by Hertz, a ball in a socket that is larger by a
twentieth, R = R1 R2/(R2 - R1) (`hertz_pairs`).

Pin in hole: a tube in a ring with a clearance d, which a pressure q in the tube closes: u = 2 (1 - nu^2)/E q
a^2 b/(b^2 - a^2) without contact, d = u - p (b s_tube + (b + d) s_ring), s as in `ring_pair`.

Ring pair: `ring_pair`, the interference by geometry.  Press fit: `press_fit`, on a rigid pin.  Hertz pair: the spheres
of `hertz_pairs`.  Facets of first order are as they are, or stand for surfaces that are named, where chords are larger
than interference or clearance.

Roller: between two guided plates, 300 N/mm, vertices at its lowest and highest places.  The approach of the plates is
that of 27-node hexahedra that are graded towards the contacts, on two meshes, of which the last is a half of the one
before; the difference of the two is its accuracy.  By symmetry the roller does not move sideways.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Clamp, Material, Pressure, Traction, join
from coulomb.fem.geometry import Cylinder, Sphere
from coulomb.fem.meshes import NamedMesh, box
from coulomb.model.contact import Contact
from coulomb.model.problem import ContactProblem
from coulomb.model.solution import Solution

from .array_mesh import between
from .hertz_pairs import SPHERES, UNIFORM, A, Ellipse, Pair
from .hertz_pairs import problem as pressed_quarters
from .press_fit import INNER, expected_force, normal_force, ring
from .ring_pair import (
    ALUMINIUM,
    BORE,
    FIT,
    FRICTION,
    INTERFERENCE,
    RIM,
    STEEL,
    Facets,
    fitted,
    lame,
    mean_pressure,
    quarter,
    rings,
    softness,
)
from .table import Row, Verified, absolute, relative

Kind = tuple[str, int]
KINDS: dict[str, Kind] = {
    "first-order hexahedra": ("hexahedron", 1),
    "first-order tetrahedra": ("tetrahedron", 1),
    "27-node hexahedra": ("hexahedron", 2),
    "10-node tetrahedra": ("tetrahedron", 2),
}
"""Cell and order by name."""

SIZES = (1, 2, 4)
"""Cells over those of the coarsest mesh."""

CELLS_OF_HERTZ = {1: (4, 4), 2: (6, 4), 4: (8, 6)}
"""In 1.2 half axes, of the upper and the lower body, by size."""

BORE_PRESSURE = 3.3e7
"""q in pascals: twice what closes the clearance."""

ACROSS = {1: (6, 4), 2: (4, 3)}
"""Cells of ball and socket in 45 degrees, of size 1, by order."""

SOCKET = Pair("ball in socket", (0.1, 0.1), (-0.105, -0.105), (STEEL, ALUMINIUM))

ROLLER, HALF_ANGLE, WIDTH, LINE_LOAD = 0.01, math.pi / 3.0, 0.002, 3e5
"""Radius and length of the roller in metres, angle to both sides of its lowest place, load in N/m."""

PLATE = (0.024, 0.005)
"""Length and thickness of the plates, metres."""


@dataclass(frozen=True)
class Found:
    """One answer; `against` is whether a mean displacement, or a force, is against the load."""

    quantity: str
    formula: float
    ours: float
    against: bool


def shell(inner: float, outer: float, cells: tuple[int, int], kind: Kind) -> NamedMesh:
    """A part of a hollow sphere between planes of symmetry left, right, front, back: cells across, and along radii."""

    def place(k: FloatArray) -> FloatArray:
        ray = np.stack([np.tan(0.25 * math.pi * k[0]), np.tan(0.25 * math.pi * k[1]), np.ones_like(k[0])])
        radial: FloatArray = (inner + (outer - inner) * k[2]) * ray / np.linalg.norm(ray, axis=0)
        return radial

    return box((1.0, 1.0, 1.0), (cells[0], *cells), kind[0], place=place, degree=kind[1])


def _softness(material: Material, r: float, free: float) -> float:
    """u_r/r per pressure at r of a hollow sphere whose other side is free, at the radius `free`."""
    E, nu = material.young, material.poisson
    return (2.0 * (1.0 - 2.0 * nu) * r**3 + (1.0 + nu) * free**3) / (2.0 * E * (free**3 - r**3))


def ball_joint(size: int, kind: Kind, named: bool) -> Found:
    """Ball and socket that overlap; their surfaces are named or not."""
    radius = FIT + INTERFERENCE
    cells = [(n * size, max(size // kind[1], 1)) for n in ACROSS[kind[1]]]
    bodies = {"ball": shell(BORE, radius, cells[0], kind), "socket": shell(FIT, RIM, cells[1], kind)}
    surface, other = (Sphere((0.0, 0.0, 0.0), r) if named else None for r in (radius, FIT))
    contact = Contact("ball:top", FRICTION, against="socket:bottom", surface=surface, against_surface=other)
    solution = fitted(bodies, ("left", "right", "front", "back"), contact).solve()
    known = INTERFERENCE / (FIT * (_softness(STEEL, FIT, RIM) - _softness(ALUMINIUM, FIT, BORE)))
    ours = float(solution.contact_force[0::3].sum()) / (math.pi * FIT**2 / 6.0)
    inner, outer = radial(solution, radius, 3), radial(solution, FIT, 3)
    return Found("mean pressure, Pa", known, ours, inner > 0.0 or outer < 0.0)


def pin_in_hole(size: int, kind: Kind, named: bool) -> Found:
    """Tube and ring with a clearance that the pressure closes; their surfaces are named or not."""
    hole, centre, axis, cells = FIT + INTERFERENCE, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 2 * size // kind[1]
    bodies = {
        "pin": quarter(BORE, FIT, (cells, 4 * cells), *kind),
        "plate": quarter(hole, RIM, (cells, 3 * cells), *kind),
    }
    surface, other = (Cylinder(centre, axis, r) if named else None for r in (FIT, hole))
    contact = Contact("pin:right", FRICTION, against="plate:left", surface=surface, against_surface=other)
    pressed = [Pressure("pin:left", BORE_PRESSURE)]
    solution = fitted(bodies, ("front", "back", "bottom", "top"), contact, pressed).solve()
    E, nu = ALUMINIUM.young, ALUMINIUM.poisson
    free = 2.0 * (1.0 - nu**2) / E * BORE_PRESSURE * BORE**2 * FIT / (FIT**2 - BORE**2)
    soft = FIT * softness(ALUMINIUM, FIT, BORE) + hole * softness(STEEL, hole, RIM)
    against = min(radial(solution, FIT), radial(solution, hole)) < 0.0
    return Found("mean pressure, Pa", (free - INTERFERENCE) / soft, mean_pressure(solution), against)


def radial(solution: Solution, r: float, along: int = 2) -> float:
    """Mean displacement along the radius of the nodes at the radius r, of so many coordinates, metres."""
    x, u = solution.problem.elasticity.x[:, :along], solution.displacement[:, :along]
    at = np.abs(np.linalg.norm(x, axis=1) - r) < 1e-9
    return float(np.mean(np.einsum("ki,ki->k", u[at], x[at]))) / r


def ring_of_two(size: int, kind: Kind, named: bool) -> Found:
    """`ring_pair` with the interference as geometry."""
    cells = 2 * size // kind[1]
    facets: Facets = "cylinders" if named else "as they are"
    solution = rings(cells, (kind[0], kind[0]), (kind[1], kind[1]), True, facets).solve()
    inner, outer = radial(solution, FIT + INTERFERENCE), radial(solution, FIT)
    return Found("mean pressure, Pa", lame(), mean_pressure(solution), inner > 0.0 or outer < 0.0)


def on_rigid_pin(size: int, kind: Kind, _: bool) -> Found:
    """`press_fit`."""
    solution = ring(2 * size // kind[1], kind[0], degree=kind[1]).solve()
    known, force = expected_force(), normal_force(solution)
    return Found("normal force, N", known, force, radial(solution, INNER) < 0.0)


def hertz(pair: Pair, size: int, kind: Kind, named: bool) -> Found:
    """Force at a given approach; against the load: a force of the touching bodies without approach."""
    ellipse, cells = Ellipse(pair, A), CELLS_OF_HERTZ[size]
    solution, still = (pressed_quarters(ellipse, cells, kind, kind, way, named).solve() for way in (1.0, 0.0))
    force, without = (4.0 * float(each.contact_force[0::3].sum()) for each in (solution, still))
    return Found("force, N", ellipse.P, force, without > 1e-6 * ellipse.P)


def _ends(cells: int, graded: str) -> FloatArray:
    """Ends of cells in (0, 1): even ones, or smaller ones towards the "middle", "both" ends or the "start"."""
    k = np.linspace(0.0, 1.0, cells + 1)
    t = 2.0 * k - 1.0
    lines: dict[str, FloatArray] = {
        "": k,
        "middle": 0.5 + 0.5 * np.sign(t) * t**2,
        "both": 0.5 + 0.5 * np.sign(t) * (1.0 - (1.0 - np.abs(t)) ** 3),
        "start": k**3,
    }
    return lines[graded]


def roller(cells: int, kind: Kind, graded: bool = False) -> ContactProblem:
    """Roller and plates, with so many cells along each arc, as long ones in the plates; or graded ones."""
    along, deep, high = (cells, cells // 2, cells) if graded else (cells * 8 // 7, cells // 4, cells // 2)

    def line(k: FloatArray, count: int, towards: str) -> FloatArray:
        return between(_ends(count, towards if graded else ""), count * k)

    def mid(k: FloatArray) -> FloatArray:
        angle = HALF_ANGLE * (2.0 * line(k[0], cells, "middle") - 1.0)
        up = 2.0 * line(k[2], high, "both") - 1.0
        return np.stack([ROLLER * np.sin(angle), WIDTH * k[1], ROLLER * np.cos(angle) * up])

    def plate(sign: float, k: FloatArray) -> FloatArray:
        x = PLATE[0] * (line(k[0], along, "middle") - 0.5)
        depth = line(k[2] if sign > 0.0 else 1.0 - k[2], deep, "start")
        return np.stack([x, WIDTH * k[1], sign * (ROLLER + PLATE[1] * depth)])

    low, up = (
        box((1.0, 1.0, 1.0), (along, 1, deep), kind[0], place=partial(plate, sign), degree=kind[1])
        for sign in (-1.0, 1.0)
    )
    disc = box((1.0, 1.0, 1.0), (cells, 1, high), kind[0], place=mid, degree=kind[1])
    guides = [Clamp(f"{name}:{face}", "y") for name in ("low", "mid", "up") for face in ("front", "back")]
    guides += [Clamp(f"{name}:{face}", "x") for name in ("low", "up") for face in ("left", "right")]
    return ContactProblem(
        join(low=low, mid=disc, up=up),
        STEEL,
        [Clamp("low:bottom"), *guides],
        [
            Contact("mid:bottom", against="low:top", friction=0.3),
            Contact("mid:top", against="up:bottom", friction=0.3),
        ],
        [Traction("up:top", (0.0, 0.0, -LINE_LOAD / PLATE[0]))],
    )


def motions(problem: ContactProblem) -> tuple[float, float]:
    """How far the plates approach each other, and the middle of the roller moves sideways in the mean, metres."""
    solution = problem.solve()
    x, u = solution.problem.elasticity.x, solution.displacement
    top, mid = x[:, 2] > ROLLER + PLATE[1] - 1e-9, np.linalg.norm(x[:, ::2], axis=1) < 0.3 * ROLLER
    return -float(u[top, 2].mean()), float(u[mid, 0].mean())


def _rows(name: str, sizes: Sequence[int], answers: list[Found], tolerances: list[tuple[float, str]]) -> list[Row]:
    rows = [
        relative(f"{name}, size {n}: {found.quantity}", found.formula, found.ours, *allowed)
        for n, found, allowed in zip(sizes, answers, tolerances, strict=True)
    ]
    return [*rows, _signs(name, [found.against for found in answers])]


def _signs(name: str, against: list[bool]) -> Row:
    what = "meshes on which a displacement, or a force of bodies that just touch, is against the load"
    return absolute(f"{name}: {what}", 0.0, float(sum(against)), 0.0, "a count: none")


def _of_rings(size: int, kind: Kind) -> tuple[float, str]:
    t = 0.25 * math.pi / (3 * size) * kind[1]
    if kind[1] == 1:
        return 2.0 * t**2, "2 t^2, t the angle of a cell: linear elements, gaps between the surfaces themselves"
    return INTERFERENCE / FIT + t**4 * FIT / INTERFERENCE / 960.0, "d/b, and curved edges, off by b t^4/960"


def _of_ball(size: int, kind: Kind) -> tuple[float, str]:
    h = (RIM - FIT) / FIT / max(size // kind[1], 1)
    t = 0.25 * math.pi / (ACROSS[kind[1]][1] * size)
    if kind[1] == 1:
        return 2.0 * h**2, "2 (h/b)^2, h the cells along the radius: linear elements"
    why = "8 t^4/960 b/d, t the angle of a cell: curved edges, in two directions, whose nodes are not in their middles"
    return INTERFERENCE / FIT + 8.0 * t**4 * FIT / INTERFERENCE / 960.0 + h**4, why


def _of_press_fit(size: int, kind: Kind) -> tuple[float, str]:
    t, h = 0.25 * math.pi / size, 0.5 / size
    if kind[1] == 1:
        return h**2, "(h/a)^2: linear elements, chords in place of the circle"
    return (
        (t**4, "t^4, t the angle of a cell: the order of energies")
        if kind[0] == "hexahedron"
        else (
            t**2 / 6.0,
            "t^2/6: mean normals around vertices",
        )
    )


def _of_hertz(size: int, kind: Kind) -> tuple[float, str]:
    h, H = (UNIFORM / n for n in CELLS_OF_HERTZ[size])
    if kind == ("tetrahedron", 1):
        return h**2 + H**2, "(h/a)^2 + (H/a)^2, h and H the cells of both: linear tetrahedra"
    return (h**2 + H**2) / 4.0, "((h/a)^2 + (H/a)^2)/4, as in hertz-pairs"


def _with_chords(name: str, kind: Kind, sizes: Sequence[int]) -> list[Row]:
    """The ring pair with facets as they are: errors in parts of those that the chords of both allow."""
    answers = [ring_of_two(n, kind, False) for n in sizes]
    shares = []
    for n, found in zip(sizes, answers, strict=True):
        chords = FIT / 8.0 * sum((0.25 * math.pi / (k * n)) ** 2 for k in (3, 4))
        shares.append(abs(found.ours / found.formula - 1.0) * INTERFERENCE / chords)
    what = f"ring pair, {name} as they are"
    why = "half of the chords: two thirds of each in the mean, and against each other"
    rows = [
        absolute(f"{what}, size {n}: error over that of the chords", 0.0, share, 0.5, why)
        for n, share in zip(sizes, shares, strict=True)
    ]
    return [*rows, _signs(what, [found.against for found in answers])]


def _roller_rows(sizes: Sequence[int], reference: tuple[int, int], kinds: Sequence[str]) -> list[Row]:
    before, known = (motions(roller(n, ("hexahedron", 2), graded=True))[0] for n in reference)
    rows = [
        relative("roller, graded: approach, m, of the mesh before", known, before, 0.02, "a mesh of half the cells")
    ]
    for name, kind in ((name, KINDS[name]) for name in kinds):
        answers = [motions(roller(14 * n, kind)) for n in sizes]
        for n, (approach, aside) in zip(sizes, answers, strict=True):
            chord = (2.0 * HALF_ANGLE / (14 * n)) ** 2 * ROLLER / 8.0
            why = "h^2/(8 R) at both plates over the approach, at most a half: the contact is smaller than a facet"
            allowed = min(2.0 * chord / known, 0.5)
            rows.append(relative(f"roller, {name}, size {n}: approach, m", known, approach, allowed, why))
            share, symmetric = abs(aside) / known, kind[0] == "hexahedron"
            why = f"the mesh is {'' if symmetric else 'not '}symmetric"
            what = f"roller, {name}, size {n}: motion sideways over the approach"
            rows.append(absolute(what, 0.0, share, 0.01 if symmetric else 0.1, why))
        rows.append(_signs(f"roller, {name}", [approach < 0.0 for approach, _ in answers]))
    return rows


PAIRS: tuple[tuple[str, Callable[[int, Kind, bool], Found], Callable[[int, Kind], tuple[float, str]], bool], ...] = (
    ("ball joint", ball_joint, _of_ball, True),
    ("ball in socket", partial(hertz, SOCKET), _of_hertz, True),
    ("pin in hole", pin_in_hole, _of_rings, True),
    ("ring pair", ring_of_two, _of_rings, True),
    ("press fit", on_rigid_pin, _of_press_fit, False),
    ("Hertz pair", partial(hertz, SPHERES), _of_hertz, False),
)
"""Names, answers, tolerances, and whether surfaces of first-order facets are named."""


def verify(
    sizes: Sequence[int] = SIZES, reference: tuple[int, int] = (16, 32), kinds: Sequence[str] = tuple(KINDS)
) -> Verified:
    """All pairs with these kinds of elements; cells over those of the coarsest meshes, and those of the two meshes of
    the roller that are graded."""
    rows: list[Row] = []
    for what, solve, allowed, has_surfaces in PAIRS:
        for name, kind in ((name, KINDS[name]) for name in kinds):
            named = has_surfaces and kind[1] == 1
            found = [solve(n, kind, named) for n in sizes]
            full = f"{what}, {name}{', named surfaces' if named else ''}"
            rows += _rows(full, sizes, found, [allowed(n, kind) for n in sizes])
            if solve is ring_of_two and named:
                rows += _with_chords(name, kind, sizes)
    return Verified((*rows, *_roller_rows(sizes, reference, kinds)), ())
