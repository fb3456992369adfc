"""The pictures of docs/machine-parts.md, from `coulomb run` of demos/lap_joint, ball_joint and disc_brake, in results/.

python docs/images/several_bodies.py     docs/several-bodies.md has picture.png of demos/two_blocks as it is, and what
these show: `coulomb plot results/pin_joint --field pressure`,
`coulomb plot results/bolted_flange --field von_mises_stress --view iso`
"""

import csv
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import matplotlib.image
import numpy as np
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "results"
BLUE, ORANGE, GREY = "#0b84d8", "#e06c00", "#8a8a8a"


def columns(name):
    """Columns of the history of a demo."""
    with (RESULTS / name / "history.csv").open(newline="") as file:
        rows = [{key: float(value) for key, value in row.items() if value != "True"} for row in csv.DictReader(file)]
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def drawn(axis, name, *options):
    """The picture of `coulomb plot` without its margins."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        command = [sys.executable, "-m", "coulomb", "plot", str(RESULTS / name), "--save", str(file), *options]
        subprocess.run(command, check=True, capture_output=True)
        axis.imshow(matplotlib.image.imread(file)[90:])
    axis.axis("off")


def panels():
    figure = Figure(figsize=(10.4, 4.2), layout="constrained", dpi=110)
    return figure, *figure.subplots(1, 2, width_ratios=(1.25, 1.0))


def curve(axis, x, y, known, label, xlabel, ylabel):
    axis.plot(x, y, "o-", color=BLUE, markersize=3.5, label="computed")
    axis.axhline(known, color=ORANGE, linestyle="--", linewidth=1.2, label=label)
    axis.axhline(0.0, color=GREY, linewidth=0.6)
    axis.set(xlabel=xlabel, ylabel=ylabel)
    axis.legend(frameon=False, loc="lower right")
    axis.spines[["top", "right"]].set_visible(False)


def lap_joint():
    found = columns("lap_joint")
    figure, left, right = panels()
    drawn(left, "lap_joint")
    pulled = 60.0 * np.clip(found["time"] - 1.0, 0.0, 1.0)
    normal = np.abs(found["middle:upper_force_z"][-1])
    curve(
        right,
        pulled,
        -1e-3 * found["prescribed_displacement_middle:end_force_x"],
        1e-3 * 0.2 * normal * 2.0,
        "2 F N",
        "displacement of the grip, µm",
        "pull, kN",
    )
    figure.savefig(Path(__file__).with_name("lap-joint.png"))
    print("lap joint: N", normal, "pull", found["prescribed_displacement_middle:end_force_x"][-1])


def ball_joint():
    found = columns("ball_joint")
    figure, left, right = panels()
    drawn(left, "ball_joint")
    edge = math.acos(1.0 - found["socket:cup_contact_area"][-1] / (2.0 * math.pi * 0.015**2))
    c, s = math.cos(edge), math.sin(edge)
    lever = (s**3 / 3.0 - c * (edge - s * c) / 2.0) / ((1.0 - c**3) / 3.0 - c * s**2 / 2.0)
    angle = 6.0 * np.clip(found["time"] - 1.0, 0.0, 1.0)
    torque = found["prescribed_rotation_ball:stem_moment_z"]
    known = 0.2 * 3000.0 * 0.015 * lever
    curve(right, angle, torque, known, "elastic foundation", "angle of the stem, mrad", "torque, N m")
    figure.savefig(Path(__file__).with_name("ball-joint.png"))
    print(f"ball joint: edge at {math.degrees(edge):.1f} degrees, torque {torque[-1]:.4f}, formula {known:.4f} N m")


def disc_brake():
    found = columns("disc_brake")
    figure, left, right = panels()
    step = len(found["time"])
    with h5py.File(RESULTS / "disc_brake" / "steps" / f"{step:04d}" / "contact.h5") as file:
        x, facets = (file["Mesh"]["pad_rub"][name][...] for name in ("geometry", "topology"))
        pressure = np.squeeze(next(iter(file["Function"]["pad_rub"]["pressure"].values()))[...])
    triangles = np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]])
    shown = left.tripcolor(*(1e3 * x[:, :2]).T, triangles, 1e-6 * pressure, shading="gouraud", cmap="viridis", vmin=0)
    figure.colorbar(shown, ax=left, label="pressure on the disc, MPa")
    left.annotate("", (118, 25), (118, -25), arrowprops={"arrowstyle": "-|>", "color": GREY})
    left.annotate("disc", (119.5, 0), rotation=90, va="center", color=GREY)
    left.plot([66, 106], [41.5, 41.5], color="#333333", linewidth=3)
    left.annotate("anvil", (86, 43), ha="center", color="#333333")
    left.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", xlim=(60, 124), ylim=(-44, 49))
    left.spines[["top", "right"]].set_visible(False)
    angle = 4.0 * np.clip(found["time"] - 1.0, 0.0, 1.0)
    torque = found["prescribed_rotation_disc:hub_moment_z"]
    curve(right, angle, torque, 0.4 * 3632.0 * 0.095, "F P r", "angle of the disc, mrad", "torque, N m")
    figure.savefig(Path(__file__).with_name("disc-brake.png"))
    print(f"disc brake: torque {torque[-1]:.2f} N m, F P r {0.4 * 3632.0 * 0.095:.2f}")
    print("  anvil takes", found["pad:end_force_z"][-1], "N; N", found["pad:rub_force_z"][-1])


if __name__ == "__main__":
    lap_joint()
    ball_joint()
    disc_brake()
