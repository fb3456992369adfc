"""The pictures and the tables of docs/drum-brake.md, from `coulomb run demos/drum_brake.toml`.

python docs/images/drum_brake.py            pictures, from results/drum_brake
python docs/images/drum_brake.py --tables   also finer meshes and shorter linings; needs gmsh
"""

import csv
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Arc

import coulomb
from coulomb.case.case import read_case

ROOT = Path(__file__).parents[2]
CASE, RESULTS = ROOT / "demos" / "drum_brake.toml", ROOT / "results" / "drum_brake"
F, R, B, C, WIDTH, PISTON = 0.35, 0.1, 0.1, 0.05, 0.03, 2e6
"""Friction, radius, place of the mounting beside and above the contact, width, pressure of the piston; N, m."""

BLUE, ORANGE, GREY = "#0b84d8", "#e06c00", "#8a8a8a"


def piston_force(alpha):
    return PISTON * WIDTH * 2.0 * R * math.sin(math.radians(alpha))


def short_shoe(force, sense, x=0.0):
    """Torque for a force of the piston; sense 1: towards the mounting; x: place of the centre of pressure."""
    return F * force * R * B / (B - (1.0 + C / R) * x - sense * F * (C + B * x / R))


def rows(folder):
    with (folder / "history.csv").open(newline="") as file:
        return [
            {name: float(value) for name, value in row.items() if value not in ("True", "False")}
            for row in csv.DictReader(file)
        ]


def fields(folder, step):
    """Fields of the contact face after a step, with its points and facets."""
    with h5py.File(folder / "steps" / f"{step:04d}" / "contact.h5") as file:
        mesh = next(iter(file["Mesh"].values()))
        found = {name: np.squeeze(next(iter(group.values()))[...]) for name, group in file["Function"].items()}
        return {**found, "x": mesh["geometry"][...], "facets": mesh["topology"][...]}


def tables():
    """Torques for finer meshes, and for shorter and thinner linings."""
    times = [1.0, 1.2, 1.5, 2.0, 2.2, 3.0, 4.0]
    print("half angle, thickness, cells | both senses: x in mm, torque, formula, formula with the pressure at x")
    for n, alpha, thick in ((1, 5, 4), (2, 5, 4), (4, 5, 4), (2, 2.5, 2), (2, 1.25, 1), (2, 10, 4)):
        with tempfile.TemporaryDirectory() as folder:
            mesh = Path(folder) / "shoe.msh"
            given = [f"-setnumber {name} {value}" for name, value in (("n", n), ("alpha", alpha), ("thick", thick))]
            command = f"gmsh -3 {ROOT / 'demos' / 'drum_brake.geo'} {' '.join(given)} -o {mesh}"
            subprocess.run(command.split(), check=True, capture_output=True)
            case = read_case(CASE, [f"mesh.file='{mesh}'", f"history.times={times}"])
            text, force = f"{alpha:5} {thick:3} {6 * n:3}", piston_force(alpha)
            for step in case.load_history().steps(case.problem()):
                row = step.row
                if row["time"] not in (2.0, 4.0):
                    continue
                sense = 1 if row["time"] == 2.0 else -1
                torque, x = -sense * row["lining_torque"], row["centre_of_pressure_x"]
                text += f" | {1e3 * x:6.2f}  {torque:8.3f}"
                for formula in (short_shoe(force, sense), short_shoe(force, sense, x)):
                    text += f"  {formula:8.3f} ({torque / formula - 1:+.2%})"
            print(text, flush=True)


def section(axis):
    """The shoe from the side, with its forces and the drum."""
    mesh = coulomb.read_mesh(CASE.parent / "drum_brake.msh", scale=1e-3)
    x = mesh.domain.geometry.x
    cells = np.array([mesh.domain.geometry.dofmap.links(k) for k in range(len(mesh.domain.geometry.dofmap))])
    front = [x[c][np.isclose(x[c][:, 1], x[:, 1].min())][:, [0, 2]] for c in cells]
    quads = []
    for corners in (q for q in front if len(q) == 4):
        middle = corners.mean(axis=0)
        order = np.argsort(np.arctan2(*(corners - middle).T[::-1]))
        quads.append(1e3 * corners[order])
    pad = [q for q in quads if q[:, 1].mean() < 104]
    steel = [q for q in quads if q[:, 1].mean() >= 104]
    axis.add_collection(PolyCollection(steel, facecolor="#c9d3dc", edgecolor="#6b7680", linewidth=0.4))
    axis.add_collection(PolyCollection(pad, facecolor="#e8b27a", edgecolor="#9a6a35", linewidth=0.4))
    axis.add_patch(Arc((0, 0), 200, 200, theta1=20, theta2=125, color="#333333", linewidth=1.6))
    axis.plot(0, 0, "+", color="#333333", markersize=9)
    axis.annotate("axis of the drum", (3, -7), va="top", fontsize=8.5)
    arrow = {"arrowstyle": "-|>", "linewidth": 1.6, "color": BLUE}
    axis.annotate("", (0, 140), (0, 172), arrowprops=arrow)
    axis.annotate("P", (4, 160), color=BLUE)
    axis.annotate("", (0, 100), (0, 62), arrowprops={**arrow, "color": ORANGE})
    axis.annotate("N", (4, 66), color=ORANGE)
    axis.annotate("", (36, 96), (2, 99), arrowprops={**arrow, "color": ORANGE})
    axis.annotate("F N", (28, 84), color=ORANGE)
    zigzag = np.array([[97, 150], [100, 150], [97, 154], [103, 158], [97, 162], [103, 166], [100, 170]])[1:]
    axis.plot(*zigzag.T, color="#333333", linewidth=1.2)
    axis.plot([90, 110], [170, 170], color="#333333", linewidth=2.5)
    axis.annotate("", (0, 184), (100, 184), arrowprops={"arrowstyle": "<->", "color": GREY})
    axis.annotate("b", (48, 187), color=GREY)
    axis.annotate("", (122, 100), (122, 150), arrowprops={"arrowstyle": "<->", "color": GREY})
    axis.annotate("c", (126, 122), color=GREY)
    axis.annotate("", (0, 0), (-57, 82), arrowprops={"arrowstyle": "<->", "color": GREY})
    axis.annotate("r", (-38, 34), color=GREY)
    for y in (100, 150):
        axis.plot([108 if y == 150 else 12, 126], [y, y], ":", color=GREY, linewidth=0.8)
    axis.add_patch(Arc((0, 0), 60, 60, theta1=40, theta2=140, color="#333333", linewidth=1.2))
    axis.annotate("", (24, 17.5), (20.5, 21.9), arrowprops={"arrowstyle": "-|>", "color": "#333333"})
    axis.annotate("+", (27, 20))
    axis.set(xlim=(-85, 140), ylim=(-22, 200), aspect="equal")
    axis.axis("off")


def loop(axis, history):
    """Torque against angle while the drum turns forwards and back, and the formula."""
    turned = [row for row in history if row["time"] <= 4.0]
    angle, torque = (np.array([row[f"lining_{name}"] for row in turned]) for name in ("angle", "torque"))
    axis.plot(1e3 * angle, -torque, "o-", color=BLUE, markersize=3.5, label="computed")
    force = piston_force(5.0)
    for sense, label in ((1, "short shoe"), (-1, None)):
        axis.axhline(sense * short_shoe(force, sense), color=ORANGE, linestyle="--", linewidth=1.2, label=label)
    axis.axhline(0.0, color=GREY, linewidth=0.6)
    axis.annotate("towards the mounting", (0.2, 46.5), fontsize=8.5)
    axis.annotate("away from it", (-0.9, -36.5), fontsize=8.5)
    axis.set(xlabel="angle of the drum, mrad", ylabel="braking torque, N m", ylim=(-42, 52))
    axis.legend(frameon=False, loc="upper left", bbox_to_anchor=(0.02, 0.75))
    axis.spines[["top", "right"]].set_visible(False)


def wear(figure, axes):
    """After ten turns: pressure and friction work per area, and the work over F beside pressure times distance."""
    history = rows(RESULTS)
    begun = next(int(row["step"]) for row in history if row["time"] == 5.0)
    last, before = fields(RESULTS, len(history)), fields(RESULTS, begun)
    x = last["x"]
    along, across = 1e3 * R * np.arctan2(x[:, 0], x[:, 2]), 1e3 * x[:, 1]
    slid = last["accumulated_slip"] - before["accumulated_slip"]
    work = last["friction_work"] - before["friction_work"]
    archard = last["pressure"] * slid
    triangles = np.concatenate([last["facets"][:, [0, 1, 2]], last["facets"][:, [0, 2, 3]]])
    for axis, values, title in (
        (axes[0], 1e-6 * last["pressure"], "pressure p, MPa"),
        (axes[1], 1e-6 * work, "friction work of ten turns, MJ/m²"),
    ):
        drawn = axis.tripcolor(along, across, triangles, values, shading="gouraud", cmap="viridis", vmin=0.0)
        figure.colorbar(drawn, ax=axis, label=title)
        axis.set(aspect="equal", xlabel="along the drum, mm", ylabel="across, mm")
    lines = axes[2]
    for place, colour in ((0.0, BLUE), (across.max(), ORANGE)):
        row = np.flatnonzero(np.isclose(across, place))
        row = row[np.argsort(along[row])]
        where = "in the middle" if place == 0.0 else "at the edge"
        lines.plot(along[row], 1e-6 * archard[row], "-", color=colour, label=f"p s {where}")
        lines.plot(along[row], 1e-6 * work[row] / F, "o", color=colour, markersize=4, label=f"work / F {where}")
    lines.set(xlabel="along the drum, mm", ylabel="MN/m", ylim=(0.0, None))
    lines.legend(frameon=False, fontsize=8.5)
    lines.spines[["top", "right"]].set_visible(False)
    ratio = work / (F * archard)
    print(f"sliding distance of ten turns: {slid.min():.8g} to {slid.max():.8g} m; 20 pi r = {20 * math.pi * R:.8g} m")
    print(f"work / (F p s) - 1: {ratio.min() - 1:.2g} to {ratio.max() - 1:.2g}")
    print(f"friction work over the face: {np.sum(work * last['area']):.6g} J; torque x 20 pi =", end=" ")
    print(f"{-history[-1]['lining_torque'] * 20 * math.pi:.6g} J; p s at most {archard.max():.4g} N/m")
    print(f"torque in the ten turns: {history[begun]['lining_torque']:.8g} to {history[-1]['lining_torque']:.8g} N m")


def main():
    history = rows(RESULTS)
    figure = Figure(figsize=(9.6, 4.2), layout="constrained", dpi=110)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    section(left)
    loop(right, history)
    figure.savefig(Path(__file__).with_name("drum-brake.png"))
    figure = Figure(figsize=(10.4, 3.9), layout="constrained", dpi=110)
    wear(figure, figure.subplots(1, 3, width_ratios=(1.0, 1.0, 1.25)))
    figure.savefig(Path(__file__).with_name("drum-brake-wear.png"))
    if "--tables" in sys.argv:
        tables()


if __name__ == "__main__":
    main()
