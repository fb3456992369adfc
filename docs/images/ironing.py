"""ironing.png of docs/measurements.md: the die in the middle of its way, and the forces of three programs.

python -m benchmarks ironing --output results/ironing
python docs/images/ironing.py
"""

import csv
import sys
from pathlib import Path

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

import coulomb  # noqa: E402
from benchmarks.ironing import DIE, FRICTION, SLAB, WAY, ours  # noqa: E402
from coulomb.fem.compat import cell_geometry  # noqa: E402

COLOURS = {"coulomb": "#0b84d8", "GetFEM": "#e06c00", "CalculiX": "#8a8a8a"}
MARKERS = {"coulomb": "o-", "GetFEM": "x--", "CalculiX": ".:"}


def forces():
    with (ROOT / "results" / "ironing" / "ironing-forces.csv").open(newline="") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def deformed(axis):
    """Both bodies at time 1.5, from the side."""
    *_, last = coulomb.LoadHistory([1.0, 1.25, 1.5]).steps(ours.problem(2))
    for name, colour in ((SLAB, "#cfe4f5"), (DIE, "#f6dcc0")):
        u = last.solution.functions[name]
        mesh = u.function_space.mesh
        front = cell_geometry(mesh)[:, [0, 1, 5, 4]]  # of a hexahedron, x fastest: y = 0
        x = (mesh.geometry.x + u.x.array.reshape(-1, 3))[front][:, :, [0, 2]]
        axis.add_collection(PolyCollection(x, facecolor=colour, edgecolor="#555555", linewidth=0.5))
    axis.set(aspect="equal", xlim=(-0.5, 9.5), ylim=(-0.2, 4.3), xlabel="x, mm", ylabel="z, mm")


def main():
    found, figure = forces(), Figure(figsize=(9.6, 3.4), layout="constrained", dpi=100)
    left, right = figure.subplots(1, 2)
    deformed(left)
    drawn = found["time"] >= 1.0
    way = WAY * (found["time"][drawn] - 1.0)
    for name, colour in COLOURS.items():
        for letter in "NT":
            if f"{name} {letter}" in found:
                label = name if letter == "N" else None
                right.plot(way, found[f"{name} {letter}"][drawn], MARKERS[name], color=colour, ms=5, label=label)
    right.annotate("normal", (0.02, 0.7), color="#333333")
    right.annotate("tangential", (0.4, 0.12), color="#333333")
    right.set(xlabel="way of the die, mm", ylabel="force, N per mm of width", ylim=(0.0, None))
    right.legend(frameon=False, loc="center right", bbox_to_anchor=(1.0, 0.6))
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(Path(__file__).with_name("ironing.png"))
    print("T / N at the end:", found["coulomb T"][-1] / found["coulomb N"][-1], "F:", FRICTION)


if __name__ == "__main__":
    main()
