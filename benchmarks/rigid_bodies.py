"""Frictional contact of rigid bodies, as dynamics makes it in a time step: compliances of half rank and less.

    W = H^T M^-1 H,   q = H^T v;   u = W r + q

M is the diagonal of masses and moments of inertia, v the velocities of the bodies without contact, u the relative
velocities at the contacts, r the impulses.  Like the collections of rigid bodies (FCLIB): stacks, walls, towers of
planks, arches, masonry, chains, capsules, piles of spheres, bodies with random points of contact, and bodies between
walls.  As q is in the range
of W, and u = 0 is permitted, there is always a solution; forces are mostly not unique.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse
from scipy.spatial import cKDTree

from coulomb.arrays import FloatArray
from coulomb.io.fclib import FCLIBProblem

_GROUND = -1
_TOUCHING = 1e-9


class TouchPoint(NamedTuple):
    """A contact: body `second` may not approach body `first` (-1: the ground) along the normal, which points into
    `second`.
    """

    first: int
    second: int
    point: FloatArray
    normal: FloatArray


def assembled(
    title: str, centres: FloatArray, inverse_mass: FloatArray, v: FloatArray, points: list[TouchPoint], friction: float
) -> FCLIBProblem:
    """The problem of some bodies.

    Args:
        title: Its name.
        centres: Shape (bodies, 3).
        inverse_mass: 1/mass, three times, and 1/moment of inertia about x, y, z, shape (bodies, 6).
        v: Velocity and spin without contact, shape (bodies, 6).
        points: The contacts.
        friction: Coefficient of friction of all of them.
    """
    rows: list[int] = []
    columns: list[int] = []
    values: list[float] = []
    for k, contact in enumerate(points):
        axes = _frame(contact.normal)
        for body, sign in ((contact.first, -1.0), (contact.second, 1.0)):
            if body == _GROUND:
                continue
            arm = contact.point - centres[body]
            for i, axis in enumerate(axes):
                rows += range(6 * body, 6 * body + 6)
                columns += [3 * k + i] * 6
                values += [*(sign * axis), *(sign * np.cross(arm, axis))]
    H = scipy.sparse.csc_matrix((values, (rows, columns)), shape=(6 * len(centres), 3 * len(points)))
    W = scipy.sparse.csr_matrix(H.T @ scipy.sparse.diags(inverse_mass.ravel()) @ H)
    return FCLIBProblem(0.5 * (W + W.T), H.T @ v.ravel(), np.full(len(points), friction), title)


def _frame(normal: FloatArray) -> FloatArray:
    """n, t1, t2 as rows."""
    n = normal / np.linalg.norm(normal)
    t = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    t /= np.linalg.norm(t)
    return np.array([n, t, np.cross(n, t)])


def _falling(bodies: int, push: float, rng: np.random.Generator) -> FloatArray:
    """Falling with unit velocity, and pushed and spun at random."""
    v = push * rng.standard_normal((bodies, 6))
    v[:, 2] -= 1.0
    return v


def _boxes(
    title: str, centres: FloatArray, sizes: FloatArray, friction: float, push: float, rng: np.random.Generator
) -> FCLIBProblem:
    """Upright boxes: four contacts at the corners of every rectangle in which two of them, or one and the ground,
    touch.
    """
    low, high = centres - sizes / 2, centres + sizes / 2
    points = [
        TouchPoint(_GROUND, int(b), np.array([x, y, 0.0]), np.array([0.0, 0.0, 1.0]))
        for b in np.flatnonzero(np.abs(low[:, 2]) < _TOUCHING)
        for x in (low[b, 0], high[b, 0])
        for y in (low[b, 1], high[b, 1])
    ]
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for a in range(len(centres)):
            for b in np.flatnonzero(np.abs(low[:, axis] - high[a, axis]) < _TOUCHING):
                first, last = np.maximum(low[a], low[b])[others], np.minimum(high[a], high[b])[others]
                if np.all(last - first > _TOUCHING):
                    for corner in ((s, t) for s in (first[0], last[0]) for t in (first[1], last[1])):
                        p = np.insert(np.array(corner), axis, high[a, axis])
                        points.append(TouchPoint(a, int(b), p, np.eye(3)[axis]))
    mass = np.prod(sizes, axis=1)[:, None]
    square = sizes**2
    moments = mass / 12.0 * (square.sum(axis=1, keepdims=True) - square)
    inverse = 1.0 / np.hstack([mass, mass, mass, moments])
    return assembled(title, centres, inverse, _falling(len(centres), push, rng), points, friction)


def stack(boxes: int, friction: float, seed: int, push: float = 0.3) -> FCLIBProblem:
    """Unit cubes upon each other, each displaced at random."""
    rng = np.random.default_rng(seed)
    offset = np.cumsum(rng.uniform(-0.15, 0.15, (boxes, 2)), axis=0)
    centres = np.column_stack([offset, np.arange(boxes) + 0.5])
    return _boxes(f"stack of {boxes}", centres, np.ones((boxes, 3)), friction, push, rng)


def wall(rows: int, columns: int, friction: float, seed: int, push: float = 0.1) -> FCLIBProblem:
    """Bricks in a running bond, each with contacts to the two below and to its neighbours."""
    rng = np.random.default_rng(seed)
    centres = np.array([[2.0 * j + k % 2, 0.0, k + 0.5] for k in range(rows) for j in range(columns)])
    sizes = np.tile([2.0, 0.5, 1.0], (len(centres), 1))
    return _boxes(f"wall {rows} x {columns}", centres, sizes, friction, push, rng)


def tower(levels: int, friction: float, seed: int, push: float = 0.1) -> FCLIBProblem:
    """Three planks per level, crosswise."""
    rng = np.random.default_rng(seed)
    centres, sizes = [], []
    for level in range(levels):
        for place in (-5.5, 0.0, 5.5):
            across = level % 2 == 1
            centres.append([place if across else 0.0, 0.0 if across else place, 0.8 * level + 0.4])
            sizes.append([2.0, 15.0, 0.8] if across else [15.0, 2.0, 0.8])
    return _boxes(f"tower of {levels}", np.array(centres), np.array(sizes), friction, push, rng)


def arch(stones: int, friction: float, seed: int, push: float = 0.05, across: int = 2) -> FCLIBProblem:
    """A semicircular arch of wedge-shaped stones, with this many contacts in each direction of a joint."""
    rng, angles = np.random.default_rng(seed), np.linspace(0.0, np.pi, stones + 1)
    middle = 0.5 * (angles[1:] + angles[:-1])
    centres = 4.5 * np.column_stack([np.cos(middle), np.zeros(stones), np.sin(middle)])
    points = []
    for k, angle in enumerate(angles):
        outward, normal = np.array([np.cos(angle), 0.0, np.sin(angle)]), np.array([-np.sin(angle), 0.0, np.cos(angle)])
        for distance in np.linspace(4.0, 5.0, across):
            for y in np.linspace(-0.5, 0.5, across):
                p = distance * outward + np.array([0.0, y, 0.0])
                points.append(TouchPoint(k - 1, k, p, normal) if k < stones else TouchPoint(-1, k - 1, p, -normal))
    inverse = np.tile([1.0, 1.0, 1.0, 5.0, 5.0, 5.0], (stones, 1))
    return assembled(f"arch of {stones}", centres, inverse, _falling(stones, push, rng), points, friction)


def masonry(stones: int, across: int, friction: float, seed: int) -> FCLIBProblem:
    """An arch with many contacts per joint, as of bridges and aqueducts: W has a small part of its full rank."""
    problem = arch(stones, friction, seed, across=across)
    return replace(problem, title=f"masonry of {stones}, {across} x {across} contacts per joint")


def chain(links: int, friction: float, seed: int, push: float = 0.3) -> FCLIBProblem:
    """A hanging chain: each link lies in the one above it, with one to three contacts."""
    rng = np.random.default_rng(seed)
    centres = np.column_stack([np.zeros((links, 2)), -1.4 * np.arange(links)])
    points = []
    for k in range(links):
        for _ in range(int(rng.integers(1, 4))):
            place = centres[k] + np.array([*rng.uniform(-0.2, 0.2, 2), 0.7])
            points.append(TouchPoint(k - 1 if k else _GROUND, k, place, np.array([*rng.uniform(-0.8, 0.8, 2), 1.0])))
    inverse = np.tile([1.0, 1.0, 1.0, 3.0, 3.0, 8.0], (links, 1))
    return assembled(f"chain of {links}", centres, inverse, _falling(links, push, rng), points, friction)


def capsules(layers: int, across: int, friction: float, seed: int, push: float = 0.3) -> FCLIBProblem:
    """Capsules in layers, crosswise and side by side: a contact at every crossing, and one with each neighbour."""
    rng, middle = np.random.default_rng(seed), 0.5 * (across - 1)
    centres, points = np.zeros((layers * across, 3)), []
    for k in range(layers):
        along = k % 2
        for i in range(across):
            body = k * across + i
            centres[body] = [middle if along == 0 else i, i if along == 0 else middle, k + 0.5]
            for j in range(across) if k else (0, across - 1):
                place = np.array([j, i, k] if along == 0 else [i, j, k], dtype=float)
                normal = np.array([*rng.uniform(-0.1, 0.1, 2), 1.0])
                points.append(TouchPoint((k - 1) * across + j if k else _GROUND, body, place, normal))
            if i:
                place, normal = centres[body].copy(), np.eye(3)[1 - along]
                place += rng.uniform(-0.5, 0.5) * np.eye(3)[along] - 0.5 * normal
                points.append(TouchPoint(body - 1, body, place, normal))
    inverse = np.ones((len(centres), 6)) * [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    title = f"capsules {layers} x {across}"
    return assembled(title, centres, inverse, _falling(len(centres), push, rng), points, friction)


def spheres(count: int, friction: float, seed: int, push: float = 0.3) -> FCLIBProblem:
    """A pile of spheres in a box, in layers that are disturbed at random."""
    rng, side = np.random.default_rng(seed), int(np.ceil(count ** (1 / 3)))
    layers = range(count // side**2 + 1)
    places = [
        (i + 0.5 * (k % 2), j + 0.5 * (k % 2), 0.5 + 0.7071 * k)
        for k in layers
        for j in range(side)
        for i in range(side)
    ]
    centres = np.array(places[:count]) + 0.01 * rng.standard_normal((count, 3))
    points = []
    for a, b in sorted(cKDTree(centres).query_pairs(1.03)):
        points.append(TouchPoint(a, b, 0.5 * (centres[a] + centres[b]), centres[b] - centres[a]))
    for b, centre in enumerate(centres):
        for axis, sign, reached in (
            (2, 1.0, centre[2] < 0.53),
            *((k, 1.0, centre[k] < 0.15) for k in (0, 1)),
            *((k, -1.0, centre[k] > side - 0.55) for k in (0, 1)),
        ):
            if reached:
                points.append(TouchPoint(_GROUND, b, centre - 0.5 * sign * np.eye(3)[axis], sign * np.eye(3)[axis]))
    inverse = np.tile([1.0, 1.0, 1.0, 10.0, 10.0, 10.0], (count, 1))
    v = _falling(count, push, rng)
    v[:, 3:] = 0.0
    return assembled(f"{count} spheres", centres, inverse, v, points, friction)


def scattered(bodies: int, contacts: int, friction: float, seed: int, push: float = 0.5) -> FCLIBProblem:
    """Bodies with random points and normals of contact, whose forces oppose each other."""
    rng = np.random.default_rng(seed)
    centres, points = rng.uniform(0.0, bodies ** (1 / 3), (bodies, 3)), []
    for _ in range(contacts):
        second, first = int(rng.integers(bodies)), int(rng.integers(-1, bodies))
        towards = rng.standard_normal(3)
        towards /= np.linalg.norm(towards)
        normal = towards + 0.7 * rng.standard_normal(3)
        points.append(
            TouchPoint(_GROUND if first == second else first, second, centres[second] - 0.5 * towards, normal)
        )
    inverse = 1.0 / np.column_stack(
        [np.repeat(rng.uniform(0.5, 2.0, (bodies, 1)), 3, 1), rng.uniform(0.05, 0.2, (bodies, 3))]
    )
    return assembled(f"{bodies} scattered", centres, inverse, _falling(bodies, push, rng), points, friction)


def walled(contacts: int, friction: float, seed: int) -> FCLIBProblem:
    """One body with contacts on all six sides: the rank of W is 6."""
    rng, points = np.random.default_rng(seed), []
    for _ in range(contacts):
        axis, sign, p = int(rng.integers(3)), rng.choice([-1.0, 1.0]), rng.uniform(-1.0, 1.0, 3)
        p[axis] = -sign
        points.append(TouchPoint(_GROUND, 0, p, sign * np.eye(3)[axis]))
    inverse = np.array([[1.0, 1.0, 1.0, 3.0, 3.0, 3.0]])
    return assembled("between walls", np.zeros((1, 3)), inverse, _falling(1, 0.5, rng), points, friction)


def random_rank(contacts: int, rank: int, friction: float, seed: int) -> FCLIBProblem:
    """W = G^T G with random G of this many rows, q in its range; dense."""
    rng = np.random.default_rng(seed)
    G = rng.standard_normal((rank, 3 * contacts)) / np.sqrt(rank)
    W = scipy.sparse.csr_matrix(G.T @ G)
    return FCLIBProblem(
        0.5 * (W + W.T), G.T @ rng.standard_normal(rank), np.full(contacts, friction), f"random, rank {rank}"
    )


_KINDS: tuple[tuple[str, Callable[..., FCLIBProblem], tuple[tuple[float, ...], ...]], ...] = (
    ("stack", stack, ((3, 0.3), (5, 0.7), (8, 1.0), (10, 2.0), (20, 0.5), (20, 1.5), (40, 0.8), (100, 0.6))),
    ("wall", wall, ((3, 3, 0.3), (4, 4, 0.7), (6, 4, 1.5), (8, 6, 0.5), (10, 10, 0.6), (10, 12, 2.0))),
    ("tower", tower, ((3, 0.3), (6, 0.8), (10, 0.5), (20, 1.5), (40, 0.3), (50, 0.5))),
    ("spheres", spheres, ((8, 0.3), (30, 0.5), (60, 1.0), (100, 0.3), (200, 0.7), (300, 2.0))),
    (
        "scattered",
        scattered,
        (
            (3, 20, 0.3),
            (10, 60, 0.7),
            (20, 200, 0.5),
            (30, 120, 2.0),
            (50, 400, 1.0),
            (100, 500, 0.8),
            (200, 1000, 0.3),
        ),
    ),
    ("walled", walled, ((10, 0.3), (20, 1.0), (30, 2.0), (100, 0.7))),
    (
        "random",
        random_rank,
        ((10, 15, 0.3), (20, 30, 1.0), (40, 40, 0.5), (60, 90, 2.0), (100, 120, 0.8), (200, 300, 1.5)),
    ),
    ("arch", arch, ((5, 0.5), (9, 0.8), (15, 1.5), (31, 0.6))),
    ("masonry", masonry, ((10, 4, 0.8), (20, 5, 0.8), (40, 6, 0.5))),
    ("chain", chain, ((4, 0.3), (11, 0.3))),
    ("capsules", capsules, ((4, 4, 0.7), (8, 5, 0.7), (12, 8, 0.3))),
)


def collection(seed: int = 0) -> Iterator[tuple[str, Callable[[], FCLIBProblem]]]:
    """Names and makers of 55 problems of 7 to 1800 contacts, friction 0.3 to 2.

    Args:
        seed: Of all random numbers; another one makes other problems of the same kinds.
    """
    for kind, make, sizes in _KINDS:
        for number, arguments in enumerate(sizes):
            *counts, friction = arguments

            def made(
                make: Callable[..., FCLIBProblem] = make,
                counts: tuple[int, ...] = tuple(int(k) for k in counts),
                friction: float = friction,
                number: int = number,
            ) -> FCLIBProblem:
                return make(*counts, friction, 100 * seed + number)

            yield f"{kind}-{'x'.join(str(int(k)) for k in counts)}-F{friction:g}", made
