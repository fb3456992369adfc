"""An O-ring pressed by a lid (`demos/o_ring.toml`, large motions): a slice of one degree beside a quarter in 3D.

The quarter has the cells of the section in layers around the axis, between two planes of symmetry; its forces, times 4,
are those of 360 degrees.  With layers of a few degrees its nodes are on a polygon: volumes are sin(t)/t of the ring's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

import coulomb
from coulomb.fem.meshes.gmsh_format import read_section
from verification.array_mesh import mesh_of_arrays

from .processes import processor_time

SECTION: Final = Path(__file__).parents[1] / "demos" / "o_ring.msh"
RUBBER: Final = coulomb.MooneyRivlin(0.6e6, 0.15e6, 50e6)
TIMES: Final = (0.25, 0.5, 0.75, 1.0)
DEPTH: Final = 4e-4
"""Metres by which the lid comes down."""


class Row(NamedTuple):
    """A mesh: its cells, unknowns of displacement, all Newton steps and processor seconds; the force on the lid in
    newtons and the largest pressure in pascals."""

    mesh: str
    cells: int
    unknowns: int
    steps: int
    seconds: float
    force: float
    pressure: float


def measure(layers: Sequence[int] = (6, 12, 24), times: Sequence[float] = TIMES) -> Iterator[Row]:
    """The slice, and quarters of so many layers, at the end of some times, of which the way of the lid is linear.

    Raises:
        RuntimeError: If a step is not valid.
    """
    yield _solved("slice", coulomb.slice(SECTION, "axisymmetric", scale=1e-3), (), 1.0, times)
    for count in layers:
        ends = [coulomb.SymmetryPlane("start"), coulomb.SymmetryPlane("end")]
        yield _solved(f"quarter, {count} layers", quarter(count), tuple(ends), 4.0, times)


def quarter(layers: int) -> coulomb.NamedMesh:
    """The section, x the radius and y the axis, in layers from z = 0 to x = 0; with the faces of the section's lines,
    "start" and "end"."""
    section = read_section(str(SECTION))
    points, quads = 1e-3 * section.points[:, :2], section.cells[4]
    area = np.sum(points[quads, 0] * (np.roll(points[quads, 1], -1, axis=1) - np.roll(points[quads, 1], 1, axis=1)), 1)
    quads = np.where(area[:, None] > 0.0, quads, quads[:, ::-1])
    count, angles = len(points), np.linspace(0.0, -0.5 * np.pi, layers + 1)
    x = [np.column_stack([points[:, 0] * np.cos(a), points[:, 1], -points[:, 0] * np.sin(a)]) for a in angles]
    first = count * np.arange(layers)[:, None, None]
    cells = np.concatenate([quads + first, quads + first + count], axis=2).reshape(-1, 8)
    faces = {
        name: np.concatenate([lines + first, lines[:, ::-1] + first + count], axis=2).reshape(-1, 4)
        for name, lines in section.line_groups.items()
    }
    return mesh_of_arrays(np.vstack(x), cells, {**faces, "start": quads, "end": quads + count * layers})


def _solved(
    name: str,
    mesh: coulomb.NamedMesh,
    ends: tuple[coulomb.SymmetryPlane, ...],
    copies: float,
    times: Sequence[float],
) -> Row:
    began = processor_time()
    lid = coulomb.Contact(
        "above",
        friction=0.1,
        foundation=coulomb.Plane((0.0, 0.002, 0.0), (0.0, -1.0, 0.0)),
        motion=lambda time: (0.0, -DEPTH * time, 0.0),
    )
    held = [coulomb.SymmetryPlane("middle"), *ends]
    problem = coulomb.ContactProblem(mesh, RUBBER, held, lid, kinematics="large")
    steps = 0
    for step in coulomb.LoadHistory(tuple(times)).steps(problem):
        if not step.solution.valid:
            raise RuntimeError(f"{name}: the step to {step.state.time:g} s is not valid")
        steps += step.solution.result.newton_steps
        answer = step.solution
    domain = mesh.domain
    return Row(
        name,
        int(domain.topology.index_map(3).size_global),
        3 * int(domain.geometry.index_map().size_global),
        steps,
        processor_time() - began,
        copies * float(answer.forces["normal_force"]),
        float(np.max(answer.at_nodes.pressure)),
    )
