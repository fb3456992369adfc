"""Hertz: a rigid ball pressed into a steel block.  Contact radius and pressure compared with the formulas of 1882.

python demos/hertz.py

a^3 = 3 P R/(4 E*),   p(r) = p0 sqrt(1 - r^2/a^2),   p0 = 3 P/(2 pi a^2),   E* = E/(1 - nu^2)
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from mpi4py import MPI

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Sphere

E, nu, R = 2.1e11, 0.3, 0.1
a = 1e-3  # the intended contact radius, 1 mm: the ball moves up by a^2/R

# A quarter of a block of 32 a x 32 a x 16 a; cells of a/6 under the ball, growing with the distance from it.
fine, cells, width = 8, 16, 16 * a


def place(k):
    """Coordinates of node k along each axis."""
    uniform = 4 / 3 * a * k / fine
    return uniform + (width - 4 / 3 * a * cells / fine) * (np.maximum(k - fine, 0) / (cells - fine)) ** 3


problem = ContactProblem(
    mesh=coulomb.box((cells, cells, cells), (cells, cells, cells), place=place),
    material=Material(young=E, poisson=nu),
    clamps=[Clamp("left", "x"), Clamp("front", "y"), Clamp("top", "z")],  # two planes of symmetry, a fixed far end
    contact=Contact("bottom", friction=0.0, foundation=Sphere((0.0, 0.0, a**2 / R - R), R)),
)
solution = problem.solve()
print(solution.certificate)

# The force follows from the displacement of the ball, contact radius and pressure from the force.
surface, force = problem.surface, solution.contact_force[0::3]
P = 4 * problem.comm.allreduce(force.sum(), op=MPI.SUM)
a = (0.75 * P * R * (1 - nu**2) / E) ** (1 / 3)
p0 = 1.5 * P / (np.pi * a**2)
r, pressure = np.hypot(surface.x[:, 0], surface.x[:, 1]), force / surface.area
spread = problem.comm.allreduce(force @ r**2, op=MPI.SUM) / (P / 4)  # mean square distance: 2 a^2/5 in theory
print(f"P = {P:.4g} N: a = {1e3 * np.sqrt(2.5 * spread):.4f} mm, by the formula {1e3 * a:.4f} mm")
print(f"largest pressure {pressure.max() / 1e6:.0f} MPa, by the formula {p0 / 1e6:.0f} MPa")

figure = Figure(figsize=(6, 4), layout="constrained")
axis, s = figure.subplots(), np.linspace(0, 1.4 * a, 400)
axis.plot(1e3 * s, p0 / 1e6 * np.sqrt(np.maximum(1 - (s / a) ** 2, 0)), "k-", label="Hertz")
axis.plot(1e3 * r[r < s[-1]], pressure[r < s[-1]] / 1e6, "o", label="coulomb")
axis.set_xlabel("distance from the axis, mm")
axis.set_ylabel("pressure, MPa")
axis.legend()
Path("results").mkdir(exist_ok=True)
figure.savefig("results/hertz.png", dpi=110)
