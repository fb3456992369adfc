"""A face in contact with itself."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI
from rubber_strips import folded, open_strip, pressed, strip

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    HistoryFiles,
    LoadHistory,
    Material,
    NamedMesh,
    NeoHookean,
    PrescribedDisplacement,
    SymmetryPlane,
    box,
    join,
    moved,
)
from coulomb.io.output import write
from coulomb.io.run_directory import RunDirectory
from coulomb.model import arguments
from coulomb.recheck import check

ITSELF = Contact("skin", 0.3, against="skin")


def test_arms_that_slide_on_each_other_as_two_faces(tmp_path):
    """The whole skin, with the outer sides of both arms behind their walls."""
    mesh, times = strip(MPI.COMM_WORLD, 2, 16), (1.0, 1.3)
    skin, pair = (
        pressed(mesh, ITSELF, times)[1],
        pressed(mesh, Contact("low", 0.3, against="high", slave=True), times)[1],
    )
    totals = pair.at_nodes.totals()
    assert skin.valid and pair.valid and abs(totals["force"][0]) > 0.1 * totals["normal_force"] > 1e4
    assert skin.at_nodes.totals()["force"] == pytest.approx(totals["force"], rel=1e-6, abs=0.1)
    write(skin, tmp_path / "run")
    assert check(tmp_path / "run").passed


def test_forces_across_planes_of_symmetry_act_on_neither_face():
    """Of tetrahedra, whose normals are not in these planes, as faces are not symmetric there."""
    (answer,) = pressed(strip(MPI.COMM_WORLD, 2, 8, ("tetrahedron", 2)), ITSELF, (0.98,))
    assert answer.valid and answer.at_nodes.totals()["normal_force"] > 1e3
    assert answer.certificate["action and reaction"].value < 1e-9


def test_a_fold_that_is_not_there_before_deformation_as_two_faces(tmp_path):
    """Written, checked, and continued from the files, also with other sides than those before deformation; of
    hexahedra on several ranks, in test_parallel_self_contact."""
    mesh, times = open_strip(MPI.COMM_WORLD, 8, ("tetrahedron", 2)), (0.5, 1.0, 2.0)
    skin, pair = folded(mesh, ITSELF), folded(mesh, Contact("low", 0.3, against="high", slave=True))
    history = LoadHistory(times)
    history.run(skin, HistoryFiles(tmp_path / "run"), on_step=lambda step: step.state.time == 1.0)
    history.run(skin, HistoryFiles(tmp_path / "run", resume=True))
    *_, last = history.steps(pair)
    totals, rows = last.solution.at_nodes.totals(), RunDirectory(tmp_path / "run")
    summary = rows.read_summary()
    assert summary["valid"] and last.solution.valid
    assert totals["normal_force"] > 1e4 and last.state.energy.dissipated > 1.0
    assert summary["last"]["totals"]["force"] == pytest.approx(totals["force"], rel=1e-6, abs=0.1)
    energy = summary["last"]["step"]["energy"]
    assert [energy["elastic"], energy["dissipated"]] == pytest.approx(
        [last.state.energy.elastic, last.state.energy.dissipated], rel=1e-6
    )
    assert check(tmp_path / "run").passed


def test_a_fold_that_closes_within_one_load_step_makes_the_answer_invalid():
    problem = folded(open_strip(MPI.COMM_WORLD, 12), ITSELF)
    problem.large.itself = {}
    *_, last = LoadHistory((0.5, 1.0, 2.0)).steps(problem)
    assert not last.solution.valid and last.solution.small_strain.overlap > 0.01


def test_what_is_on_one_side_and_meets_makes_the_answer_invalid(monkeypatch):
    """With sides that are none: the inner sides of both arms on the first, their outer sides on the second."""
    mesh = strip(MPI.COMM_WORLD, 2, 16)
    sides = arguments.two_sides(mesh, mesh.faces["skin"])
    wrong = sides._replace(first=mesh.faces["top"], second=mesh.faces["bottom"])
    monkeypatch.setattr(arguments, "two_sides", lambda *_: wrong)
    (answer,) = pressed(mesh, ITSELF)
    assert not answer.valid and answer.certificate.passed
    assert answer.small_strain.overlap > 0.5


def test_sides_that_are_farther_apart_than_each_is_wide():
    """The walls of a gutter, inside 1 m high and 6 m apart."""

    def way(x):
        angle, beyond = np.clip((x[0] - 1.0) / 3.5, 0.0, np.pi), np.maximum(x[0] - 1.0 - 3.5 * np.pi, 0.0)
        r = 4.0 - x[2]
        along = np.minimum(x[0], 1.0) + r * np.sin(angle) + beyond * np.cos(angle)
        return np.array([along, x[1], 3.5 - r * np.cos(angle)]) - x

    mesh = moved(box((2.0 + 3.5 * np.pi, 1.0, 1.0), (26, 1, 1)), way)
    lower = NamedMesh(mesh.domain, {"lower": lambda x: x[2] < 3.5 + 1e-6}).faces["lower"]
    sides = {"one": np.intersect1d(mesh.faces["top"], lower), "other": np.setdiff1d(mesh.faces["top"], lower)}
    mesh = replace(mesh, faces={**mesh.faces, **sides})
    pair = Contact("one", 0.3, against="other", slave=True)
    surface = ContactProblem(mesh, Material(1e9, 0.3), [Clamp("bottom")], pair).surface
    straight = surface.x[:, 0] < 0.5
    assert np.count_nonzero(straight) == 4 and surface.gap[straight] == pytest.approx(6.0)


def test_a_boot_whose_folds_are_far_from_each_other():
    """Lines that pass an end of a fold meet other layers than the nearest: areas there differed by 0.7, and the first
    load step had no answer."""

    def wall(x):
        z, angle, off = 0.04 * x[0], 4.0 * np.pi * x[0], 0.0015 * (x[2] - 0.5)
        slope = -0.008 * 100.0 * np.pi * np.sin(angle)
        size = np.sqrt(1.0 + slope**2)
        return np.array([0.008 * np.cos(angle) + off / size, 0.004 * x[1], z - off * slope / size])

    mesh = box((1.0, 1.0, 1.0), (20, 1, 1), place=wall, degree=2)
    mesh = replace(mesh, faces={**mesh.faces, "skin": np.union1d(mesh.faces["bottom"], mesh.faces["top"])})
    down = PrescribedDisplacement("right", (0.0, 0.0, -0.0025), amplitude=((0.0, 0.0), (1.0, 1.0)))
    supports = [Clamp("left"), SymmetryPlane("front"), SymmetryPlane("back"), down]
    problem = ContactProblem(mesh, NeoHookean(5e6, 0.4), supports, ITSELF, kinematics="large")
    (step,) = LoadHistory([1.0], halvings=0).steps(problem)
    assert step.solution.valid and step.solution.at_nodes.totals()["normal_force"] == 0.0


def test_a_face_that_is_nowhere_before_itself_is_refused():
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    flat = Contact("top", 0.3, against="top")
    with pytest.raises(ValueError, match="'top' against itself: no part of it is before another"):
        ContactProblem(mesh, Material(1e9, 0.3), [Clamp("bottom")], flat)
    both = replace(flat, face="one:top", against="one:top")
    with pytest.raises(ValueError, match="'one:top' against itself: no part of it is before another"):
        ContactProblem(join(one=mesh), Material(1e9, 0.3), [Clamp("one:bottom")], both)
    with pytest.raises(ValueError, match="no face 'lid'"):
        ContactProblem(mesh, Material(1e9, 0.3), [Clamp("bottom")], replace(flat, face="lid", against="lid"))
