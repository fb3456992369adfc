"""A block pulled along a plane until it slides, and back: the force is exactly F times the normal force.

python demos/sliding_block.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import coulomb
from coulomb import Contact, ContactProblem, LoadHistory, Material, PrescribedDisplacement

F = 0.3

# The top, held flat, moves down by 0.2 mm until t = 1, then to the right by 2 mm until t = 3, and back until t = 5.
down = PrescribedDisplacement("top", (0.0, 0.0, -2e-4), "z", amplitude=[(0.0, 0.0), (1.0, 1.0)])
along = PrescribedDisplacement("top", (2e-3, 0.0, 0.0), "xy", amplitude=[(1.0, 0.0), (3.0, 1.0), (5.0, 0.0)])
problem = ContactProblem(
    mesh=coulomb.box((1.0, 1.0, 1.0), (5, 5, 5)),
    material=Material(young=2.1e11, poisson=0.3),
    clamps=[down, along],
    contact=Contact("bottom", friction=F),
)

positions, ratios = [], []
for step in LoadHistory([1 + k / 10 for k in range(41)], tolerance=1e-9).steps(problem):
    row = step.row
    positions.append(1e3 * np.interp(step.state.time, [1, 3, 5], [0, 2e-3, 0]))
    ratios.append(row["force_x"] / (F * row["normal_force"]))
    print(f"{positions[-1]:.1f} mm: T = {ratios[-1]:+.9f} F N, {row['stick']} nodes stick, {row['slip']} slip")
print(step.solution.certificate)
energy = step.state.energy
print(
    f"work {energy.prescribed:.0f} J: {energy.elastic:.0f} J elastic, {energy.dissipated:.0f} J dissipated by friction,"
)
print(f"and {energy.imbalance:.0f} J time-stepping error, which decreases with the step size")

figure = Figure(figsize=(6, 4), layout="constrained")
axis = figure.subplots()
axis.axhline(-1, color="k", linewidth=1, label="-F N, F N")
axis.axhline(1, color="k", linewidth=1)
axis.plot(positions, ratios, "o-", label="coulomb")
axis.set_xlabel("displacement of the top, mm")
axis.set_ylabel("T / (F N)")
axis.legend()
Path("results").mkdir(exist_ok=True)
figure.savefig("results/sliding_block.png", dpi=110)
