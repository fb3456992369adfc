"""Random problems whose A has no full rank, each with a solution, and a judge that shares no code with the package."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Singular:
    """A = H^T H; solved with Tresca's law (friction 0), Coulomb's (cohesion 0) or both.

    Attributes:
        H: Shape (rank or more, 3 m).
        b: Shape (3 m,).
        cohesion: Shape (m,).
        friction: Shape (m,).
        title: What it is made of.
    """

    H: np.ndarray
    b: np.ndarray
    cohesion: np.ndarray
    friction: np.ndarray
    title: str

    @property
    def A(self):
        return self.H.T @ self.H

    @property
    def compliance(self):
        return np.sum(self.H**2) / self.H.shape[1]

    @property
    def m(self):
        return len(self.friction)

    def objective(self, x):
        return 0.5 * np.sum((self.H @ x) ** 2) - self.b @ x

    def off(self, x):
        """|x - P(x - (A x - b)/a)| in displacements over |b|: not over |x|, which parts without meaning make large."""
        w = self.H.T @ (self.H @ x) - self.b
        v = (x - w / self.compliance).reshape(-1, 3)
        bound = self.cohesion + self.friction * np.maximum(x[0::3], 0.0)
        size = np.hypot(v[:, 1], v[:, 2])
        shrink = np.where(size > bound, bound / np.where(size > 0.0, size, 1.0), 1.0)
        p = np.column_stack([np.maximum(v[:, 0], 0.0), shrink[:, None] * v[:, 1:]]).ravel()
        return self.compliance * np.linalg.norm(x - p) / np.linalg.norm(self.b)


def rigid_bodies(m, rng):
    """H of bodies that touch at m points, each other or the ground, with masses over two decades."""
    bodies = int(rng.integers(1, max(2, m // 4) + 1))
    H = np.zeros((6 * bodies, 3 * m))
    for i in range(m):
        R = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        both = bodies > 1 and rng.random() < 0.5
        pair = rng.choice(bodies, 2, replace=False) if both else [rng.integers(bodies)]
        for sign, k in zip((1.0, -1.0), pair, strict=False):
            arms = np.cross(rng.uniform(-1.0, 1.0, 3), R)
            H[6 * k : 6 * k + 6, 3 * i : 3 * i + 3] = sign * np.vstack([R.T, arms.T])
    mass = np.repeat(10.0 ** rng.uniform(-1.0, 1.0, bodies), 6) * np.tile([1.0, 1.0, 1.0, 0.4, 0.4, 0.4], bodies)
    return H / np.sqrt(mass)[:, None]


def singular_problem(seed):
    """Half rank, rank 1 to 6, or rigid bodies; contacts and slip bounds over decades; any units; up to 30 contacts."""
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 31))
    kind, law = rng.choice(["half", "few", "bodies"]), rng.choice(["tresca", "coulomb", "cohesion"])
    if kind == "bodies":
        H = rigid_bodies(m, rng)
    else:
        rank = max(1, 3 * m // 2) if kind == "half" else int(rng.integers(1, 7))
        H = rng.standard_normal((rank, 3 * m)) * 10.0 ** rng.uniform(-rng.choice([0, 1, 3]), 0.0, rank)[:, None]
        if rng.random() < 0.4:
            H = H * np.repeat(10.0 ** rng.uniform(-rng.choice([1, 2, 3]), 0.0, m), 3)
    a = np.sum(H**2) / (3 * m)
    made = rng.random() < 0.5
    b = H.T @ rng.standard_normal(len(H))
    force = 1.0 if made else np.abs(b).max() / a
    g = force * rng.choice([0.01, 0.3, 3.0]) * 10.0 ** rng.uniform(-rng.choice([0, 0, 2, 4]), 0.0, m)
    g[rng.random(m) < 0.1] = 0.0
    cohesion = np.zeros(m) if law == "coulomb" else g
    friction = (0.0 if law == "tresca" else rng.choice([0.1, 0.3, 0.6, 1.0])) * rng.uniform(0.5, 1.5, m)
    if made:  # from a solution: open, sticking, slipping, and slipping without pressure
        state = rng.choice(4, m, p=[0.25, 0.3, 0.35, 0.1])
        x_n = np.where((state == 1) | (state == 2), rng.uniform(0.1, 2.0, m), 0.0)
        angle, part = rng.uniform(0.0, 2.0 * np.pi, m), np.where(state == 1, rng.uniform(0.0, 0.9, m), 1.0)
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        x = np.column_stack([x_n, (part * (cohesion + friction * x_n))[:, None] * way]).ravel()
        slip = np.where(state != 1, rng.uniform(0.1, 2.0, m), 0.0)
        w = np.column_stack([np.where(state == 0, rng.uniform(0.1, 2.0, m), 0.0), -slip[:, None] * way]).ravel()
        b = H.T @ (H @ x) - a * w
    newton, metre = 10.0 ** rng.integers(-6, 7), 10.0 ** rng.integers(-9, 3)
    title = f"{seed}: {kind}, {law}, {m} contacts, {'made' if made else 'range'}"
    return Singular(H * np.sqrt(metre / newton), b * metre, cohesion * newton, friction, title)
