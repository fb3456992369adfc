"""Press fit of a steel hub on a rigid pin, and the force that pulls the pin out again, against Lame's formula.

    python demos/press_fit.py

A quarter of the hub a < r < b between planes of symmetry.  The pin's radius grows by the interference d, then it is
pulled along its axis.  With no displacement along the axis at the ends (plane strain), the bore of area A carries

    p = E d (b^2 - a^2)/((1 + nu) a ((1 - 2 nu) a^2 + b^2)),   and the pull-out force is F p A
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import coulomb
from coulomb import Contact, ContactProblem, Cylinder, LoadHistory, Material, SymmetryPlane

E, nu, F = 2.1e11, 0.3, 0.15
a, b, length, d = 0.1, 0.2, 0.1, 5e-5


def place(x):
    r, angle = a + (b - a) * x[0], 0.5 * np.pi * x[1]
    return np.stack([r * np.cos(angle), r * np.sin(angle), length * x[2]])


problem = ContactProblem(
    mesh=coulomb.box((1.0, 1.0, 1.0), (6, 12, 4), place=place),
    material=Material(young=E, poisson=nu),
    clamps=[SymmetryPlane(face) for face in ("front", "back", "bottom", "top")],
    contact=Contact(
        "left",
        friction=F,
        foundation=Cylinder(point=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0), radius=a),
        gap=-d,  # negative: an interference
        gap_amplitude=[(0.0, 0.0), (1.0, 1.0)],
        motion=[(1.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 1e-4)],
    ),
)
p, area = E * d * (b**2 - a**2) / ((1 + nu) * a * ((1 - 2 * nu) * a**2 + b**2)), 0.5 * np.pi * a * length
pulled, force = [], []
for step in LoadHistory(times=[0.5, 1.0, *np.linspace(1.0, 2.0, 13)[1:]]).steps(problem):
    totals = step.solution.forces
    pulled.append(1e6 * step.solution.problem.motions[0, 2])
    force.append(totals["force"][2])
    if step.state.time == 1.0:
        print(f"pressure {totals['normal_force'] / area:.6g} Pa, Lame {p:.6g} Pa")
print(f"pull-out force {force[-1]:.6g} N, F p A = {F * p * area:.6g} N")
print(step.solution.certificate)

figure = Figure(figsize=(6, 4), layout="constrained")
axis = figure.subplots()
axis.axhline(F * p * area / 1e3, color="k", linewidth=1)
axis.plot(pulled, np.array(force) / 1e3, "o-")
axis.set_xlabel("displacement of the pin, micrometres")
axis.set_ylabel("pull-out force, kN (line: F p A)")
Path("results").mkdir(exist_ok=True)
figure.savefig("results/press_fit.png", dpi=110)
