"""A cube that slides on a tilted plane, in a uniform state of stress, which linear elements represent exactly.

    python demos/patch.py

Top traction (F p, 0, -p) in the axes of the cube; displacements prescribed on its sides; slip s0 along x everywhere:

    u = (s0 + (nu (1 + nu) p/E) x + (F p/G) z, 0, -((1 - nu^2) p/E) z),   contact traction (-F p, 0, p)
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import coulomb
from coulomb import Contact, ContactProblem, Material, Plane, PrescribedDisplacement, Traction

E, nu, p, F, s0 = 2.1e11, 0.3, 4e7, 0.3, 1e-4
G = E / (2 * (1 + nu))

# The axes of the cube: z, the plane's normal, tilted by 30 degrees; the cube is rotated about it.
tilt, turn = np.radians(30.0), np.radians(20.0)
z = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
x = np.array([1.0, 0.0, 0.0])
x = np.cos(turn) * x + np.sin(turn) * np.cross(z, x)
axes = np.column_stack([x, np.cross(z, x), z])


def exact(points):
    x, y, z = axes.T @ points
    along = s0 + nu * (1 + nu) * p / E * x + F * p / G * z
    return axes @ np.stack([along, 0 * y, -(1 - nu**2) * p / E * z])


problem = ContactProblem(
    mesh=coulomb.box((1.0, 1.0, 1.0), (4, 5, 3), "tetrahedron", place=lambda points: axes @ points),
    material=Material(young=E, poisson=nu),
    clamps=[PrescribedDisplacement(face, exact) for face in ("left", "right", "front", "back")],
    tractions=[Traction("top", tuple(axes @ (F * p, 0.0, -p)))],
    contact=Contact("bottom", friction=F, foundation=Plane((0.0, 0.0, 0.0), tuple(axes[:, 2]))),
)
solution = problem.solve(tolerance=1e-10)
surface = problem.surface
traction = -surface.vectors(solution.contact_force.reshape(-1, 3)) @ axes / surface.area[:, None]
error = np.abs(solution.displacement - exact(problem.elasticity.x.T).T).max() / s0
print(f"pressure {traction[:, 2].min():.10g} to {traction[:, 2].max():.10g} Pa, known {p:g}")
print(f"friction {traction[:, 0].min():.10g} to {traction[:, 0].max():.10g} Pa, known {-F * p:g}")
print(f"displacement to {error:.0e} of the slip")
print(solution.certificate)

figure = Figure(figsize=(6, 4), layout="constrained")
axis = figure.subplots()
nodes = np.arange(len(traction))
for known, values, name in ((p, traction[:, 2], "pressure"), (F * p, -traction[:, 0], "friction")):
    axis.axhline(known / 1e6, color="k", linewidth=1)
    axis.plot(nodes, values / 1e6, "o", label=name)
axis.set_xlabel("contact node")
axis.set_ylabel("traction, MPa (lines: exact)")
axis.set_ylim(0.0, 1.1 * p / 1e6)
axis.legend()
Path("results").mkdir(exist_ok=True)
figure.savefig("results/patch.png", dpi=110)
