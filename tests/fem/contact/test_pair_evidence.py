"""Pairs are judged by code that shares nothing with the mortar integration: faults planted there are seen, no others.

Run alone, or as `mpirun -n 3 python -m pytest tests/fem/contact/test_pair_evidence.py`.
"""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
from test_curved_pairs import RADIUS, rolled, roller

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Cylinder,
    Material,
    Plane,
    PrescribedDisplacement,
    SymmetryPlane,
    Traction,
    box,
    join,
    moved,
)
from coulomb.fem.contact import mortar, pair
from coulomb.fem.contact.closest_points import Facets, hits, off_linear
from coulomb.model import contact_faces, problem_evidence
from coulomb.model.certificate import judge
from verification.ring_pair import rings

STEEL = Material(2.1e11, 0.3)
LINES = ("pair gap", "pair displacement", "pair normal", "pair weights", "pair points")


def blocks(shift=0.1, cells=("hexahedron", "hexahedron"), degree=1, distorted=0.0, way=(0.0, 0.0, 0.0), **contact):
    """A block on a block, of which a shift leaves a part beyond the other; distorted along both faces."""

    def bent(x):
        return x + distorted * np.sin(np.pi * x[0]) * np.sin(np.pi * x[1]) * np.array([[1.0], [-0.7], [0.0]])

    def above(x):
        return np.diag([0.8, 0.8, 0.4]) @ bent(x) + np.array([[shift], [0.1], [0.5]])

    lower = box((1.0, 1.0, 0.5), (3, 3, 1), cells[0], place=bent, degree=degree)
    upper = box((1.0, 1.0, 1.0), (4, 4, 1), cells[1], place=above, degree=degree)
    pair = Contact("upper:bottom", against="lower:top", friction=0.3, **contact)
    held = [Clamp("lower:bottom"), PrescribedDisplacement("upper:top", way)]
    return ContactProblem(join(lower=lower, upper=upper), STEEL, held, pair)


CIRCLE = {"surface": Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), RADIUS)}
PLANE = {"against_surface": Plane((0.0, 0.0, -RADIUS), (0.0, 0.0, 1.0))}
KINDS = {
    "flat": lambda: blocks(),
    "tetrahedra": lambda: blocks(cells=("hexahedron", "tetrahedron"), gap=1e-4),
    "partly covered": lambda: blocks(0.5, cells=("tetrahedron", "hexahedron"), slave=True),
    "distorted": lambda: blocks(distorted=0.05),
    "second order": lambda: blocks(cells=("tetrahedron", "tetrahedron"), degree=2),
    "27 nodes": lambda: blocks(degree=2),
    "given gap": lambda: blocks(gap=lambda x: 1e-3 * x[0] - 2e-4, gap_amplitude=0.5),
    "curved": lambda: rolled(12, "hexahedron", 1, 1e5, 0.3),
    "curved, second order": lambda: rolled(9, "hexahedron", 2, 1e5),
    "curved tetrahedra": lambda: rolled(24, "tetrahedron", 2, 1e5, 0.3),
    "fitting tetrahedra": lambda: rings(2, ("tetrahedron", "tetrahedron"), (2, 2)),
    "named surfaces": lambda: rolled(12, "hexahedron", 1, 1e5, slave=True, **CIRCLE, **PLANE),
    "smooth": lambda: rolled(12, "hexahedron", 1, 1e5, slave=True, smooth=True),
}


def judged(problem):
    """The certificate of a wavy displacement without forces."""
    u = 1e-5 * np.sin(problem.elasticity.x @ np.array([[30.0, 10.0, 20.0], [20.0, 40.0, 10.0], [50.0, 10.0, 30.0]]))
    return judge(problem.evidence(np.zeros(3 * len(problem.surface.nodes)), u))


def wrong_gap(patch):
    real = contact_faces.pair_of
    patch.setattr(contact_faces, "pair_of", lambda *a, **k: replace(p := real(*a, **k), gap=p.gap + 2e-6))


def wrong_rows(change):
    def plant(patch):
        real = mortar._rows
        patch.setattr(mortar, "_rows", lambda *a, **k: change(real(*a, **k)))

    return plant


def turned(rows):
    n = rows.normal + np.radians(2.0) * np.array([1.0, 0.0, 0.0])
    return replace(rows, normal=n / np.linalg.norm(n, axis=1)[:, None])


def moved_on(rows):
    """With 5 % of the master's weights at the node of the largest number."""
    last = scipy.sparse.csr_matrix(rows.opposite.shape).tolil()
    last[:, rows.opposite.indices.max(initial=0)] = 0.05
    return replace(rows, opposite=(0.95 * rows.opposite + last).tocsr())


def middle_of(rows):
    """The contact point nearest to the middle of all."""
    return np.argmin(np.linalg.norm(rows.x - rows.x.mean(axis=0), axis=1))


def one_left_out(patch):
    """A contact point is left out, and those beside it take its part."""
    real = pair.clamped_nodes

    def one_more(body, facets):
        on = np.intersect1d(body.nodes_of(facets), body.vertices.node)
        away = np.linalg.norm(body.x[on] - body.x[on].mean(axis=0), axis=1)
        return np.union1d(real(body, facets), on[away == away.min(initial=np.inf)][:1])

    patch.setattr(pair, "clamped_nodes", one_more)


def one_row_wrong(rows):
    """One average over the slave has 5 % of its weight at another node."""
    row = scipy.sparse.diags(0.05 * (np.arange(len(rows.node)) == middle_of(rows)))
    return replace(
        rows,
        weights=(rows.weights - row @ rows.weights + row @ rows.weights[np.roll(np.arange(len(rows.node)), 1)]).tocsr(),
    )


FAULTS = (
    ("pair gap", wrong_gap),
    ("pair normal", wrong_rows(turned)),
    ("pair weights", wrong_rows(lambda rows: replace(rows, area=1.02 * rows.area))),
    ("pair weights", wrong_rows(one_row_wrong)),
    ("pair displacement", wrong_rows(moved_on)),
    ("pair points", one_left_out),
)


@pytest.mark.parametrize("kind", KINDS)
def test_right_pairs_pass_and_wrong_ones_fail(kind, monkeypatch):
    right = judged(KINDS[kind]())
    assert {name: right[name].value for name in LINES} == dict.fromkeys(LINES, 0.0)
    for line, plant in FAULTS:
        with monkeypatch.context() as patch:
            plant(patch)
            wrong = judged(KINDS[kind]())
            assert not wrong[line].passed and "; worst: '" in wrong[line].meaning


def test_a_gap_that_is_closed_is_judged_by_its_distance(monkeypatch):
    assert judged(blocks(adjust=1e-5))["pair gap"].value == 0.0
    assert judged(blocks(adjust=(0.0, 1e-5)))["pair gap"].value == 0.0  # its gaps stay
    wrong_gap(monkeypatch)
    assert not judged(blocks(adjust=1e-5))["pair gap"].passed


def test_a_wrong_matrix_is_seen(monkeypatch):
    real = problem_evidence.rows_of
    monkeypatch.setattr(problem_evidence, "rows_of", lambda B, u: real(B, u) * [1.0, 1.0, 1.001])
    assert not judged(blocks())["pair displacement"].passed


def test_at_planes_of_symmetry_normals_are_in_them(monkeypatch):
    """A quarter of a dome, whose facets at the planes have normals beyond them."""

    def dome(k):
        x, y = 0.01 * k[0], 0.01 * k[1]
        return np.stack([x, y, 0.01 * k[2] + 20.0 * (1.0 - k[2]) * (x**2 + y**2)])

    def quarter(**contact):
        plate = moved(box((0.012, 0.012, 0.004), (3, 3, 1)), translate=(0.0, 0.0, -0.004))
        planes = [SymmetryPlane(f"{name}:{face}") for name in ("upper", "lower") for face in ("left", "front")]
        return ContactProblem(
            join(upper=box((1.0, 1.0, 1.0), (5, 5, 1), place=dome), lower=plate),
            STEEL,
            [Clamp("lower:bottom"), *planes],
            Contact("upper:bottom", against="lower:top", friction=0.3, slave=True, **contact),
        )

    for contact in ({}, {"smooth": True}):
        right = judged(quarter(**contact))
        assert {name: right[name].value for name in LINES} == dict.fromkeys(LINES, 0.0)
        with monkeypatch.context() as patch:
            wrong_gap(patch)
            assert not judged(quarter(**contact))["pair gap"].passed


def paraboloid(corners, degree):
    """z = 0.1 (x^2 + y^2) over the unit square, of four by four squares."""
    side = np.linspace(0.0, 1.0, 5 if degree == 1 else 9)
    x, y = (of.ravel() for of in np.meshgrid(side, side, indexing="ij"))
    places = np.column_stack([x, y, 0.1 * (x**2 + y**2)])
    width, nodes = len(side), []
    for i in range(0, width - 1, degree):
        for j in range(0, width - 1, degree):
            at = [i * width + j, (i + degree) * width + j, (i + degree) * width + j + degree, i * width + j + degree]
            for three in ([0, 1, 2], [0, 2, 3]) if corners == 3 else ([0, 1, 2, 3],):
                ends = [at[k] for k in three]
                middles = [(a + b) // 2 for a, b in zip(ends, ends[1:] + ends[:1], strict=True)]
                centre = [] if corners == 3 else [(at[0] + at[2]) // 2]
                nodes.append(ends + (middles + centre if degree == 2 else []))
    nodes = np.array(nodes)
    return Facets(corners, degree, nodes, places[nodes], np.ones(len(nodes)))


@pytest.mark.parametrize(("corners", "degree"), [(3, 1), (4, 1), (3, 2), (4, 2)])
def test_lines_meet_a_paraboloid(corners, degree):
    """From below and from above, within the facets; to the error of their interpolation."""
    face = paraboloid(corners, degree)
    start = np.random.default_rng(0).uniform(-0.2, 1.2, (400, 3)) * [1.0, 1.0, 0.0] + [0.0, 0.0, 0.05]
    along = np.broadcast_to([0.0, 0.0, -1.0], start.shape)
    found = hits(start, along, face, 1.0, 1.0)
    inside = np.all((start[:, :2] > 0.0) & (start[:, :2] < 1.0), axis=1)
    assert np.array_equal(found.facet >= 0, inside)
    expected = 0.05 - 0.1 * np.sum(start[inside, :2] ** 2, axis=1)
    assert np.abs(found.way[inside] - expected).max() <= (0.1 * 2 / 4 / 16 + 1e-12 if degree == 1 else 1e-12)
    assert not np.any(hits(start, -along, face, 1.0, 1.0).facet >= 0)  # from behind


@pytest.mark.parametrize(("corners", "degree"), [(3, 1), (4, 1), (3, 2), (4, 2)])
def test_distances_from_a_curved_face_change_otherwise_than_linear_ones(corners, degree):
    """A point goes along it: by the slope and the curvature there; chords explain a part.  Both may move as one."""
    face = paraboloid(corners, degree)
    x, way = np.array([[0.31, 0.42, 0.3]] * 4), np.array([0.0, 0.05, 0.3, 2.0])
    n, u = np.array([[0.0, 0.0, -1.0]] * 4), np.outer(way, [1.0, 0.0, 0.0]) + [0.0, 0.0, -0.1]
    off = off_linear(face, x, n, u, np.zeros_like(face.x), np.zeros(4))
    expected = -0.1 * (2.0 * 0.31 * way + way**2)
    expected[3] = 2.0  # beyond its end
    assert off == pytest.approx(expected, abs=1e-12 if degree == 2 else 0.1 * 0.25 * 0.2)
    assert degree == 2 or abs(off[1]) < abs(expected[1])
    less = off_linear(face, x, n, u, np.zeros_like(face.x), np.full(4, 0.02))
    assert off[1] - less[1] == pytest.approx(max(off[1], -0.02 * 0.05), rel=1e-6)
    there = np.broadcast_to([0.3, 0.2, 0.1], face.x.shape)
    assert np.abs(off_linear(face, x, n, there[: len(x), 0], there, np.zeros(4))).max() <= 1e-12


def in_a_cup(aside, degree=2):
    """The roller, pressed by 0.1 mm into a cup of 1.2 times its radius, and moved to the side."""

    def place(k):
        angle = np.radians(50.0) * (2.0 * k[0] - 1.0)
        rim = np.stack([0.012 * np.sin(angle), 0.012 - RADIUS - 0.012 * np.cos(angle)])
        x, z = k[2] * rim + (1.0 - k[2]) * np.stack([0.012 * np.sin(angle), np.full_like(angle, -1.5 * RADIUS)])
        return np.stack([x, 0.002 * k[1], z])

    sides = [Clamp(f"{name}:{face}", "y") for name in ("upper", "cup") for face in ("front", "back")]
    cup = box((1.0, 1.0, 1.0), (8, 1, 2), place=place, degree=degree)
    return ContactProblem(
        join(upper=roller(8, "hexahedron", degree), cup=cup),
        STEEL,
        [Clamp("cup:bottom"), PrescribedDisplacement("upper:top", (aside, 0.0, -1e-4)), *sides],
        Contact("upper:bottom", against="cup:top", friction=0.0),
    )


def test_faces_that_move_along_each_other_are_judged_where_they_are():
    """Fixed normals and places opposite: right with a small slip, at 1 mm the force to the side is 25 % off that of
    large motions, and nodes are inside, which nothing else sees."""
    answer = in_a_cup(1e-3).solve()
    assert answer.certificate.passed and answer.small_strain.inside is None and not answer.valid
    (text,) = answer.outside
    assert "of the deformation off it, 5" in text and "m of 'upper:bottom'" in text
    small = in_a_cup(1e-5).solve()
    assert small.valid and 0.0 < small.small_strain.gap_error < 0.05


def test_a_body_that_has_left_the_one_below_it():
    """Beyond its end, by more than a facet, it would still stand on it."""

    assert blocks(way=(1e-5, 0.0, -1e-6)).solve().small_strain.gap_error <= 1e-4
    off = blocks(way=(0.9, 0.0, -1e-6)).solve()
    assert off.certificate.passed and off.small_strain.gap_error > 1.0 and "of 'upper:bottom'" in off.outside[0]


@pytest.mark.parametrize("degree", [1, 2])
def test_a_vertex_that_gets_in_and_a_force_that_is_wrong(degree):
    """By lines of the certificate that are there: equilibrium and penetration, which says how deep and where."""
    answer = blocks(degree=degree, way=(0.0, 0.0, -1e-5)).solve()
    x, u, surface = answer.contact_force.copy(), answer.displacement.copy(), answer.problem.surface
    k = int(np.argmin(np.linalg.norm(surface.x - surface.x.mean(axis=0), axis=1)))
    u[surface.nodes[k]] += 2e-6 * surface.frames[k, 0]
    wrong = judge(answer.problem.evidence(x, u))
    assert not wrong["equilibrium"].passed and not wrong["penetration"].passed
    assert wrong.penetration == pytest.approx(2e-6, rel=1e-3)
    place = ", ".join(f"{at:.4g}" for at in surface.x[k])
    assert f"worst at ({place}) m of 'upper:bottom'" in wrong["penetration"].meaning
    x[3 * k] *= 1.001
    assert not judge(answer.problem.evidence(x, answer.displacement))["equilibrium"].passed


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_large_facet_on_many_small_ones(cell):
    """Its points see every one of these, and the force is that of the load."""
    low = box((1.0, 1.0, 0.5), (12, 12, 1))
    up = moved(box((1.0, 1.0, 0.5), (1, 1, 1), cell), (0.0, 0.0, 0.5))
    contact = Contact("up:bottom", friction=0.3, against="low:top", slave=True)
    load = [Traction("up:top", (2e5, 0.0, -1e6))]
    answer = ContactProblem(join(low=low, up=up), Material(2e11, 0.3), [Clamp("low:bottom")], contact, load).solve()
    assert answer.valid and answer.at_nodes.totals()["normal_force"] == pytest.approx(1e6, rel=1e-9)


@pytest.mark.parametrize("size", [1.0, 1e6])
def test_a_facet_with_a_node_that_has_nothing_opposite_on_it(size):
    """Of any size, as of parts in millimetres: its mean there was of rounding errors over 1e-300, infinite."""
    lower = box((size, size, 0.3 * size), (3, 2, 2), degree=2)
    upper = moved(box((0.6 * size, 0.6 * size, 0.2 * size), (2, 1, 1)), (0.2 * size, 0.2 * size, 0.3 * size))
    contact, loads = Contact("upper:bottom", 0.3, against="lower:top"), [Traction("upper:top", (0.0, 0.0, -1e-4))]
    bodies, clamps = join(lower=lower, upper=upper), [Clamp("lower:bottom")]
    assert ContactProblem(bodies, Material(1.0, 0.3), clamps, contact, loads).solve().valid


@pytest.mark.parametrize("parts", [4, 8])
def test_a_fine_zone_of_the_master_needs_more_points_and_is_no_fault(parts):
    """A tenth of the master has cells so small that the lines of a slave facet miss most of them."""
    fine = 0.5 + 0.1 * np.arange(1, parts + 1) / parts
    lines = np.concatenate([np.linspace(0.0, 0.5, 5), fine, np.linspace(0.6, 1.0, 5)[1:]])

    def above(x):
        return np.stack([0.3 + np.interp(x[0], np.linspace(0.0, 1.0, len(lines)), lines), x[1], x[2] + 0.5])

    upper = box((1.0, 0.2, 0.3), (len(lines) - 1, 1, 1), place=above)
    bodies = join(upper=upper, lower=box((2.0, 0.2, 0.5), (7, 1, 2)))
    supports = [Clamp("lower:bottom"), PrescribedDisplacement("upper:top", (0.0, 0.0, -1e-5))]
    pair = Contact("lower:top", 0.2, against="upper:bottom", slave=True)
    assert ContactProblem(bodies, STEEL, supports, pair).solve().valid
