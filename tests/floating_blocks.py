"""Elastic blocks on a rigid plane that contact alone holds, by a dense stiffness of their own."""

import itertools
from dataclasses import dataclass

import numpy as np
from conftest import dense_compliance

from coulomb.solvers import FrictionLaw, FrictionProblem, RigidMotions

YOUNG, POISSON = 2.1e11, 0.3


def brick_stiffness(size):
    """Stiffness of an eight-node brick (24, 24), nodes in the order of itertools.product((0, 1), repeat=3)."""
    lame, shear = YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON), YOUNG / 2 / (1 + POISSON)
    D = np.diag([2 * shear] * 3 + [shear] * 3)
    D[:3, :3] += lame
    corners = np.array(list(itertools.product((0, 1), repeat=3)))
    K = np.zeros((24, 24))
    for point in itertools.product((0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5), repeat=3):
        factors = np.where(corners == 1, point, 1.0 - np.array(point))
        slope = np.where(corners == 1, 1.0, -1.0) / size
        dN = np.stack([slope[:, k] * np.prod(np.delete(factors, k, axis=1), axis=1) for k in range(3)])
        B = np.zeros((6, 24))
        for k in range(3):
            B[k, k::3] = dN[k]
        for row, (i, j) in zip((3, 4, 5), ((0, 1), (1, 2), (2, 0)), strict=True):
            B[row, i::3], B[row, j::3] = dN[j], dN[i]
        K += B.T @ D @ B * np.prod(size) / 8
    return K


@dataclass
class FloatingBlock:
    """A block [0, a] x [0, b] x [0, c] m of n bricks, its lower face on the plane z = 0; its upper one on another plane
    if it is `between` two.

    Frames are (n, t1, t2) = (-z, x, y), on the upper face (z, x, y).
    """

    size: tuple[float, float, float] = (2.0, 1.0, 0.5)
    cells: tuple[int, int, int] = (4, 2, 1)
    between: bool = False

    def __post_init__(self):
        shape = tuple(n + 1 for n in self.cells)
        index = np.arange(np.prod(shape)).reshape(shape)
        self.points = np.stack(
            np.meshgrid(*(np.linspace(0, s, n) for s, n in zip(self.size, shape, strict=True)), indexing="ij"), axis=-1
        ).reshape(-1, 3)
        k = len(self.points)
        self.K = np.zeros((3 * k, 3 * k))
        brick = brick_stiffness(np.array(self.size) / self.cells)
        for cell in itertools.product(*(range(n) for n in self.cells)):
            nodes = [index[tuple(np.add(cell, corner))] for corner in itertools.product((0, 1), repeat=3)]
            dofs = (3 * np.array(nodes)[:, None] + np.arange(3)).ravel()
            self.K[np.ix_(dofs, dofs)] += brick
        self.bottom = np.flatnonzero(self.points[:, 2] == 0.0)
        self.top = np.flatnonzero(self.points[:, 2] == self.size[2])
        nodes = [(node, -1.0) for node in self.bottom] + [(node, 1.0) for node in self.top if self.between]
        self.B = np.zeros((3 * len(nodes), 3 * k))
        for row, (node, outward) in enumerate(nodes):
            self.B[3 * row, 3 * node + 2] = outward
            self.B[3 * row + 1, 3 * node] = self.B[3 * row + 2, 3 * node + 1] = 1.0
        centred = self.points - self.points.mean(axis=0)
        radius = np.linalg.norm(centred, axis=1).max()
        turns = [np.cross(e, centred).ravel() / radius for e in np.eye(3)]
        self.R = np.column_stack([np.tile(e, k) for e in np.eye(3)] + turns)
        self.names = ("x", "y", "z", "about x", "about y", "about z")

    def load(self, force, moment_about_z=0.0):
        """Equal forces on the nodes of the top face, with this sum, and a moment about z through the centre."""
        f = np.zeros(self.points.shape)
        f[self.top] = np.asarray(force) / len(self.top)
        arm = self.points[self.top] - self.points.mean(axis=0)
        arm[:, 2] = 0.0
        f[self.top] += moment_about_z * np.cross([0.0, 0.0, 1.0], arm) / np.sum(arm**2)
        return f.ravel()

    def springs(self):
        """Six springs at statically determinate places that make K regular."""
        K, stiffness = self.K.copy(), np.diag(self.K).mean()
        length, width, height = self.size
        a, b, c = (self._node(corner) for corner in ((0, 0, height), (length, 0, height), (0, width, height)))
        for dof in (3 * a, 3 * a + 1, 3 * a + 2, 3 * b + 1, 3 * b + 2, 3 * c + 2):
            K[dof, dof] += stiffness
        return K

    def _node(self, point):
        return int(np.linalg.norm(self.points - point, axis=1).argmin())

    def parts(self, f):
        """A, b, G, e of the problem under the loads f."""
        inverse = np.linalg.inv(self.springs())
        A = self.B @ inverse @ self.B.T
        return 0.5 * (A + A.T), self.B @ inverse @ f, (self.B @ self.R).T, self.R.T @ f


FRICTION, WEIGHT = 0.3, 1e6


def floating_problem(block, ratio, friction=FRICTION, moment=0.0):
    """A block under its weight and a push of `ratio` times what FRICTION can hold; newtons and metres."""
    push = ratio * FRICTION * WEIGHT
    A, b, G, e = block.parts(block.load((0.8 * push, 0.6 * push, -WEIGHT), moment))
    law = FrictionLaw.coulomb(np.full(len(block.bottom), friction))
    return FrictionProblem(dense_compliance(A), b, law, rigid=RigidMotions(G, e, block.names))


def clamped_problem(block, ratio):
    """The same block with its left face clamped."""
    push = ratio * FRICTION * WEIGHT
    free = np.flatnonzero(np.repeat(block.points[:, 0] > 0.0, 3))
    rows = np.flatnonzero(np.repeat(block.points[block.bottom, 0] > 0.0, 3))
    inverse, B = np.linalg.inv(block.K[np.ix_(free, free)]), block.B[np.ix_(rows, free)]
    A, b = B @ inverse @ B.T, B @ inverse @ block.load((0.8 * push, 0.6 * push, -WEIGHT))[free]
    return FrictionProblem(dense_compliance(0.5 * (A + A.T)), b, FrictionLaw.coulomb(np.full(len(rows) // 3, FRICTION)))
