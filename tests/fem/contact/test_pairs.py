"""Contact of two deformable faces: gaps that meshes leave, slips beyond the theory, wrong input."""

import numpy as np
import pytest
from shared_problems import ring_mesh
from user_forms import Script

from coulomb import (
    Body,
    Clamp,
    Contact,
    ContactProblem,
    Elasticity,
    Material,
    PrescribedDisplacement,
    SymmetryPlane,
    box,
    join,
    moved,
)

STEEL, ALUMINIUM = Material(2.1e11, 0.3), Material(7e10, 0.33)


def pressed(gap=0.0, adjust=0.0, push=1e-5, friction=0.3, given=0.0):
    """A block on a block, its top pressed down by 1e-4 m and pushed along x."""
    lower = box((1.0, 1.0, 0.5), (3, 3, 2))
    upper = moved(box((0.8, 0.8, 0.4), (4, 4, 2)), (0.1, 0.1, 0.5 + gap))
    supports = [Clamp("lower:bottom"), PrescribedDisplacement("upper:top", (push, 0.0, -1e-4))]
    pair = Contact("upper:bottom", against="lower:top", friction=friction, adjust=adjust, gap=given)
    return ContactProblem(join(lower=lower, upper=upper), {"lower": STEEL, "upper": ALUMINIUM}, supports, pair)


def force(problem):
    solution = problem.solve()
    assert solution.certificate.passed
    return np.array(solution.at_nodes.totals()["force"])


def same(one, other, tolerance):
    return np.linalg.norm(one - other) <= tolerance * np.linalg.norm(other)


@pytest.mark.parametrize("gap", [2e-5, -2e-5])
def test_gaps_of_meshes_are_closed_without_strain(gap):
    closed = force(pressed())
    left = force(pressed(gap))
    assert np.sign(left[2] - closed[2]) == -np.sign(gap)
    assert np.abs(left[2] - closed[2]) == pytest.approx(abs(gap) / 1e-4 * closed[2], rel=0.02)  # where all press
    assert same(force(pressed(gap, adjust=1e-4)), closed, 1e-4)  # the body is elsewhere by the gap
    assert same(force(pressed(gap, adjust=1e-6)), left, 1e-9)
    gaps, penetrations = (force(pressed(gap, adjust=pair)) for pair in ((1e-4, 0.0), (0.0, 1e-4)))
    assert same(gaps, closed if gap > 0.0 else left, 1e-4) and same(penetrations, left if gap > 0.0 else closed, 1e-4)


def test_slip_beyond_the_nodes_opposite_is_a_warning():
    """Frictionless: the block slides by more than a cell, where other nodes would be opposite."""
    few, many = pressed(push=0.02, friction=0.0).solve(), pressed(push=0.3, friction=0.0).solve()
    assert few.small_strain.slip_over_cell < 1.0 < many.small_strain.slip_over_cell
    assert any("nodes opposite" in text for text in many.small_strain.warnings)


def test_a_given_gap_adds_to_the_distance():
    assert same(force(pressed(given=3e-5)), force(pressed(3e-5)), 1e-4)


@pytest.mark.parametrize("cells, young, why", [((2, 2, 1), 7e10, "finer"), ((3, 3, 1), 7e10, "softer")])
def test_the_finer_or_softer_face_is_the_slave(cells, young, why):
    lower, upper = box((1.0, 1.0, 0.5), (3, 3, 1)), moved(box((1.0, 1.0, 0.5), cells), (0.0, 0.0, 0.5))
    materials = {"lower": Material(2.1e11, 0.3), "upper": Material(young, 0.3)}
    slave = {"finer": "lower:top", "softer": "upper:bottom"}[why]
    for face, against in (("lower:top", "upper:bottom"), ("upper:bottom", "lower:top")):
        contact = Contact(face, against=against, friction=0.3)
        supports = [Clamp("lower:bottom"), Clamp("upper:top")]
        problem = ContactProblem(join(lower=lower, upper=upper), materials, supports, contact)
        assert problem.contacts[0].face == slave
        assert why in problem.body.chosen[0]


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("degree", [1, 2])
def test_bodies_of_one_material_are_not_softer_by_their_meshes(cell, degree):
    """Cells that are thin, or high, at a clamp or not: the face that is named first stays the slave."""
    thin, high = (box((1.0, 1.0, height), (3, 3, 1), cell, degree=degree) for height in (0.05, 2.0))
    bodies = join(lower=thin, upper=moved(high, (0.0, 0.0, 0.05)))
    for names in (("lower:top", "upper:bottom"), ("upper:bottom", "lower:top")):
        contact = Contact(names[0], against=names[1], friction=0.3)
        problem = ContactProblem(bodies, STEEL, [Clamp("lower:bottom"), Clamp("upper:front")], contact)
        assert problem.contacts[0].face == names[0]
        assert "it was named first" in problem.body.chosen[0]


@pytest.mark.parametrize(("young", "why"), [(2.1e11, "named first"), (7e10, "softer")])
def test_a_body_of_own_forms_is_as_soft_as_its_form(young, why):
    script = Script(moved(box((1.0, 1.0, 2.0), (3, 3, 1)), (0.0, 0.0, 0.05)), 1)
    bedded = script.elasticity(young, 0.3) + 1e9 * script.u[2] * script.v[2] * script.ds("top")
    lower = Elasticity(box((1.0, 1.0, 0.05), (3, 3, 1)), Material(2.1e11, 0.3), [Clamp("bottom")])
    bodies = join(lower=lower, upper=Body(bedded, None, faces=script.mesh))
    problem = ContactProblem(bodies, Contact("lower:top", against="upper:bottom", friction=0.3))
    assert why in problem.body.chosen[0]


def test_a_clamped_face_is_no_slave():
    """Although it has the finer mesh; with both clamped there is nothing to compute."""
    lower, upper = box((1.0, 1.0, 0.5), (4, 4, 1)), moved(box((1.0, 1.0, 0.5), (2, 2, 1)), (0.0, 0.0, 0.5))
    contact = Contact("upper:bottom", against="lower:top", friction=0.3)
    for supports in ([Clamp("lower:top"), Clamp("upper:top")], [Clamp("lower:top"), Clamp("upper:bottom")]):
        both = len({support.face for support in supports} & {"lower:top", "upper:bottom"}) == 2
        if both:
            with pytest.raises(ValueError, match="all of its nodes are clamped"):
                ContactProblem(join(lower=lower, upper=upper), STEEL, supports, contact)
        else:
            problem = ContactProblem(join(lower=lower, upper=upper), STEEL, supports, contact)
            assert problem.contacts[0].face == "upper:bottom"


def test_a_penetration_before_deformation_is_said(caplog):
    pressed(-2e-5)
    assert "penetrates 'lower:top' by up to 20 um" in caplog.text
    caplog.clear()
    pressed(-2e-5, adjust=1e-4)
    pressed(2e-5)
    assert not caplog.text


@pytest.mark.parametrize("cells, adjust, said", [(9, 0.0, True), (9, 2e-3, False), (6, 0.0, False)])
def test_gaps_of_coarse_curved_meshes_are_said_to_be_uncertain(cells, adjust, said, caplog):
    """A fit without gap: facets of other meshes leave gaps of h^2/(8 R); matching meshes none."""
    eighths = (ring_mesh(inner, inner + 0.5, (1, n, 1), 0.25 * np.pi) for inner, n in ((0.5, 6), (1.0, cells)))
    bodies = join(dict(zip(("lower", "upper"), eighths, strict=True)))
    supports = [Clamp("lower:left"), Clamp("upper:right")]
    pair = Contact("upper:left", against="lower:right", friction=0.3, adjust=adjust)
    ContactProblem(bodies, {"lower": STEEL, "upper": STEEL}, supports, pair)
    told = [text for text in caplog.messages if "gaps are uncertain" in text]
    assert len(told) == said
    if said:
        sagitta, unit = told[0].partition("up to ")[2].split()[:2]
        assert unit == "mm" and 1e-3 * float(sagitta) == pytest.approx((0.25 * np.pi / 6) ** 2 / 8.0, rel=0.02)


# --- planes of symmetry through a pair: half of both bodies has the answer of the whole ones ---

SOFT, STIFF = Material(1e9, 0.3), Material(3e9, 0.2)


def body(cells, whole, upper):
    """A block above or below z = 0 whose contact face is curved, across the plane x = 0 or on one side of it."""
    along, across, deep = cells

    def place(k):
        x = (k[0] - (along if whole else 0.0)) / along
        y, depth = k[1] / across, (k[2] if upper else deep - k[2]) / deep
        rise = 0.03 * x**2 + 0.03 * (y - 0.4) ** 2
        return np.stack([x, y, (depth + rise * (1.0 - depth)) * (1.0 if upper else -1.0)])

    size = ((2 if whole else 1) * along, across, deep)
    return box(size, size, place=place)


def solved(whole, smooth):
    """The bodies pressed together by 6 cm, and the upper one moved along the plane of symmetry; gaps between the facets
    or between smooth faces."""
    planes = () if whole else (SymmetryPlane("upper:left"), SymmetryPlane("lower:left"))
    problem = ContactProblem(
        join(upper=body((3, 3, 1), whole, True), lower=body((2, 2, 1), whole, False)),
        {"upper": SOFT, "lower": STIFF},
        [Clamp("lower:bottom"), PrescribedDisplacement("upper:top", (0.0, 4e-3, -0.06)), *planes],
        Contact("upper:bottom", against="lower:top", friction=0.3, smooth=smooth),
        small_strain="warn",
    )
    solution = problem.solve(1e-10)
    surface = solution.problem.surface
    right = surface.x[:, 0] > -1e-9
    x = surface.x[right]
    force = surface.vectors(solution.contact_force.reshape(-1, 3))[right]
    order = np.lexsort(np.round(x, 9).T)
    return x[order], force[order], solution.contact_force.reshape(-1, 3)[right][order]


@pytest.mark.parametrize("smooth", [False, True])
def test_half_is_half_of_the_whole(smooth):
    (x, whole, rows), (there, half, _) = solved(True, smooth), solved(False, smooth)
    assert there == pytest.approx(x, abs=1e-12)
    on_plane = np.abs(x[:, 0]) < 1e-9
    assert np.count_nonzero(on_plane) == 4 and np.count_nonzero(rows[:, 0] > 0.0) > 5
    expected = np.where(on_plane[:, None], 0.5, 1.0) * whole
    expected[on_plane, 0] = 0.0  # of the whole by symmetry, of the half by the plane
    assert np.abs(whole[on_plane, 0]).max() < 1e-7 * np.abs(whole).max()
    assert half == pytest.approx(expected, abs=1e-7 * np.abs(whole).max())
