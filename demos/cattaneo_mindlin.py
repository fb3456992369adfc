"""Cattaneo and Mindlin: a ball pressed into a block, then moved along it, back and forth: partial slip and hysteresis.

    python demos/cattaneo_mindlin.py

The formulas and their assumptions are in verification/cattaneo_mindlin.py; this script computes the
load history of the hysteresis loop.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, Sphere

E, nu, R, F = 2.1e11, 0.3, 0.1, 0.1
a = 1e-3
up = a**2 / R

# Half of the block of demos/hertz.py, with coarser cells: symmetric in y = 0.
fine, cells, width = 4, 8, 16 * a


def place(x):
    k = np.abs(x - [[cells], [0], [0]])
    uniform = 4 / 3 * a * k / fine
    distance = uniform + (width - 4 / 3 * a * cells / fine) * (np.maximum(k - fine, 0) / (cells - fine)) ** 3
    return np.sign(x - [[cells], [0], [0]]) * distance


def block(friction, motion):
    return ContactProblem(
        mesh=coulomb.box((2 * cells, cells, cells), (2 * cells, cells, cells), place=place),
        material=Material(young=E, poisson=nu),
        clamps=[Clamp("front", "y"), Clamp("top")],
        contact=Contact("bottom", friction, foundation=Sphere((0.0, 0.0, -R), R), motion=motion),
        time=1.0,
    )


# Pressed without friction, as the theory has it.
normal = block(0.0, [(1.0, 0.0, 0.0, up)]).solve()
P = 2 * normal.contact_force[0::3].sum()
a = (0.75 * P * R * (1 - nu**2) / E) ** (1 / 3)
d = 3 * F * P / (16 * a) * 2 * (1 + nu) * (2 - nu) / E  # displacement of the ball at which all nodes would slip

print(f"pressed: P = {P:.5g} N; all slips from d = {d:.5g} m on")

# From there with friction: right, left, and right again.  Slip counts from where pressing has left the surface.
far = 0.85 * d
motion = [(1.0, 0.0, 0.0, up), (2.0, far, 0.0, up), (4.0, -far, 0.0, up), (6.0, far, 0.0, up)]
problem, history = block(F, motion), LoadHistory([1 + k / 4 for k in range(1, 21)], start=1.0)
pressed = replace(
    history.beginning(problem),
    displacement=normal.displacement,
    force_on_body=normal.force_on_body,
)
positions, forces = [], []
for step in history.steps(problem, pressed):
    positions.append(step.solution.problem.motions[0, 0] / d)
    forces.append(2 * step.solution.forces["force"][0] / (F * P))
    nodes = f"{step.row['stick']} nodes stick, {step.row['slip']} slip"
    print(f"displacement {positions[-1]:+.3f} d, Q = {forces[-1]:+.4f} F P, {nodes}")
print(step.solution.certificate)
print(f"dissipated from the first move on: {2 * step.state.energy.dissipated:.4g} J")

figure = Figure(figsize=(6, 4), layout="constrained")
axis = figure.subplots()
q = forces[3]
first, back = np.linspace(0, q, 100), np.linspace(-q, q, 200)
unloading = 2 * (1 - (q - back) / 2) ** (2 / 3) - (1 - q) ** (2 / 3) - 1
axis.plot(1 - (1 - first) ** (2 / 3), first, "k-", label="Mindlin")
axis.plot(unloading, back, "k-")
axis.plot(-unloading, -back, "k-")
axis.plot(positions, forces, "o", label="coulomb")
axis.set_xlabel("displacement of the ball over d")
axis.set_ylabel("Q / (F P)")
axis.legend()
Path("results").mkdir(exist_ok=True)
figure.savefig("results/cattaneo_mindlin.png", dpi=110)
