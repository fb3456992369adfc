"""Pairs of faces found by `auto_pairs`, on any number of ranks: alone, or with mpirun."""

from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from mesh_files import BoxFile, integral
from mpi4py import MPI
from ranks import same_error
from shared_problems import ring_mesh

from coulomb import Clamp, Contact, ContactProblem, Material, Traction, auto_pairs, box, join, moved, read_mesh
from coulomb.fem.meshes import NamedMesh, boundary_facets, corners_of, distributed

comm = MPI.COMM_WORLD
KINDS = [("hexahedron", 1), ("tetrahedron", 1), ("hexahedron", 2), ("tetrahedron", 2)]


def names(found):
    return [(pair.face, pair.against) for pair in found.pairs]


def nameless(mesh):
    return replace(mesh, faces={})


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_a_block_on_a_larger_one(cell, degree):
    """Faces that overlap in part, of meshes that do not match; the sides of the blocks face nothing."""
    above = moved(box((0.8, 0.4, 0.4), (5, 3, 2), cell, degree=degree), (0.2, 0.1, 0.401))
    found = auto_pairs(join(lower=box((1.2, 0.6, 0.4), (7, 4, 2)), upper=above), 2e-3)
    assert names(found) == [("lower:top", "upper:bottom")] and found.made == ()
    assert found.pairs[0].area == pytest.approx(0.32, rel=1e-12)
    assert found.pairs[0].gap == pytest.approx((1e-3, 1e-3), rel=1e-9)


def test_sheets_touch_the_next_ones_only():
    """Whatever the distance: sheets between hide those behind them, and so does a body's own wall."""
    sheets = {f"s{k}": moved(box((1.0, 1.0, 0.1), (3 + k, 4, 1)), (0.0, 0.0, 0.1 * k)) for k in range(4)}
    for distance in (1e-6, 0.15, 0.5, 10.0):
        found = auto_pairs(join(sheets), distance)
        assert names(found) == [("s0:top", "s1:bottom"), ("s1:top", "s2:bottom"), ("s2:top", "s3:bottom")]
        assert [pair.area for pair in found.pairs] == pytest.approx([1.0] * 3, rel=1e-12)


@pytest.mark.parametrize("degree", [1, 2])
def test_a_shaft_in_a_bore(degree):
    """Chords of both cross: gaps on both sides of the clearance; an interference is found as well."""
    shape = {"angle": 1.5 * np.pi, "height": 1.0, "degree": degree}
    bore = ring_mesh(1.01, 2.0, (2, 18, 3), **shape)
    for radius, sign in ((1.0, 1.0), (1.02, -1.0)):
        shaft = ring_mesh(0.5, radius, (2, 15, 4), **shape)
        (pair,) = auto_pairs(join(bore=bore, shaft=shaft), 0.03).pairs
        assert (pair.face, pair.against) == ("bore:left", "shaft:right")
        assert pair.area == pytest.approx(1.5 * np.pi, rel=0.04)
        assert pair.gap == pytest.approx((0.01 * sign, 0.01 * sign), abs=0.013 if degree == 1 else 3e-4)
        assert pair.gap[0] < 0.01 * sign < pair.gap[1]
        found = auto_pairs(join(bore=nameless(bore), shaft=nameless(shaft)), 0.03)
        assert names(found) == [("bore:facing_shaft", "shaft:facing_bore")]
        made = found.mesh.faces
        for name, whole in (("bore:facing_shaft", bore.faces["left"]), ("shaft:facing_bore", shaft.faces["right"])):
            assert np.array_equal(np.sort(made[name]), np.sort(whole))


def test_facets_without_a_name_become_a_face():
    """Of several bodies those that face each, and a solve with them; a body may have named faces beside."""
    lower = box((1.0, 1.0, 0.5), (8, 4, 2))
    lower = replace(lower, faces={"base": lower.faces["bottom"]})
    pads = [nameless(box((0.25, 0.5, 0.25), (3, 4, 2), "tetrahedron")) for _ in range(2)]
    mesh = join(base=lower, one=moved(pads[0], (0.125, 0.25, 0.5)), two=moved(pads[1], (0.625, 0.25, 0.5)))
    found = auto_pairs(mesh, 1e-3)
    expected = [("base:facing_one", "one:facing_base"), ("base:facing_two", "two:facing_base")]
    assert names(found) == expected and set(found.made) == {name for pair in expected for name in pair}
    for number, name in enumerate(("one", "two")):
        assert found.pairs[number].area == pytest.approx(0.125, rel=1e-12)
        assert integral(found.mesh.bodies["base"], f"facing_{name}") == pytest.approx(0.125)
        assert integral(found.mesh.bodies[name], "facing_base") == pytest.approx(0.125)
    assert "facing_one" not in mesh.bodies["base"].faces  # the given mesh stays as it is


def test_pads_smaller_than_the_facets_below_them():
    """Lines of the pads meet the facets, whose own miss the pads; also where these are on other ranks."""
    pad = box((0.02, 0.02, 0.02), (1, 1, 1))
    pads = {name: nameless(moved(pad, (x, 0.41, 0.5))) for name, x in (("left", 0.31), ("right", 0.81))}
    found = auto_pairs(join(base=nameless(box((1.0, 1.0, 0.5), (2, 1, 1))), **pads), 1e-3)
    assert names(found) == [(f"base:facing_{name}", f"{name}:facing_base") for name in pads]
    assert [pair.area for pair in found.pairs] == pytest.approx([4e-4] * 2, rel=1e-12)
    assert [integral(found.mesh.bodies["base"], f"facing_{name}") for name in pads] == pytest.approx([0.5] * 2)


def test_of_several_names_that_of_the_smallest_face():
    lower, upper = box((1.0, 1.0, 0.5), (4, 4, 2)), moved(box((1.0, 1.0, 0.5), (3, 3, 1)), (0.0, 0.0, 0.5))
    skin = np.unique(np.concatenate(list(lower.faces.values()))).astype(np.int32)
    for faces in ({"skin": skin, **lower.faces}, {**lower.faces, "skin": skin}):
        found = auto_pairs(join(lower=replace(lower, faces=faces), upper=upper), 1e-3)
        assert names(found) == [("lower:top", "upper:bottom")]
    found = auto_pairs(join(lower=replace(lower, faces={"skin": skin}), upper=upper), 1e-3)
    assert names(found) == [("lower:skin", "upper:bottom")] and found.pairs[0].area == pytest.approx(1.0)


def two_in_a_file(folder, gap, keep, grouped):
    """Two boxes in one file, the second above the first, which share no node."""
    one, other = BoxFile((1.0, 1.0, 0.5), (2, 2, 1)), BoxFile((1.0, 1.0, 0.5), (3, 2, 1), "hexahedron")
    faces = {f"low_{name}": rows for name, rows in one.faces.items()}
    faces |= {f"high_{name}": rows + len(one.points) for name, rows in other.faces.items()}
    one.cells = np.concatenate([one.cells, other.cells + len(one.points)])
    one.points = np.concatenate([one.points, other.points + np.array([0.0, 0.0, 0.5 + gap])])
    one.faces = {name: faces[name] for name in keep}
    one.cell_groups = {"all": np.arange(len(one.cells))}
    if grouped:
        one.cell_groups = {"steel": np.arange(4), "rubber": np.arange(4, len(one.cells))}
    return one.write(folder / "two.msh")


@pytest.mark.parametrize("grouped", [False, True])
@pytest.mark.parametrize("keep", [(), ("low_bottom", "high_top"), ("low_top", "high_bottom"), ("low_top",)], ids=str)
def test_components_of_one_mesh(keep, grouped):
    with TemporaryDirectory() as folder:
        path = Path(comm.bcast(folder if comm.rank == 0 else None)) / "two.msh"
        if comm.rank == 0:
            two_in_a_file(path.parent, 1e-4, keep, grouped)
        comm.barrier()
        mesh = read_mesh(str(path))
        comm.barrier()
    found = auto_pairs(mesh, 1e-3)
    one, other = ("steel", "rubber") if grouped else ("all_1", "all_2")
    low = "low_top" if "low_top" in keep else f"{one}_facing_{other}"
    high = "high_bottom" if "high_bottom" in keep else f"{other}_facing_{one}"
    assert {*found.pairs[0].bodies} == {one, other}
    assert {*found.pairs[0].groups} == ({one, other} if grouped else {"all"})
    assert {*names(found)[0]} == {low, high} and len(found.pairs) == 1
    assert found.pairs[0].area == pytest.approx(1.0) and found.pairs[0].gap == pytest.approx((1e-4, 1e-4), rel=1e-6)
    assert [integral(found.mesh, name) for name in (low, high)] == pytest.approx([1.0, 1.0])


def clip(kept=("low", "high")):
    """A strip bent into a U: its two arms face each other."""

    def place(x):
        along, z = x[0], 0.2 * (x[2] - 0.5)
        arm = np.clip(along, 1.0, 2.0)
        turn = np.pi * (arm - 1.0)
        r = 0.15 + z
        straight = np.where(along < 1.0, along - 1.0, np.where(along > 2.0, 2.0 - along, 0.0))
        return np.stack([straight + r * np.sin(turn), 0.2 * x[1], -r * np.cos(turn)])

    mesh = box((3.0, 1.0, 1.0), (18, 2, 2), place=place)
    facets = mesh.faces["bottom"]
    middle = mesh.domain.geometry.x[corners_of(mesh.domain, facets)].mean(axis=1)
    arms = {"low": (middle[:, 0] < 0.0) & (middle[:, 2] < 0.0), "high": (middle[:, 0] < 0.0) & (middle[:, 2] > 0.0)}
    return replace(mesh, faces={name: facets[arms[name]] for name in kept})


def test_arms_of_one_body():
    """With names, with one, and without: half of the bend then belongs to each.  The arms' own thickness is no gap."""
    found = auto_pairs(clip(), 0.12)
    assert names(found) == [("low", "high")]
    assert found.pairs[0].gap == pytest.approx((0.1, 0.1), rel=1e-9)
    one = auto_pairs(clip(("low",)), 0.12)
    assert {"low", "facing_low"} in [{*pair} for pair in names(one)]  # the bend has sheets of its own
    low = sum(pair.area for pair in one.pairs if "low" in (pair.face, pair.against))
    assert low == pytest.approx(found.pairs[0].area, rel=0.05)
    bare = auto_pairs(clip(()), 0.12)
    assert names(bare) == [("facing_itself_1", "facing_itself_2")] and len(bare.made) == 2
    assert bare.pairs[0].gap == pytest.approx((0.1, 0.1), rel=0.2)
    assert "no faces of different bodies" in same_error(lambda: auto_pairs(clip(()), 0.05))


@pytest.mark.parametrize("kept", [(), ("up",), ("low",), ("up", "low")], ids=str)
def test_sides_of_a_notch_are_no_pair(kept):
    """Facets that meet at its edge."""
    inner, outer = (np.array([(-1.0, z), (x, 0.0), (-1.0, -z)]) for x, z in ((0.0, 0.5), (0.6, 0.8)))

    def place(k):
        at = np.rint(k[0]).astype(int)
        x, z = ((1.0 - k[2]) * outer[at].T + k[2] * inner[at].T).reshape(2, -1)
        return np.stack([x, k[1], z])

    mesh = box((2.0, 1.0, 1.0), (2, 1, 1), place=place)
    facets = mesh.faces["top"]
    up = mesh.domain.geometry.x[corners_of(mesh.domain, facets)].mean(axis=1)[:, 2] > 0.0
    named = replace(mesh, faces={name: facets[up if name == "up" else ~up] for name in kept})
    assert "nor at any distance" in same_error(lambda: auto_pairs(named, 0.5))


HEXAHEDRON = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]


@pytest.mark.parametrize("kept", [("tongue",), ("tongue", "left")], ids=str)
def test_a_tongue_between_two_jaws_of_its_body(kept):
    """Both sides of the tongue have one name, of the jaws one or none has."""
    x, y, z = np.array([0.0, 1.0, 1.02, 2.0, 2.02, 3.0]), np.linspace(0.0, 1.0, 3), np.array([0.0, 1.0, 2.0, 3.0])
    points, shape = np.array(list(product(x, y, z))), (6, 3, 4)
    origins = [at for at in product(range(5), range(2), range(3)) if at[0] % 2 == 0 or at[2] == 0]
    cells = np.array([[np.ravel_multi_index(tuple(np.add(at, c)), shape) for c in HEXAHEDRON] for at in origins])
    first = comm.rank == 0
    domain = distributed(comm, points[: None if first else 0], cells[: None if first else 0])
    facets = boundary_facets(domain)
    at = domain.geometry.x[corners_of(domain, facets)].mean(axis=1)
    on = {"tongue": np.abs(np.abs(at[:, 0] - 1.51) - 0.49) < 1e-9, "left": np.abs(at[:, 0] - 1.0) < 1e-9}
    found = auto_pairs(NamedMesh(domain, {name: facets[on[name] & (at[:, 2] > 1.0)] for name in kept}), 0.03)
    expected = {("facing_tongue", "tongue"): 2.0 * (3 - len(kept))} | {("tongue", "left"): 2.0}
    assert {names(found)[k]: found.pairs[k].area for k in range(len(found.pairs))} == pytest.approx(
        dict(list(expected.items())[: len(kept)])
    )
    assert integral(found.mesh, "facing_tongue") == pytest.approx(2.0 * (3 - len(kept)))


def test_a_solve_is_that_of_the_pair_given_by_hand():
    def totals(mesh, contacts):
        held, load = [Clamp("lower:bottom")], [Traction("upper:top", (2e6, 0.0, -1e7))]
        problem = ContactProblem(mesh, Material(2.1e11, 0.3), held, contacts, load)
        return problem.solve(1e-10).at_nodes.totals()["force"]

    lower, upper = (
        box((1.2, 0.6, 0.4), (5, 3, 2)),
        moved(box((0.8, 0.4, 0.4), (4, 3, 2), "tetrahedron"), (0.2, 0.1, 0.4)),
    )
    by_hand = totals(join(lower=lower, upper=upper), [Contact("upper:bottom", 0.3, against="lower:top")])
    found = auto_pairs(join(lower=lower, upper=upper), 1e-4)
    contacts = [Contact(pair.face, 0.3, against=pair.against) for pair in found.pairs]
    assert np.allclose(totals(found.mesh, contacts), by_hand, rtol=0.0, atol=1e-10 * np.abs(by_hand).max())


def test_errors_are_the_same_on_all_ranks():
    apart = join(a=box((1.0, 1.0, 0.1), (3, 3, 1)), b=moved(box((1.0, 1.0, 0.1), (2, 2, 1)), (0.0, 0.0, 0.3)))
    assert "'a:top' and 'b:bottom', are 200 mm apart" in same_error(lambda: auto_pairs(apart, 0.1))
    beside = join(a=box((1.0, 1.0, 0.1), (3, 3, 1)), b=moved(box((1.0, 1.0, 0.1), (2, 2, 1)), (3.0, 3.0, 3.0)))
    assert "nor at any distance" in same_error(lambda: auto_pairs(beside, 0.1))
    for wrong in (0.0, -1.0, np.nan, "1e-3", None):
        assert "distance must be a number of metres > 0" in same_error(lambda wrong=wrong: auto_pairs(apart, wrong))
    assert "takes a mesh" in same_error(lambda: auto_pairs("lower", 0.1))
