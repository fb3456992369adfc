"""The shape of a punch that presses evenly: the profile for which the pressure under it is the same everywhere.

An elastic punch, bonded above, presses on a flat plate most in its middle.  Its profile is found by L-BFGS: the nodes
of its mesh are moved, and the adjoint gradient along the places of all nodes (`places`) is one linear system, with
friction, and a certificate at every iterate.  What it finds is known: the shape that an even pressure makes flat.

python demos/even_pressure.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import minimize

import coulomb

SIDE, HEIGHT, CELLS, FRICTION = 0.1, 0.04, 8, 0.1
RUBBER = coulomb.Material(young=1e7, poisson=0.4)
DEPTH = 4e-4  # metres, by which the punch is pressed down
PLATE = coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
mesh = coulomb.box((SIDE, SIDE, HEIGHT), (CELLS, CELLS, 4))


def number(x):
    """The number of the contact point at a place, on the grid of the face."""
    i, j = (np.rint(axis / SIDE * CELLS).astype(int) for axis in x[:2])
    return i * (CELLS + 1) + j


def shaped(profile):
    """The mesh with its bottom raised by the profile at the points of the grid, metres, and its top where it was."""
    return coulomb.moved(mesh, lambda x: np.stack([0.0 * x[0], 0.0 * x[0], profile[number(x)] * (1.0 - x[2] / HEIGHT)]))


def pressed(profile):
    """The answer for a punch of this profile."""
    return coulomb.ContactProblem(
        shaped(profile),
        RUBBER,
        [coulomb.PrescribedDisplacement("top", (0.0, 0.0, -DEPTH))],
        coulomb.Contact("bottom", friction=FRICTION, foundation=PLATE),
    ).solve(tolerance=1e-10)


def unevenness(profile):
    """Variance of the forces over the areas of the flat face, over the square of their mean, and its derivatives along
    the profile, per metre."""
    answer = pressed(profile)
    assert answer.valid
    nodes, x = answer.at_nodes, answer.contact_force
    edges = (np.minimum(nodes.x[:, :2], SIDE - nodes.x[:, :2]) < 1e-9).sum(axis=1)
    area = (SIDE / CELLS) ** 2 / 2.0**edges
    pressure, share = nodes.force[:, 0] / area, area / SIDE**2
    mean = share @ pressure
    relative = pressure / mean - 1.0
    of_pressure = 2.0 * share * (relative - share @ (relative * (relative + 1.0))) / mean
    of_force = np.zeros_like(x)
    of_force[0::3] = of_pressure / area
    places = answer.problem.elasticity.x
    raised = 1.0 - places[:, 2] / HEIGHT  # of a node, by what the profile is raised below it, to first order
    found = np.bincount(number(places.T), answer.gradient(of_force).places()[:, 2] * raised, len(profile))
    return share @ relative**2, found


def of_friction(x):
    """Of the last answer, between the points of the grid, pascals, shape (3, k)."""
    return rubbed(x[:2].T).T


size = 1e-5  # metres: of the profile, for the optimiser
flat = np.zeros((CELLS + 1) ** 2)
steps = []
result = minimize(
    lambda scaled: tuple(part * by for part, by in zip(unevenness(size * scaled), (1.0, size), strict=True)),
    flat,
    jac=True,
    method="L-BFGS-B",
    options={"maxiter": 60, "ftol": 1e-12, "gtol": 1e-7},
    callback=lambda scaled: steps.append(scaled),
)
profile = size * result.x
before, after = pressed(flat), pressed(profile)
for name, answer in (("flat punch", before), ("its profile found", after)):
    pressure = answer.at_nodes.pressure
    print(f"{name}: pressure {pressure.min() / 1e3:.1f} to {pressure.max() / 1e3:.1f} kPa, valid: {answer.valid}")
print(f"{len(steps)} steps of L-BFGS, {result.nfev} answers with their gradients")

# The flat punch under the same even pressure without a plate, and under the friction of the last answer as a traction.
grid = np.linspace(0.0, SIDE, CELLS + 1)
friction = np.zeros((len(flat), 3))
friction[number(after.at_nodes.x.T)] = after.at_nodes.friction_traction
rubbed = RegularGridInterpolator((grid, grid), friction.reshape(CELLS + 1, CELLS + 1, 3))
free = coulomb.ContactProblem(
    mesh,
    RUBBER,
    [coulomb.Clamp("top")],
    coulomb.Contact("bottom", friction=0.0, gap=1.0),  # out of reach
    [coulomb.Pressure("bottom", after.forces["normal_force"] / SIDE**2), coulomb.Traction("bottom", of_friction)],
).solve()
rises = np.zeros_like(flat)
rises[number(free.at_nodes.x.T)] = free.at_nodes.displacement_vectors[:, 2]
apart = np.abs((profile - profile.mean()) - (rises.mean() - rises)).max()
print(f"profile {np.ptp(profile) * 1e6:.1f} um deep; the shape under an even pressure is within {apart * 1e6:.2f} um")
print(after.certificate)

directory = Path("results") / "even_pressure"
after.write(directory)
figure = Figure(figsize=(9.5, 3.2), layout="constrained")
nodes, pressures = after.at_nodes, [one.at_nodes.pressure / 1e3 for one in (before, after)]
levels = np.linspace(np.min(pressures), np.max(pressures), 17)
depth = 1e6 * (profile.max() - profile)[number(nodes.x.T)]
shown = {
    "flat punch, kPa": (pressures[0], levels),
    "shaped punch, kPa": (pressures[1], levels),
    "depth, um": (depth, 16),
}
for axes, (name, (values, bands)) in zip(figure.subplots(1, 3), shown.items(), strict=True):
    drawn = axes.tricontourf(1e3 * nodes.x[:, 0], 1e3 * nodes.x[:, 1], values, bands)
    figure.colorbar(drawn, ax=axes, shrink=0.8)
    axes.set(title=name, aspect="equal", xlabel="x, mm")
figure.savefig(directory / "even_pressure.png", dpi=120)
print(f"results in {directory}")
