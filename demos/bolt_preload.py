"""The least preload of four bolts that keeps a plate from slipping under a load beside its middle.

The bolts of a frame press the plate onto a table; they are tightened, locked, and then the load pulls the plate aside.
No corner may slip by more than 4 um.  The preloads are found by SLSQP with exact derivatives: those of the slip of all
corners along the forces of all bolts, forward along both load steps.  At the least preload a kilonewton more takes off
the same slip on each bolt that is above its least force, and less on the others.

python demos/bolt_preload.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq, minimize

import coulomb

LENGTH, WIDTH, HEIGHT, SIDE = 0.12, 0.08, 0.01, 0.02
PLACES = {"a": (0.01, 0.01), "b": (0.09, 0.01), "c": (0.01, 0.05), "d": (0.09, 0.05)}
CORNERS = {f"{x:g}, {y:g}": (x, y, 0.0) for x in (0.0, LENGTH) for y in (0.0, WIDTH)}
FRICTION, LOAD, LIMIT = 0.15, (4e3, 6e3, 0.0), 4e-6

shanks = {
    name: coulomb.moved(coulomb.box((SIDE, SIDE, 0.04), (1, 1, 2)), translate=(x, y, HEIGHT))
    for name, (x, y) in PLACES.items()
}
bodies = coulomb.join(plate=coulomb.box((LENGTH, WIDTH, HEIGHT), (12, 8, 2)), **shanks)


def held(forces):
    """The answer under the load with these preloads, and its derivatives along their logarithms."""
    problem = coulomb.ContactProblem(
        bodies,
        coulomb.Material(2.1e11, 0.3),
        [coulomb.Clamp(f"{name}:top") for name in PLACES],
        coulomb.Contact("plate:bottom", FRICTION),
        [coulomb.TotalForce("plate:right", LOAD, amplitude=[(1.0, 0.0), (2.0, 1.0)])],
        ties=[
            coulomb.Pretension(
                f"{name}:bottom", "plate:top", force=-force, amplitude=[(0.0, 0.0), (1.0, 1.0)], lock=1.0
            )
            for name, force in zip(PLACES, forces, strict=True)
        ],
        probes=[coulomb.Probe(*corner, "plate") for corner in CORNERS.items()],
    )
    found = []
    for step in coulomb.LoadHistory([1.0, 2.0]).steps(problem):
        found = step.solution.sensitivities(found, only=lambda name: name.startswith("pretension"))
    assert step.solution.valid
    return step.solution, {one.name: one for one in found}


known: dict[bytes, tuple] = {}


def slips(forces):
    """How far each corner slips, metres, and its derivatives along the preloads, metres per newton."""
    key = forces.tobytes()
    if key not in known:
        answer, by = held(forces)
        vectors = np.array([one.slip for one in answer.probes])
        sizes = np.linalg.norm(vectors, axis=1)
        rates = np.array(
            [
                [by[f"pretension of '{name}:bottom'"].others["probes"][corner]["slip"] for name in PLACES]
                for corner in CORNERS
            ]
        )
        known[key] = sizes, np.einsum("pi,pbi->pb", vectors / sizes[:, None], rates) / forces
        print(f"preloads {', '.join(f'{force / 1e3:.2f}' for force in forces)} kN, slip {1e6 * sizes.max():.3f} um")
    return known[key]


def too_far(forces):
    """By how much each corner slips less than the limit, over it, and the derivatives."""
    sizes, rates = slips(forces)
    return 1.0 - sizes / LIMIT, -rates / LIMIT


UNIT, LEAST = 1e4, 5e3  # newtons: of preloads, for the optimiser; and the least, so that no bolt becomes loose
result = minimize(
    lambda p: (p.sum(), np.ones(len(p))),
    np.full(len(PLACES), 3e4) / UNIT,
    jac=True,
    method="SLSQP",
    bounds=[(LEAST / UNIT, 1e5 / UNIT)] * len(PLACES),
    constraints={
        "type": "ineq",
        "fun": lambda p: too_far(UNIT * p)[0],
        "jac": lambda p: UNIT * too_far(UNIT * p)[1],
    },
    options={"ftol": 1e-4},
)
forces = UNIT * result.x
even = brentq(lambda force: too_far(np.full(len(PLACES), force))[0].min(), LEAST, 1e5, xtol=10.0)
sizes, rates = slips(forces)
print(f"least preloads {', '.join(f'{force / 1e3:.2f}' for force in forces)} kN, slip {1e6 * sizes.max():.4f} um")
print(f"in all {forces.sum() / 1e3:.2f} kN; four that are the same {4.0 * even / 1e3:.2f} kN")
print(f"less slip of that corner: {', '.join(f'{-1e12 * rate:.2f}' for rate in rates[sizes.argmax()])} nm per kN")
print(f"{len(known)} load histories with their derivatives")
answer, _ = held(forces)
print(answer.certificate)

directory = Path("results") / "bolt_preload"
answer.write(directory)
figure = Figure(figsize=(9.5, 3.2), layout="constrained")
left, right = figure.subplots(1, 2)
nodes = answer.at_nodes
drawn = left.tricontourf(1e3 * nodes.x[:, 0], 1e3 * nodes.x[:, 1], nodes.pressure / 1e6, 16)
figure.colorbar(drawn, ax=left)
left.set(title="pressure, MPa", aspect="equal", xlabel="x, mm", ylabel="y, mm")
for (name, (x, y)), force in zip(PLACES.items(), forces, strict=True):
    left.text(1e3 * (x + SIDE / 2), 1e3 * (y + SIDE / 2), f"{name}: {force / 1e3:.1f} kN", color="white", ha="center")
right.plot([1e6 * sizes.max() for sizes, _ in known.values()], "o-")
right.axhline(1e6 * LIMIT, linestyle="--", color="0.5")
right.set(title="largest slip of a corner, um", xlabel="load history")
figure.savefig(directory / "bolt_preload.png", dpi=120)
print(f"results in {directory}")
