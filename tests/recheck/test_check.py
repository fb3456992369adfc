"""`coulomb check` of the runs of scripts, by their problem and from the files alone."""

import shutil

import numpy as np
import pytest
from check_runs import change, edit
from conftest import make_block, run_coulomb

import coulomb
from coulomb.io import output
from coulomb.recheck import check


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    solution = make_block(4).solve()
    directory = tmp_path_factory.mktemp("check") / "run"
    output.write(solution, directory)
    return solution, directory


@pytest.fixture
def copy(run, tmp_path):
    return shutil.copytree(run[1], tmp_path / "copy")


def assert_same(again, certificate):
    assert again.passed and certificate.passed, again
    for old, new in zip(certificate.checks, again.certificate.checks, strict=True):
        assert new.value == pytest.approx(old.value, rel=1e-3, abs=1e-12), old.name


def test_same_certificate(run):
    solution, directory = run
    found = check(directory, solution.problem)
    assert_same(found, solution.certificate)
    assert "certificate passed\nrecorded by the run: certificate had passed" in str(found)


def pressed(place):
    """A block away from the origin, pressed down and dragged."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (4, 3, 3), place=place)
    clamp = coulomb.PrescribedDisplacement("top", (1e-4, 0.0, -1e-3))
    return coulomb.ContactProblem(mesh, coulomb.Material(2.1e11, 0.3), [clamp], coulomb.Contact("bottom", 0.3))


def pressed_onto_the_floor():
    """By a load on the contact face itself: nothing moves, whatever the stiffness is."""
    load = coulomb.Traction("bottom", (2e6, 0.0, -1e7))
    mesh, steel = coulomb.box((3.0, 1.0, 1.0), (3, 2, 2)), coulomb.Material(2e11, 0.3)
    return coulomb.ContactProblem(mesh, steel, [coulomb.Clamp("left")], coulomb.Contact("bottom", 0.3), [load])


@pytest.mark.parametrize(
    "problem",
    [
        pressed_onto_the_floor,
        lambda: make_block(3, foundation=coulomb.Plane((0, 0, -1e-4), (0.0, 0.05, 1.0))),
        lambda: pressed(lambda x: np.array([x[0] - x[2], 2**0.5 * x[1], x[0] + x[2]]) / 2**0.5),
    ],
    ids=["pressed onto the floor", "tilted plane with a gap", "45 degrees"],
)
def test_other_problems(problem, tmp_path):
    solution = problem().solve()
    output.write(solution, tmp_path)
    assert_same(check(tmp_path, problem()), solution.certificate)
    assert check(tmp_path).passed


def test_far_from_the_origin(tmp_path):
    """Normals and gaps are rounded by the coordinates."""
    problem = pressed(lambda x: x + np.array([[1000.0], [-500.0], [3000.0]]))
    output.write(problem.solve(), tmp_path)
    assert check(tmp_path, problem).passed and check(tmp_path).passed


def swap(path, old, new):
    path.write_text(path.read_text().replace(old, new))


def one_node(data):
    data[np.argmax(np.abs(data).sum(axis=1))] *= 1.001
    return data


@pytest.mark.parametrize(
    ("file", "field", "function", "failing"),
    [
        ("solution.h5", "displacement", one_node, "equilibrium"),
        ("solution.h5", "displacement", lambda u: 1.0001 * u, "equilibrium"),
        ("contact.h5", "contact_force", one_node, "equilibrium"),
        ("contact.h5", "contact_force", lambda x: -x, "adhesion"),
    ],
)
def test_changed_answers_are_no_answers(run, copy, file, field, function, failing):
    change(copy / file, field, function)
    found = check(copy, run[0].problem)
    assert not found.passed and not found.certificate[failing].passed


@pytest.mark.parametrize(
    ("file", "field", "function", "fault"),
    [
        ("solution.h5", "displacement", lambda u: 1.0001 * u, "summary.json.maximum.displacement"),
        ("solution.h5", "load", lambda f: 0.99 * f, "summary.json.sum of loads"),
        ("contact.h5", "contact_force", one_node, "contact.xdmf: pressure"),
        ("contact.h5", "contact_force", lambda x: -x, "contact.xdmf: tension"),
        ("contact.h5", "friction", lambda F: 0.9 * F, "contact.xdmf: friction beyond its bound"),
        ("contact.h5", "friction", lambda F: 1.1 * F, "contact.xdmf: friction_use"),
        ("contact.h5", "gap", lambda gap: gap - 1e-5, "contact.xdmf: forces, gaps and slip leave"),
        ("contact.h5", "slip", lambda slip: 0.0 * slip, "summary.json.totals.greatest_slip"),
        ("contact.h5", "area", lambda area: 1.001 * area, "contact.xdmf: pressure"),
        ("contact.h5", "normal", lambda n: 1.001 * n, "contact.xdmf: length of normal"),
    ],
)
def test_the_files_alone_tell(copy, file, field, function, fault):
    """Without the problem, too, what contradicts itself is found; and the lines name what was not judged."""
    change(copy / file, field, function)
    found = check(copy)
    assert not found.passed and any(one.startswith(fault) for one in found.faults), found.faults
    assert any(line.startswith("not judged without the problem: equilibrium") for line in found.trusted)


def test_totals_of_a_face_follow_from_the_files_alone(copy):
    def spoil(contents):
        contents["faces"][0]["normal_force"] *= 1.0 + 1e-6

    edit(copy / "summary.json", spoil)
    (fault,) = check(copy).faults
    assert fault.startswith("summary.json.faces[0].normal_force: ") and fault.endswith(" follows from the fields")


def test_a_certificate_beyond_its_limits(copy):
    edit(copy / "summary.json", lambda contents: contents["certificate"]["equilibrium"].update(value=1.0))
    faults = check(copy).faults
    assert any(fault.startswith("summary.json.certificate.equilibrium.passed: True, but False") for fault in faults)
    edit(copy / "summary.json", lambda contents: contents["certificate"]["equilibrium"].update(passed=False))
    assert any(fault.startswith("summary.json.certificate.passed: True, but False") for fault in check(copy).faults)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: (d / "summary.json").unlink(), "summary.json: cannot be read: No such file"),
        (lambda d: (d / "summary.json").write_text("{"), "summary.json: is not JSON"),
        (lambda d: (d / "summary.json").write_text("{}"), "summary.json: has no 'law'"),
        (lambda d: (d / "contact.h5").unlink(), "is incomplete"),
        (lambda d: (d / "contact.xdmf").unlink(), "is incomplete: there is no contact.xdmf"),
        (lambda d: (d / "contact.xdmf").write_text("<Xdmf>"), "contact.xdmf: cannot be read"),
        (lambda d: swap(d / "contact.xdmf", "/pressure/", "/gap/"), "/Function/gap/0, but <DataItem"),
        (
            lambda d: swap(d / "contact.xdmf", '"status"', '"state"'),
            "contact.xdmf: shows other data than contact.h5 ha",
        ),
        (lambda d: (d / "solution.xdmf").write_text(""), "solution.xdmf: cannot be read"),
        (lambda d: (d / "contact.h5").write_bytes((d / "contact.h5").read_bytes()[:3000]), "is incomplete"),
        (lambda d: change(d / "contact.h5", "contact_force", lambda x: np.nan * x), "entries that are not finite"),
    ],
)
def test_incomplete_results_are_refused(copy, spoil, message):
    spoil(copy)
    done = run_coulomb("check", copy, code=2)
    assert message in done.stderr and "Traceback" not in done.stderr


def test_files_of_two_runs(copy, tmp_path):
    output.write(make_block(3).solve(), tmp_path / "other")
    for name in ("contact.h5", "contact.xdmf"):
        shutil.copy(tmp_path / "other" / name, copy / name)
    with pytest.raises(ValueError, match=r"contact.h5 does not match the mesh of solution.xdmf"):
        check(copy)


def test_a_failed_run_fails_again(failed):
    done = run_coulomb("check", failed, code=1)
    assert "recorded by the run: certificate had FAILED" in done.stdout
