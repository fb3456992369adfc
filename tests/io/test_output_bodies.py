"""Files, summary and probes of several bodies: what is written on both sides of a pair."""

import numpy as np
import pytest
from bodies_runs import on_one_base, pressed

from coulomb import Contact, Probe, box, moved
from coulomb.fem import compat
from coulomb.fem.bodies import Member
from coulomb.fem.bodies.displacement_space import DisplacementSpace
from coulomb.fem.bodies.located_points import _Facets
from coulomb.io import output
from coulomb.io.field_files import OPPOSITE, read_grids
from coulomb.model.nodal_answer import CARRIED, HELD, STICK, carried
from coulomb.model.probes import LocatedProbes
from coulomb.recheck import check

PRESSURE = 1e7


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        (("hexahedron", 1), ("tetrahedron", 1)),
        (("tetrahedron", 2), ("hexahedron", 1)),
        (("hexahedron", 2), ("tetrahedron", 2)),
    ],
    ids=str,
)
def test_a_uniform_pressure_is_the_same_on_both_sides(lower, upper, tmp_path):
    """Forces over nodal areas would not be: they vary with the ratio of the meshes."""
    contact = Contact("upper:bottom", against="lower:top", friction=0.3)
    solution = pressed(contact, lower, upper, PRESSURE).solve()
    output.write(solution, tmp_path)
    bodies, faces = (read_grids(tmp_path / f"{name}.xdmf") for name in ("solution", "contact"))
    assert list(bodies) == ["lower", "upper"] and set(faces) == {"upper:bottom", "lower:top"}
    for name, face in faces.items():
        assert np.allclose(face.fields["pressure"], PRESSURE, rtol=1e-6), name
        outward = np.array([0.0, 0.0, -1.0 if name == "upper:bottom" else 1.0])
        assert np.allclose(face.fields["normal"], outward, atol=1e-12)
        total = face.fields["contact_force"].sum(axis=0)
        if face.cell != "Triangle_6" or OPPOSITE in face.fields:  # between vertices there are means of those
            assert np.allclose(total, -outward * PRESSURE, atol=1e-6 * PRESSURE)
    for name, sign in (("lower", 0.5), ("upper", 0.4)):
        u = bodies[name].fields["displacement"][:, 2]
        assert np.isclose(np.ptp(u), sign * PRESSURE / 2e11, rtol=1e-6)
    assert check(tmp_path).passed


def test_a_rank_without_contact_points_of_a_pair_carries_nothing():
    """The others are still waiting for it in the sums over all ranks."""
    vectors = ("friction_traction", "slip")
    none = {name: np.empty((0, 3) if name in vectors else 0) for name in (*CARRIED, "status")}
    found = carried(none, lambda values: np.zeros((4, values.shape[1])))
    assert np.all(found["status"] == HELD)
    assert {name: values.shape for name, values in found.items() if name in CARRIED} == {
        name: (4, 3) if name in vectors else (4,) for name in CARRIED
    }


def test_a_face_opposite_in_two_pairs_has_a_grid_for_each(tmp_path):
    solution = on_one_base().solve()
    output.write(solution, tmp_path)
    faces = read_grids(tmp_path / "contact.xdmf")
    bases = ["base:top against one:bottom", "base:top against two:bottom"]
    assert list(faces) == ["one:bottom", "two:bottom", *bases]
    for number, base in enumerate(faces[name] for name in bases):
        assert np.isclose(base.fields["contact_force"][:, 2].sum(), -8e6, rtol=1e-6)
        assert np.all(base.fields[OPPOSITE] == number)
        beside = base.points[:, 0] > 1.0 if number == 0 else base.points[:, 0] < 1.0
        assert np.all(base.fields["status"][beside] == HELD) and not np.any(base.fields["pressure"][beside])
    found = check(tmp_path)
    assert found.passed, str(found)


def test_what_nothing_opposes_is_no_contact():
    """Carried values are means by the weights, opposite where they are of the slave; without any 0."""
    fields = {name: np.array([1.0, 3.0]) for name in CARRIED}
    fields |= {name: np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 4.0]]) for name in ("friction_traction", "slip")}
    fields["status"] = np.array([1.0, 2.0])
    weights = np.array([[3.0, 0.0], [1.0, 0.0]])
    found = carried(fields, lambda values: weights.T @ values)
    assert found["pressure"].tolist() == [1.5, 0.0] and found["status"].tolist() == [STICK, HELD]
    assert found["friction_traction"].tolist() == [[-1.5, 0.0, -1.0], [0.0, 0.0, 0.0]]


def test_probes_find_their_body():
    low = box((1.0, 1.0, 1.0), (1, 1, 1))
    spaces = [DisplacementSpace(compat.functionspace(mesh.domain, 1, (3,))) for mesh in (low, moved(low, (0, 0, 1)))]
    parts = [Member(name, space, slice(0, 8)) for name, space in zip(("lower", "upper"), spaces, strict=True)]
    probes = [Probe("a", (0.5, 0.5, 0.2)), Probe("b", (0.5, 0.5, 1.2)), Probe("c", (0, 0, 1), "upper")]
    assert [len(one._probes) for one in LocatedProbes(probes, parts, [])._in] == [1, 2]
    for probe, message in (
        (Probe("d", (0.5, 0.5, 1.0)), "'lower' and 'upper': give body"),
        (Probe("d", (0.5, 0.5, 5.0)), "body 'lower': the point .* is outside the body.*body 'upper'"),
        (Probe("d", (0.5, 0.5, 1.0), "middle"), "there is no body 'middle'; the bodies are lower, upper"),
    ):
        with pytest.raises(ValueError, match=message):
            LocatedProbes([probe], parts, [])


def test_a_rank_without_facets_of_a_face_has_no_nearest_point():
    """A small body on many ranks."""
    none = np.empty(0, dtype=np.int64)
    facets = _Facets(np.empty((0, 8, 3)), none, np.empty((0, 8), dtype=bool), np.empty(0))
    assert facets.nearest(np.zeros(3))[1:] == (np.inf, -1)
