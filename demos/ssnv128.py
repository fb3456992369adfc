"""SSNV128 of code_aster: a plate pressed onto a rigid line and pushed along it; open, slipping and sticking zones.

    python demos/ssnv128.py

Mesh, loads and reference values are in coulomb/verification/ssnv128.py.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from coulomb.verification.ssnv128 import DISPLACEMENTS, PLACES, problem

solution = problem().solve()
print(solution.certificate)

# The contact line at y = 0, from left to right.
surface = solution.problem.surface
line = np.flatnonzero(surface.x[:, 1] < 1e-9)
line = line[np.argsort(surface.x[line, 0])]
x, u = surface.x[line, 0], solution.displacement[surface.nodes[line], 0]
status, pressure = solution.at_nodes.status[line], (solution.contact_force[0::3] / surface.area)[line]
for place, known in zip(PLACES, DISPLACEMENTS, strict=True):
    print(f"x = {1e3 * place:5.2f} mm: u_x = {np.interp(place, x, u):.3e} m, code_aster's manual {known:.2e} m")

figure = Figure(figsize=(6, 6), layout="constrained")
above, below = figure.subplots(2, 1, sharex=True)
for number, name in enumerate(("open", "stick", "slip")):
    here = status == number
    above.plot(1e3 * x[here], 1e6 * u[here], "o", label=name)
    below.plot(1e3 * x[here], pressure[here] / 1e6, "o", label=name)
above.plot(1e3 * np.array(PLACES), 1e6 * np.array(DISPLACEMENTS), "k+", markersize=12, label="code_aster's manual")
above.set_ylabel("u_x, micrometres")
below.set_ylabel("pressure, MPa")
below.set_xlabel("x, mm")
above.legend()
Path("results").mkdir(exist_ok=True)
figure.savefig("results/ssnv128.png", dpi=110)
