"""Gaps given with a contact, and interference; press fits against Lame's formula are in the verification."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
from check_runs import copied, edit, field, run_case
from history_runs import PRESS_FIT
from mpi4py import MPI

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, Plane
from coulomb.case.case import read_case
from coulomb.case.record import case_record
from coulomb.model import contact_faces as contacts
from coulomb.model.input_echo import contacts_of
from coulomb.pictures.report.words import contact_in_words
from coulomb.recheck import check
from coulomb.units import plain

RUBBER = Material(1e7, 0.3)


def block(gap=0.0, amplitude=1.0, foundation=None, normals="foundation", cell="hexahedron", comm=None, **more):
    contact = Contact("bottom", 0.3, None, foundation, normals, gap=gap, gap_amplitude=amplitude, **more)
    return ContactProblem(coulomb.box((2.0, 1.0, 0.5), (4, 2, 2), cell), RUBBER, [Clamp("top")], contact)


@pytest.mark.parametrize("normals", ["foundation", "body"])
def test_a_gap_is_that_of_a_moved_foundation(normals):
    """Against a plane at a distance, and against the plane of the face with that gap."""
    floor = Plane((0.0, 0.0, 1e-3), (0.0, 0.0, 1.0))
    far = Plane((0.0, 0.0, -4e-3), (0.0, 0.0, 1.0))
    expected = block(foundation=floor, normals=normals).solve()
    for problem in (block(-1e-3, normals=normals), block(-5e-3, foundation=far, normals=normals)):
        answer = problem.solve()
        assert answer.valid and answer.certificate.passed
        scale = np.abs(expected.contact_force).max()
        assert np.abs(answer.contact_force - expected.contact_force).max() <= 1e-7 * scale
        assert answer.small_strain.gap_error <= 1e-6  # the distance includes the given gap


def test_a_gap_is_added_at_every_node_of_its_own_face_only():
    contact = [
        Contact("bottom", 0.3, gap=lambda x: 1e-4 * x[0] - 2e-5, gap_amplitude=3.0),
        Contact("top", 0.1, foundation=Plane((0.0, 0.0, 0.6), (0.0, 0.0, -1.0))),
    ]
    surface = ContactProblem(coulomb.box((2.0, 1.0, 0.5), (4, 2, 2)), RUBBER, [Clamp("left")], contact).surface
    expected = np.where(surface.part == 0, 3.0 * (1e-4 * surface.x[:, 0] - 2e-5), 0.1)
    assert np.allclose(surface.gap, expected, rtol=0.0, atol=1e-15)


def test_a_gap_that_the_solver_forgets_is_noticed(monkeypatch):
    real = contacts.contact_surface

    def without(*arguments):
        surface = real(*arguments)
        return replace(surface, gap=surface.gap - surface.gap_field)

    problem = block(-1e-3, foundation=Plane((0.0, 0.0, 1e-3), (0.0, 0.0, 1.0)))
    assert problem.solve().certificate.passed
    monkeypatch.setattr(contacts, "contact_surface", without)
    with pytest.raises(coulomb.NotConverged, match="penetration"):
        block(-1e-3, foundation=Plane((0.0, 0.0, 1e-3), (0.0, 0.0, 1.0))).solve()


def test_work_of_a_growing_interference_is_stored():
    """Without friction the steps are linear: the trapezoidal rule is exact, and all work is elastic energy."""
    problem = block(-1e-3, [(0.0, 0.0), (1.0, 1.0)], cell="tetrahedron")
    problem = ContactProblem(problem.mesh, RUBBER, [Clamp("top")], replace(problem.contacts[0], friction=0.0))
    *_, last = LoadHistory(times=[0.3, 1.0]).steps(problem)
    energy = last.state.energy
    assert energy.foundation > 1.0 and energy.elastic == pytest.approx(energy.foundation, rel=1e-7)


def test_energy_is_in_balance_while_a_gap_opens(tmp_path):
    """Of points that still touch, whose gap is a rounding error of either sign, the whole way counts."""
    (tmp_path / "case.toml").write_text(PRESS_FIT.replace("[0.5, 1.5]", str([k / 16 for k in range(1, 25)])))
    settings = read_case(tmp_path / "case.toml")
    *_, last = settings.load_history().steps(settings.problem(MPI.COMM_SELF))
    assert abs(last.row["energy_imbalance"]) <= 0.03 * last.row["energy_dissipated"]


def test_another_gap_in_the_case(tmp_path):
    folder = copied(PRESS_FIT, tmp_path / "run")
    edit(folder / "case.json", lambda case: case["contact"].update(gap="1.0001e-3*(x - 1.2)"))
    for step in check(folder).steps:
        assert any("given_gap" in fault and "the case" in fault for fault in step.faults)


def test_a_gap_from_a_file(tmp_path):
    """The linear field of a mesh of its own, in millimetres; the check goes on without the file."""
    corners = np.array([[x, y, z] for z in (-10.0, 600.0) for y in (0.0, 1000.0) for x in (0.0, 2000.0)])
    cells = [("hexahedron", [[0, 1, 3, 2, 4, 5, 7, 6]])]
    depth = 1e-6 * (corners[:, 0] - 1200.0)
    meshio.Mesh(corners, cells, point_data={"depth": depth}).write(tmp_path / "worn.vtu")
    given = PRESS_FIT.replace('"1e-3*(x - 1.2)"', '{ file = "worn.vtu", field = "depth", scale = 1e-3 }')
    folder, same = run_case(given, tmp_path / "run"), copied(PRESS_FIT, tmp_path / "same")
    gaps = [field(path / "steps/0002/contact.h5", "given_gap") for path in (folder, same)]
    assert np.abs(gaps[0] - gaps[1]).max() <= 1e-15 and check(folder).passed

    def digests():
        return case_record(read_case(tmp_path / "run.toml"), MPI.COMM_SELF)["files"]

    before = digests()
    meshio.Mesh(corners, cells, point_data={"depth": 1.001 * depth}).write(tmp_path / "worn.vtu")
    assert not check(folder).passed
    assert list(before) == ["contact.gap.file"] and before != digests()
    (tmp_path / "worn.vtu").unlink()
    found = check(folder)
    assert found.passed and any("worn.vtu is not there: formats" in line for line in found.trusted)


def test_what_was_understood_of_a_gap():
    (pair,) = contacts_of(block(lambda x: 1e-4 * x[0] - 5e-5, [(0.0, 0.5), (1.0, 1.0)]))
    assert [pair["given_gap"]["min"], pair["given_gap"]["max"]] == pytest.approx([-5e-5, 1.5e-4])
    assert [pair["gap"]["min"], pair["gap"]["max"]] == pytest.approx([-2.5e-5, 7.5e-5])
    assert "gap -25 um to 75 um, of which given -50 um to 150 um times its amplitude" in plain(contact_in_words(pair))
    (pair,) = contacts_of(block())
    assert "given" not in plain(contact_in_words(pair))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: block("1e-3"), "gap must be a number of metres or a function of place, .* but is '1e-3'"),
        (lambda: block(np.zeros(3)), "gap must be a number of metres"),
        (lambda: block(0.0, [(0, 0), (1, 1)]), "gap_amplitude is a factor of gap, which is not given"),
        (
            lambda: block(lambda x: np.where(x[0] < 1.0, np.inf, 0.0)),
            "'bottom': gap: the value has entries that are not finite",
        ),
        (lambda: block(lambda x: x), r"'bottom': gap: the function must return 15 numbers, .* shape \(3, 15\)"),
        (lambda: block(-1e-3, lambda time: np.nan), "'bottom': gap: the amplitude at time 0 is nan"),
    ],
)
def test_wrong_gaps(make, message):
    with pytest.raises(ValueError, match=message):
        make()
