"""Manufactured solutions with contact: displacements that are polynomials, whose loads follow exactly.

On the box 0 < x < L a displacement u, of polynomials on both sides of a plane x = c, has the stress s = C e(u).  The
body force -div s, tractions s n on some faces and u itself on the others make u the answer; at the bottom, in contact
with a plane, s n must obey the law of contact:

- sticking: u = z v, so that u = 0 there, with pressure and |t| < F p;
- sliding: u_z = 0 there, and u_x, u_y grow with z as 1 + a z, so that t = -mu a u: F = |t|/p is a function of place;
- partly open: u_z = w and u_x,z = F p/mu - w_x, u_y,z = -w_y there, with the pressure p = P (c - x)+^2; the gap is
  -w, and larger by (x - c)+^2 beyond x = c.

On a quarter ring in contact with a rigid cylinder in its bore, u = (r^2 - a^2) v sticks.  Its totals have the part of
the tractions of its curved faces that are s n with the n of circles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from coulomb.arrays import FloatArray
from coulomb.fem.bodies import Material, PrescribedDisplacement, Traction
from coulomb.fem.geometry import Coefficient, Cylinder
from coulomb.fem.meshes import NamedMesh
from coulomb.model.contact import Contact
from coulomb.model.probes import Probe
from coulomb.model.problem import ContactProblem

MATERIAL = Material(young=2e11, poisson=0.3)
MU = 2e11 / 2.6
LAMBDA = 2e11 * 0.3 / (1.3 * 0.4)
STRAIN = 1e-4
"""Size of the strains."""

NORMALS = {
    "left": (0, -1.0),
    "right": (0, 1.0),
    "front": (1, -1.0),
    "back": (1, 1.0),
    "bottom": (2, -1.0),
    "top": (2, 1.0),
}
"""Axis and sign of the outward normal of the faces of a box."""


@dataclass(frozen=True)
class Poly:
    """A polynomial in x, y, z with the coefficients c[i, j, k] of x^i y^j z^k."""

    c: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        """Values at points x (3, k), shape (k,)."""
        powers = [one ** np.arange(count)[:, None] for one, count in zip(x, self.c.shape, strict=True)]
        values: FloatArray = np.einsum("ijk,im,jm,km->m", self.c, *powers)
        return values

    def __add__(self, other: Poly | float) -> Poly:
        b = _poly(other).c
        c = np.zeros(np.maximum(self.c.shape, b.shape))
        c[tuple(map(slice, self.c.shape))] += self.c
        c[tuple(map(slice, b.shape))] += b
        return Poly(c)

    def __mul__(self, other: Poly | float) -> Poly:
        b = _poly(other).c
        c = np.zeros(np.add(self.c.shape, b.shape) - 1)
        for (i, j, k), value in np.ndenumerate(self.c):
            c[i : i + b.shape[0], j : j + b.shape[1], k : k + b.shape[2]] += value * b
        return Poly(c)

    __radd__, __rmul__ = __add__, __mul__

    def __sub__(self, other: Poly | float) -> Poly:
        return self + _poly(other) * -1.0

    def __neg__(self) -> Poly:
        return self * -1.0

    def d(self, axis: int) -> Poly:
        """Its derivative."""
        count = self.c.shape[axis]
        if count == 1:
            return Poly(np.zeros((1, 1, 1)))
        powers = np.arange(1.0, count).reshape(np.where(np.arange(3) == axis, -1, 1))
        return Poly(powers * np.delete(self.c, 0, axis))


def _poly(value: Poly | float) -> Poly:
    return value if isinstance(value, Poly) else Poly(np.full((1, 1, 1), float(value)))


def _monomial(axis: int) -> Poly:
    c = np.zeros(np.ones(3, dtype=int) + np.eye(3, dtype=int)[axis])
    c.flat[1] = 1.0
    return Poly(c)


X, Y, Z = (_monomial(axis) for axis in range(3))
Field3 = tuple[Poly, Poly, Poly]


@dataclass(frozen=True)
class Piece:
    """A displacement, its stress and body force, as polynomials."""

    u: Field3
    stress: tuple[tuple[Poly, ...], ...] = field(init=False)
    body_force: tuple[Poly, ...] = field(init=False)

    def __post_init__(self) -> None:
        grad = [[self.u[i].d(j) for j in range(3)] for i in range(3)]
        trace = grad[0][0] + grad[1][1] + grad[2][2]
        s = tuple(
            tuple((grad[i][j] + grad[j][i]) * MU + (trace * LAMBDA if i == j else 0.0) for j in range(3))
            for i in range(3)
        )
        object.__setattr__(self, "stress", s)
        object.__setattr__(self, "body_force", tuple(-(s[i][0].d(0) + s[i][1].d(1) + s[i][2].d(2)) for i in range(3)))


@dataclass(frozen=True)
class Manufactured:
    """A problem on a box (0, lengths), or on a quarter ring, and its answer.

    Attributes:
        name: What it is called.
        lengths: Edges in metres; of a ring inner and outer radius and length along z.
        pieces: For x <= cut and beyond.
        cut: There is contact for x < cut.
        held: Faces with prescribed displacements.
        guided: Those of them that are free along z, with the traction along it.  Where a held face meets the contact,
            supports carry a strip of that, half a cell wide, and totals of the contact lack it.
        friction: Coefficient of friction.
        gap: Given gap, metres.
        probed: Places relative to the lengths.
        ring: Whether it is a quarter ring, `array_mesh.quarter_ring`, in contact at its bore.
    """

    name: str
    lengths: tuple[float, float, float]
    pieces: tuple[Piece, Piece]
    cut: float
    held: tuple[str, ...]
    friction: Coefficient
    gap: Coefficient = 0.0
    probed: tuple[tuple[float, float, float], ...] = ((0.3, 0.4, 0.0), (0.55, 0.7, 0.5), (0.81, 0.23, 1.0))
    ring: bool = False
    guided: tuple[str, ...] = ()

    def _at(self, of: Callable[[Piece], tuple[Poly, ...]], x: FloatArray) -> FloatArray:
        near, far = (np.stack([value(x) for value in of(piece)]) for piece in self.pieces)
        found: FloatArray = np.where(x[0] <= self.cut, near, far)
        return found

    def u(self, x: FloatArray) -> FloatArray:
        """Displacement at points x (3, k), shape (3, k)."""
        return self._at(lambda piece: piece.u, x)

    def stress(self, x: FloatArray) -> FloatArray:
        """Shape (3, 3, k)."""
        return self._at(lambda piece: tuple(s for row in piece.stress for s in row), x).reshape(3, 3, -1)

    def body_force(self, x: FloatArray) -> FloatArray:
        return self._at(lambda piece: piece.body_force, x)

    @property
    def contact(self) -> str:
        return "left" if self.ring else "bottom"

    def normal(self, face: str, x: FloatArray) -> FloatArray:
        """The outward normal, shape (3, k)."""
        if self.ring:
            if face in ("left", "right"):
                r = np.hypot(x[0], x[1])
                radial: FloatArray = np.stack([x[0] / r, x[1] / r, 0.0 * r])
                return -radial if face == "left" else radial
            # `quarter_ring`: front and back are the ends of the quarter
            axis, sign = {"front": (1, -1.0), "back": (0, -1.0), "bottom": (2, -1.0), "top": (2, 1.0)}[face]
        else:
            axis, sign = NORMALS[face]
        n = np.zeros_like(x)
        n[axis] = sign
        return n

    def traction(self, face: str, x: FloatArray) -> FloatArray:
        """On a face, shape (3, k)."""
        found: FloatArray = np.einsum("ijk,jk->ik", self.stress(x), self.normal(face, x))
        return found

    def _traction_along_z(self, face: str, x: FloatArray) -> FloatArray:
        found: FloatArray = self.traction(face, x) * np.array([[0.0], [0.0], [1.0]])
        return found

    def pressure(self, x: FloatArray) -> FloatArray:
        """On the contact face, shape (k,)."""
        found: FloatArray = -np.einsum("ik,ik->k", self.traction(self.contact, x), self.normal(self.contact, x))
        return found

    def slip(self, x: FloatArray) -> FloatArray:
        """On the contact face where it is closed, shape (3, k)."""
        n, u = self.normal(self.contact, x), self.u(x)
        found: FloatArray = np.where(x[0] <= self.cut, u - n * np.einsum("ik,ik->k", u, n), 0.0)
        return found

    def _largest(self, of: Callable[[FloatArray], FloatArray], face: str | None = None) -> FloatArray:
        """The largest value on a face or in the body, by grids that contract to it, shape (1,)."""
        ends = np.array([[0.0, 1.0]] * 3)
        if face is not None:
            axis, sign = NORMALS[face]
            ends[axis] = 0.5 + 0.5 * sign
        for _ in range(12):
            lines = [np.linspace(low, high, 41 if high > low else 1) for low, high in ends]
            grid = np.stack(np.meshgrid(*lines, indexing="ij")).reshape(3, -1)
            values = of(self.place(grid))
            best, width = grid[:, np.argmax(values)], 0.1 * (ends[:, 1] - ends[:, 0])
            ends = np.clip(np.column_stack([best - width, best + width]), ends[:, :1], ends[:, 1:])
        return np.array([values.max()])

    def problem(self, mesh: NamedMesh) -> ContactProblem:
        """On a mesh of the body."""
        others = [face for face in NORMALS if face not in (self.contact, *self.held)]
        foundation = Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), self.lengths[0]) if self.ring else None
        return ContactProblem(
            mesh,
            MATERIAL,
            [PrescribedDisplacement(face, self.u, "xy" if face in self.guided else "xyz") for face in self.held],
            Contact(self.contact, self.friction, gap=self.gap, foundation=foundation),
            [
                *(Traction(face, partial(self.traction, face)) for face in others),
                *(Traction(face, partial(self._traction_along_z, face)) for face in self.guided),
            ],
            body_force=self.body_force,
            probes=[Probe(f"p{k}", point) for k, point in enumerate(self.points)],
        )

    @property
    def points(self) -> FloatArray:
        """Places of the probes, shape (k, 3)."""
        q = np.array(self.probed)
        return self.place(q.T).T

    def place(self, q: FloatArray) -> FloatArray:
        """Places of the coordinates q (3, k) in the unit cube."""
        a, b, length = self.lengths
        if not self.ring:
            return np.stack([a * q[0], b * q[1], length * q[2]])
        r, angle = a + (b - a) * q[0], 0.5 * np.pi * q[1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), length * q[2]])

    def measure(self, q: FloatArray, face: str | None = None) -> FloatArray:
        """Volume or area of the body per volume or area of the unit cube, shape (k,)."""
        if not self.ring:
            sizes = np.array(self.lengths)
            return np.full(q.shape[1], np.prod(np.delete(sizes, [] if face is None else NORMALS[face][0])))
        a, b, length = self.lengths
        r = a + (b - a) * q[0]
        axis = None if face is None else NORMALS[face][0]
        parts = (np.full_like(r, b - a), 0.5 * np.pi * r, np.full_like(r, length))
        product: FloatArray = np.prod([part for k, part in enumerate(parts) if k != axis], axis=0)
        return product

    def _gauss(self, face: str | None) -> tuple[FloatArray, FloatArray]:
        """Places (3, k) and weights (k,) on a face or in the body."""
        n = np.arange(1.0, 12.0)
        t, vectors = np.linalg.eigh(np.diag(n / np.sqrt(4.0 * n**2 - 1.0), 1), UPLO="U")  # Golub and Welsch 1969
        t, w = 0.5 + 0.5 * t, vectors[0] ** 2
        part = min(self.cut / self.lengths[0], 1.0) if not self.ring else 1.0
        lines = [(np.append(part * t, part + (1.0 - part) * t), np.append(part * w, (1.0 - part) * w)), (t, w), (t, w)]
        if face is not None:
            axis, sign = NORMALS[face]
            lines[axis] = (np.array([0.5 + 0.5 * sign]), np.ones(1))
        q = np.stack([one.ravel() for one in np.meshgrid(*(line[0] for line in lines), indexing="ij")])
        weights = np.prod(np.meshgrid(*(line[1] for line in lines), indexing="ij"), axis=0).ravel()
        return self.place(q), weights * self.measure(q, face)

    def exact(self) -> Mapping[str, FloatArray]:
        """The totals by their place in summary.json, each of shape (1,) or (3,)."""
        x, w = self._gauss(self.contact)
        t, p, slip = self.traction(self.contact, x), self.pressure(x), self.slip(x)
        found = {f"totals.{name}": value for name, value in zip(("force", "moment"), _resultants(x, t, w), strict=True)}
        found["totals.normal_force"] = _one(float(w @ p))
        found["totals.contact_area"] = _one(float(np.sum(w[x[0] <= self.cut])))
        found["totals.centre_of_pressure"] = x @ (w * p) / (float(w @ p))
        found["totals.dissipated_energy"] = _one(-float(w @ np.einsum("ik,ik->k", t, slip)))
        found["totals.greatest_slip"] = self._largest(lambda x: np.linalg.norm(self.slip(x), axis=0), self.contact)
        found["totals.greatest_pressure"] = self._largest(self.pressure, self.contact)
        found["maximum.displacement"] = self._largest(lambda x: np.linalg.norm(self.u(x), axis=0))
        for face in self.held:
            y, v = self._gauss(face)
            carried = [[1], [1], [0]] if face in self.guided else 1.0
            force, moment = _resultants(y, self.traction(face, y) * carried, v)
            found[f"reactions.prescribed_displacement_{face}.force"] = force
            found[f"reactions.prescribed_displacement_{face}.moment"] = moment
        for k, point in enumerate(self.points):
            at = point[:, None]
            found[f"probes.p{k}.displacement"] = self.u(at)[:, 0]
            if self.probed[k][NORMALS[self.contact][0]] == 0.0:
                found[f"probes.p{k}.pressure"], found[f"probes.p{k}.slip"] = self.pressure(at), self.slip(at)[:, 0]
        y, v = self._gauss(None)
        s = self.stress(y)
        trace = np.einsum("iik->k", s)
        density = (np.einsum("ijk,ijk->k", s, s) - 0.3 / 1.3 * trace**2) / (4.0 * MU)
        found["strain_energy"] = _one(float(v @ density))
        return found


def _one(value: float) -> FloatArray:
    return np.array([value])


def _resultants(x: FloatArray, t: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Force and moment about the origin of tractions t (3, k) at x (3, k) with weights (k,), shapes (3,)."""
    return t @ w, np.cross(x.T, t.T).T @ w


def sticking(held: tuple[str, ...]) -> Manufactured:
    """With u prescribed on some faces."""
    v = (
        (X * X - X * Y + 0.4 * (Y * Y * Y) + 0.5 * Z) * 0.3,
        (0.2 + X * Y * Y - 0.6 * X + Z * X) * 0.3,
        -(1.0 + 0.6 * X - 0.9 * (X * X * Y) + 0.5 * (Y * Y) - 0.5 * Z * X),
    )
    piece = Piece((Z * v[0] * STRAIN, Z * v[1] * STRAIN, Z * v[2] * STRAIN))
    return Manufactured(f"sticking, held {' and '.join(held)}", (1.2, 1.0, 0.8), (piece, piece), np.inf, held, 0.4)


def sliding(held: tuple[str, ...]) -> Manufactured:
    """With u prescribed on some faces."""
    S, T = 1.0 + 0.5 * X - 0.4 * Y * Y * X, 0.3 + 0.3 * X * X - 0.5 * Y
    grows = 1.0 + Z * (0.2 + 0.1 * X) + 0.15 * Z * Z
    u = (S * grows, T * grows, -Z * (1.0 + 0.5 * Y - 0.6 * X * Y * Y + 0.4 * X * X) + Z * Z * (0.3 * X - 0.2))
    piece = Piece((u[0] * STRAIN, u[1] * STRAIN, u[2] * STRAIN))
    made = Manufactured(f"sliding, held {' and '.join(held)}", (1.2, 1.0, 0.8), (piece, piece), np.inf, held, 0.0)

    def friction(x: FloatArray) -> FloatArray:
        t = made.traction("bottom", x * np.array([[1.0], [1.0], [0.0]]))
        found: FloatArray = np.hypot(t[0], t[1]) / t[2]
        return found

    return replace(made, friction=friction)


def partly_open(held: tuple[str, ...], cut: float = 0.77) -> Manufactured:
    """With contact for x < cut, and u prescribed on some faces."""
    F, P, M = 0.25, 3.0 * STRAIN * MU, LAMBDA + 2.0 * MU
    W = (0.3 * X * Y - 0.5 * Y * Y + 0.4 * X * X * X) * STRAIN
    S = (1.0 + 0.4 * X + 0.3 * Y * Y) * (0.5 * STRAIN)
    pieces = []
    for p in ((cut + -1.0 * X) * (cut + -1.0 * X) * (1.0 + 0.5 * Y) * P, Poly(np.zeros((1, 1, 1)))):
        u = (
            S + Z * (p * (F / MU) - W.d(0)) + Z * Z * X * (0.3 * STRAIN),
            -Z * W.d(1) + Z * Z * Y * Y * (0.2 * STRAIN),
            W - Z * (p + S.d(0) * LAMBDA) * (1.0 / M) + Z * Z * (0.3 * STRAIN) * X,
        )
        pieces.append(Piece(u))

    def gap(x: FloatArray) -> FloatArray:
        found: FloatArray = -W(x) + 0.5 * STRAIN * np.maximum(x[0] - cut, 0.0) ** 2
        return found

    guided = tuple(face for face in held if face != "top")
    name = f"partly open, held {' and '.join(held)}"
    return Manufactured(name, (1.2, 1.0, 0.8), (pieces[0], pieces[1]), cut, held, F, gap, guided=guided)


def ring(held: tuple[str, ...]) -> Manufactured:
    """With u prescribed on some faces, as the rim, "right"."""
    a = 0.5
    g = X * X + Y * Y - a * a
    v = (-(1.0 + 0.4 * Z * Y) * X + 0.2 * Y * Z, -(1.0 + 0.3 * X * Z) * Y - 0.1 * X, 0.2 * Z + 0.2 * X * Y)
    piece = Piece((g * v[0] * STRAIN, g * v[1] * STRAIN, g * v[2] * STRAIN))
    return Manufactured(f"ring, held {' and '.join(held)}", (a, 1.0, 0.6), (piece, piece), np.inf, held, 0.6, ring=True)


def distorted(lengths: tuple[float, float, float]) -> Callable[[FloatArray], FloatArray]:
    """A map of the box onto itself that moves its inside, and nodes of its faces within these, by up to a tenth."""
    sizes = np.array(lengths)[:, None]

    def place(x: FloatArray) -> FloatArray:
        q = x / sizes
        s = np.sin(np.pi * q)
        shift = [s[0] * (q[1] - 0.3) * (1.0 + q[2]), s[1] * (0.6 - q[2]) * (0.5 + q[0]), s[2] * (q[0] - 0.5)]
        moved: FloatArray = (q + 0.12 * np.stack(shift)) * sizes
        return moved

    return place
