"""`coulomb check` of several bodies and of pairs of faces: what is changed in the files is noticed."""

import json
import shutil

import numpy as np
import pytest
from bodies_runs import TWO
from case_texts import body as part
from check_runs import copied, edit, made, put, run_case
from conftest import run_coulomb

from coulomb import Clamp, Contact, ContactProblem, Material, box, join
from coulomb.io.field_files import read_grids
from coulomb.model.held_nodes import OtherNodes
from coulomb.recheck import check

FIRST, LAST = "steps/0001", "steps/0002"


def test_figures_of_pairs_and_bodies_are_sums_of_nodal_forces():
    folder = made(TWO) / LAST
    summary = json.loads((folder / "summary.json").read_text())
    master = read_grids(folder / "contact.xdmf")["lower:top"]
    forces = master.fields["contact_force"]
    sums = np.concatenate([forces.sum(axis=0), np.cross(master.points, forces).sum(axis=0)])
    (face,) = summary["faces"]
    assert np.allclose([*face["opposite_force"], *face["opposite_moment"]], sums, rtol=1e-9)
    lower, upper = summary["bodies"]
    assert np.allclose([*lower["contact_force"], *lower["contact_moment"]], sums, rtol=1e-9)
    assert np.allclose([*upper["contact_force"], *upper["contact_moment"]], -sums, rtol=1e-9)
    for body in (lower, upper):
        parts = [one for one in (*summary["loads"], *summary["reactions"]) if one["face"].startswith(body["name"])]
        assert len(parts) == (1 if body is lower else 4)  # of the upper one also a thermal load
        for what in ("force", "moment"):
            left = np.sum([one[what] for one in parts], axis=0) + body[f"contact_{what}"]
            assert np.linalg.norm(left) <= 1e-10 * np.linalg.norm(body[f"contact_{what}"])
        assert body["balance"] <= 1e-10


def test_without_a_case_the_contact_of_every_body_is_summed(tmp_path):
    folder = shutil.copytree(made(TWO) / FIRST, tmp_path / "run")
    edit(folder / "summary.json", lambda summary: put(summary, ("bodies", 0, "contact_force", 2), 1.0))
    assert any("summary.json.bodies[0].contact_force[2]" in line for line in check(folder).faults)


def test_a_body_that_shows_the_data_of_another_is_noticed(tmp_path):
    folder = copied(TWO, tmp_path / "run") / FIRST
    path = folder / "solution.xdmf"
    path.write_text(path.read_text().replace("/Function/upper/load/", "/Function/lower/load/"))
    with pytest.raises(ValueError, match=r"has <DataItem .*/lower/load/0, but <DataItem .*/upper/load/0 describes"):
        check(folder)


def test_one_body_with_a_name(tmp_path):
    """Its grid, `Mesh/block` in the HDF5 file, was described as one without a name: `coulomb check` refused the run."""
    mesh = join(block=box((1.0, 1.0, 0.5), (2, 2, 1)))
    problem = ContactProblem(mesh, Material(1e9, 0.3), [Clamp("block:top")], Contact("block:bottom", 0.3, gap=-1e-5))
    problem.solve().write(tmp_path / "out")
    assert list(read_grids(tmp_path / "out" / "solution.xdmf")) == ["block"]
    for given in ((), (problem,)):
        assert check(tmp_path / "out", *given).passed


def test_another_order_of_the_faces_of_a_pair_is_the_same_case(tmp_path):
    """Which face has the contact points is a choice; that the pair is another one is noticed."""
    folder = copied(TWO, tmp_path / "run")

    def exchange(case):
        (contact,) = case["contact"] if isinstance(case["contact"], list) else [case["contact"]]
        contact["face"], contact["against"] = contact["against"], contact["face"]

    edit(folder / "case.json", exchange)
    assert check(folder).passed

    def elsewhere(case):
        (contact,) = case["contact"] if isinstance(case["contact"], list) else [case["contact"]]
        contact["face"] = "lower:right"

    edit(folder / "case.json", elsewhere)
    with pytest.raises(ValueError, match=r"case\.json: its problem cannot be posed: contact face 'upper:bottom'"):
        check(folder)


def test_two_ranks_write_what_one_does(tmp_path):
    (tmp_path / "two.toml").write_text(TWO)
    options = ("--output", tmp_path / "run", "--set", "output.picture=false")
    run_coulomb("run", tmp_path / "two.toml", *options, ranks=2)
    assert check(tmp_path / "run").passed
    mine, theirs = (json.loads((run / LAST / "summary.json").read_text()) for run in (made(TWO), tmp_path / "run"))
    for name in ("opposite_force", "opposite_moment", "contact_area"):
        one, two = np.array(mine["faces"][0][name]), np.array(theirs["faces"][0][name])
        assert np.max(np.abs(one - two)) <= 1e-7 * np.max(np.abs(one))


FOAM_BESIDE_STEEL = """\
traction = [{ face = "steel:top", value = [0.0, 0.0, -10.0] }]
contact = [{ face = "foam:bottom", friction = 0.0 }, { face = "steel:bottom", friction = 0.0 }]
[[prescribed_displacement]]
face = "foam:top"
value = [0.0, 0.0, -1e-4]
[[prescribed_displacement]]
face = "steel:right"
value = [0.0, 0.0, 0.0]
"""
FOAM_BESIDE_STEEL += part("foam", (0.1,) * 3, (2, 2, 2), young=1e4) + part(
    "steel", (0.1,) * 3, (2, 2, 2), (1.0, 0.0, 0.0)
)


def test_held_nodes_are_judged_by_their_own_body(tmp_path, monkeypatch):
    """A ten-millionth of the displacement of the foam, which is twice that of the steel."""
    folder = run_case(FOAM_BESIDE_STEEL, tmp_path / "run")
    assert check(folder).passed
    monkeypatch.setattr(OtherNodes, "remaining", lambda self, u: np.full(len(self.nodes), -1e-11))
    found = check(folder).certificate
    assert [one.name for one in found.checks if not one.passed] == ["penetration"]


APART = """\
output = { picture = false }
clamp = [{ face = "lower:left" }]
prescribed_displacement = [{ face = "upper:top", value = [0.0, 0.0, -0.02] }]
contact = [{ face = "lower:bottom", friction = 0.2 }]
"""
APART += part("lower", (1.0, 1.0, 0.5), (2, 2, 2)) + part("upper", (0.6, 1.0, 0.5), (1, 1, 1), (0.2, 0.0, 0.51))
"""A block is pushed into another one, with which it has no contact."""


def test_surfaces_that_run_through_each_other_are_judged_again(tmp_path):
    (tmp_path / "case.toml").write_text(APART)
    done = run_coulomb("run", tmp_path / "case.toml", "--output", tmp_path / "results", code=1)
    assert "'upper:bottom' is 10 mm inside, through 'lower:top'" in done.stderr
    folder = tmp_path / "results"
    found = check(folder)
    assert (
        found.certificate.passed and not found.faults and not found.passed and "through each other" in found.outside[0]
    )
    summary = json.loads((folder / "summary.json").read_text())
    inside = summary["small_strain"]["inside"]
    assert not summary["valid"] and inside["depth"] == pytest.approx(0.01) and inside["place"][2] == 0.51
    summary["small_strain"] |= {"overlap": 0.0, "inside": None, "violations": [], "warnings": []}
    (folder / "summary.json").write_text(json.dumps({**summary, "valid": True}))
    hidden = check(folder)
    assert not hidden.passed and any("small_strain.overlap" in fault for fault in hidden.faults) and hidden.outside
