"""A rubber cylinder pressed flat: large motions beside CalculiX's (NLGEOM) and GetFEM's, on the same linear tetrahedra.

The lower half of a cylinder of neo-Hookean rubber, whose flat side is held, is pressed by a rigid plate until 60 % of
its height are left, with friction: plane strain.  CalculiX's contact between surfaces is a penalty, its increments are
chosen by itself within the same eight steps, which are ours.  GetFEM's is its large-sliding contact, in the same steps.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

import coulomb
from coulomb.arrays import FloatArray
from coulomb.fem import compat
from coulomb.fem.compat import fem, ufl
from coulomb.kinematics import LargeMotions, NonlinearBody

from .peers import PROBLEMS, missing
from .peers.answer import Unsolved
from .peers.calculix import numbered, row, run
from .peers.large_getfem import LargeSliding
from .processes import processor_time

RADIUS, LENGTH = 10.0, 2.0
"""In millimetres."""

C10, D1 = 0.2, 1.0
"""Of the energy C10 (J^(-2/3) I1 - 3) + (J - 1)^2 / D1, in N/mm^2 and mm^2/N."""

FRICTION = 0.3

STEPS = (0.05, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0)
"""Parts of the whole way of the plate, DEPTH."""

DEPTH = 0.4 * RADIUS

_PENALTY, _STICK = 200.0, 100.0
"""Pressure over penetration, and shear stress over elastic slip, of CalculiX's contact, N/mm^3: ten times less changes
its force by 0.1 %."""

_AUGMENTATION, _RELEASE = 1.0, 3.0
"""Of GetFEM's contact: N/mm^3, and the distance in millimetres beyond which there is none."""

_GEOMETRY = """
SetFactory("Built-in");
Point(1) = {{0, 0, 0}}; Point(2) = {{-{R}, 0, 0}}; Point(3) = {{{R}, 0, 0}}; Point(4) = {{0, 0, -{R}}};
Circle(1) = {{2, 1, 4}}; Circle(2) = {{4, 1, 3}}; Line(3) = {{3, 1}}; Line(4) = {{1, 2}};
Curve Loop(1) = {{1, 2, 3, 4}}; Plane Surface(1) = {{1}};
out[] = Extrude {{0, {L}, 0}} {{ Surface{{1}}; }};
Physical Surface("skin") = {{out[2], out[3]}}; Physical Surface("flat") = {{out[4], out[5]}};
Physical Surface("ends") = {{1, out[0]}}; Physical Volume("rubber") = {{out[1]}};
Mesh.MeshSizeMin = {h}; Mesh.MeshSizeMax = {h};
"""


class Row(NamedTuple):
    """A step: the part of the height by which the cylinder is shorter, forces in newtons and the differences of the
    others over them, our linear problems; on the last row processor seconds and iterations of all steps, else None, as
    is what is of GetFEM if that is not installed."""

    squeezed: float
    force: float
    calculix: float
    difference: float
    steps: int
    seconds: float | None
    calculix_seconds: float | None
    calculix_steps: int | None
    getfem: float | None = None
    getfem_difference: float | None = None
    getfem_seconds: float | None = None
    getfem_steps: int | None = None


def measure(size: float, repeats: int = 1) -> Iterator[Row]:
    """All steps on tetrahedra of a size in millimetres; the least processor time of some repeats.

    Raises:
        RuntimeError: If a program is missing or finds no answer.
    """
    mesh = half_cylinder(size)
    answers = [ours(mesh) for _ in range(repeats)]
    theirs = [calculix(mesh) for _ in range(repeats)]
    others = [] if missing(PROBLEMS["block"]["GetFEM"]) else [getfem(mesh) for _ in range(repeats)]
    forces, steps, _ = answers[0]
    other, iterations, _ = theirs[0]
    for number, part in enumerate(STEPS):
        last = number + 1 == len(STEPS)
        yield Row(
            part * DEPTH / RADIUS,
            forces[number],
            other[number],
            abs(forces[number] / other[number] - 1.0),
            steps[number],
            min(seconds for *_, seconds in answers) if last else None,
            min(seconds for *_, seconds in theirs) if last else None,
            iterations if last else None,
            *_of_getfem(others, number, forces[number], last),
        )


def _of_getfem(
    runs: list[tuple[list[float], int, float]], number: int, force: float, last: bool
) -> tuple[float | None, float | None, float | None, int | None]:
    if not runs:
        return None, None, None, None
    (found, iterations, _), seconds = runs[0], min(seconds for *_, seconds in runs)
    difference = abs(found[number] / force - 1.0)
    return found[number], difference, seconds if last else None, iterations if last else None


def half_cylinder(size: float) -> coulomb.NamedMesh:
    """The lower half, with the faces "skin", "flat" and "ends"; RuntimeError without gmsh."""
    try:
        import gmsh
    except (ImportError, OSError) as error:
        raise RuntimeError(f"gmsh, which makes the mesh, cannot be loaded: {error}") from None
    with tempfile.TemporaryDirectory() as folder:
        geometry, mesh = Path(folder) / "cylinder.geo", Path(folder) / "cylinder.msh"
        geometry.write_text(_GEOMETRY.format(R=RADIUS, L=LENGTH, h=size), encoding="ascii")
        gmsh.initialize()
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.open(str(geometry))
            gmsh.model.mesh.generate(3)
            gmsh.write(str(mesh))
        finally:
            gmsh.finalize()
        return coulomb.read_mesh(mesh)


def ours(mesh: coulomb.NamedMesh) -> tuple[list[float], list[int], float]:
    """Forces on the plate at the end of every step, Newton steps of each, and seconds."""
    began = processor_time()
    V = compat.functionspace(mesh.domain, 1, (3,))
    u, still = fem.Function(V), fem.Function(V)
    F = ufl.Identity(3) + ufl.grad(u)
    J = ufl.det(F)
    energy = C10 * (J ** (-2.0 / 3.0) * ufl.inner(F, F) - 3.0) + (J - 1.0) ** 2 / D1
    held = [("flat", 0), ("flat", 2), ("ends", 1)]
    bcs = [
        fem.dirichletbc(still.sub(axis), fem.locate_dofs_topological(V.sub(axis), 2, mesh.facets(face, "support")))
        for face, axis in held
    ]
    body = NonlinearBody(energy * ufl.dx(metadata={"quadrature_degree": 1}), bcs, mesh, displacement=u)
    plate = coulomb.Plane((0.0, 0.0, -RADIUS), (0.0, 0.0, 1.0))
    contact = coulomb.Contact("skin", friction=FRICTION, foundation=plate, motion=lambda time: (0.0, 0.0, DEPTH * time))
    forces, steps = [], []
    for step in coulomb.LoadHistory(STEPS).steps(LargeMotions(body, contact)):
        if not step.solution.valid:
            raise RuntimeError(f"the certificate fails at {step.state.time:g}")
        steps.append(step.solution.outer_iterations)
        forces.append(float(step.solution.at_nodes.totals()["force"][2]))
    return forces, steps, processor_time() - began


def calculix(mesh: coulomb.NamedMesh) -> tuple[list[float], int, float]:
    """The same forces, all iterations, and seconds; RuntimeError if it finds no answer."""
    began = processor_time()
    try:
        job = run(_deck(mesh), len(STEPS))
    except (OSError, Unsolved) as error:
        raise RuntimeError(f"CalculiX: {error}") from None
    return [float(table[:, 2].sum()) for table in job.tables], job.iterations, processor_time() - began


def getfem(mesh: coulomb.NamedMesh) -> tuple[list[float], int, float]:
    """The same forces, all iterations of Newton's method, and seconds; RuntimeError if it finds no answer."""
    began = processor_time()

    def held(x: FloatArray) -> npt.NDArray[np.bool_]:
        flat, ends = np.isclose(x[:, 2], 0.0), np.isclose(x[:, 1], 0.0) | np.isclose(x[:, 1], LENGTH)
        return np.column_stack([flat, ends, flat])

    def curved(x: FloatArray) -> npt.NDArray[np.bool_]:
        return np.isclose(np.hypot(x[:, 0], x[:, 2]), RADIUS)

    body = LargeSliding(FRICTION, _AUGMENTATION, _RELEASE)
    body.add_body("rubber", mesh.domain.geometry.x, _oriented(mesh), (C10, D1), held, curved, slave=True)
    body.add_obstacle(f"z+{RADIUS}")  # which stays, as the flat side comes down
    try:
        forces, iterations, _ = body.steps("rubber", lambda time: (0.0, 0.0, -DEPTH * time), STEPS)
    except Unsolved as error:
        raise RuntimeError(f"GetFEM: {error}") from None
    return [float(force) for force in forces[:, 2]], iterations, processor_time() - began


def _deck(mesh: coulomb.NamedMesh) -> Iterator[str]:
    x, cells = mesh.domain.geometry.x, _oriented(mesh)
    first, count = len(x), len(cells)
    wide, low = 3.0 * RADIUS, -RADIUS
    corners = [(-wide, -2.0), (wide, -2.0), (wide, LENGTH + 2.0), (-wide, LENGTH + 2.0)]
    plate = np.array([(a, b, z) for z in (low - 2.0, low) for a, b in corners])
    yield from ("*NODE", *numbered(np.concatenate([x, plate])))
    yield from ("*ELEMENT, TYPE=C3D4, ELSET=RUBBER", *numbered(cells + 1))
    yield from ("*ELEMENT, TYPE=C3D8, ELSET=PLATE", f"{count + 1},{row(first + 1 + np.arange(8))}")
    yield from ("*NSET, NSET=PLATE", *(str(first + k) for k in range(1, 9)))
    yield from ("*MATERIAL, NAME=RUBBER", "*HYPERELASTIC, NEO HOOKE", f"{C10},{D1}")
    yield from ("*MATERIAL, NAME=STEEL", "*ELASTIC", "1000,0.3")
    yield "*SOLID SECTION, ELSET=RUBBER, MATERIAL=RUBBER"
    yield "*SOLID SECTION, ELSET=PLATE, MATERIAL=STEEL"
    yield from ("*SURFACE, NAME=SLAVE", *(f"{cell + 1},S{side + 1}" for cell, side in _sides(x, cells)))
    yield from ("*SURFACE, NAME=MASTER", f"{count + 1},S2")
    yield from ("*SURFACE INTERACTION, NAME=CONTACT", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{_PENALTY:g}")
    yield from ("*FRICTION", f"{FRICTION},{_STICK:g}")
    yield from ("*CONTACT PAIR, INTERACTION=CONTACT, TYPE=SURFACE TO SURFACE", "SLAVE,MASTER", "*BOUNDARY")
    flat, ends = np.isclose(x[:, 2], 0.0), np.isclose(x[:, 1], 0.0) | np.isclose(x[:, 1], LENGTH)
    yield from (f"{node + 1},{axis},{axis}" for node in np.flatnonzero(flat) for axis in (1, 3))
    yield from (f"{node + 1},2,2" for node in np.flatnonzero(ends))
    yield "PLATE,1,2"
    for part in STEPS:
        yield from ("*STEP, NLGEOM, INC=500", "*STATIC", "1.,1.,1e-6,1.", "*BOUNDARY", f"PLATE,3,3,{part * DEPTH}")
        yield from ("*NODE PRINT, NSET=PLATE, FREQUENCY=1000", "RF", "*END STEP")


_SIDES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
"""Nodes of a tetrahedron on its faces S1 to S4."""


def _oriented(mesh: coulomb.NamedMesh) -> npt.NDArray[np.int64]:
    """The cells with positive volumes."""
    cells = compat.cell_geometry(mesh.domain).astype(np.int64)
    a, b, c = (mesh.domain.geometry.x[cells[:, k]] - mesh.domain.geometry.x[cells[:, 0]] for k in (1, 2, 3))
    wrong = np.einsum("ki,ki->k", np.cross(a, b), c) < 0.0
    cells[wrong] = cells[wrong][:, [0, 2, 1, 3]]
    return cells


def _sides(x: FloatArray, cells: npt.NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Cells and sides on the curved face."""
    curved = np.isclose(np.hypot(x[:, 0], x[:, 2]), RADIUS)
    for side, columns in enumerate(_SIDES):
        for cell in np.flatnonzero(np.all(curved[cells[:, columns]], axis=1)):
            yield int(cell), side
