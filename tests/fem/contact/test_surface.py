import numpy as np
import pytest
from conftest import STEEL
from scipy.spatial.transform import Rotation

import coulomb
from coulomb import Clamp, Contact, Elasticity, Plane
from coulomb.fem.contact.surface import contact_surface
from coulomb.fem.geometry.contact_frames import tangent_frames


def body(clamps=(Clamp("left"),), cell="hexahedron"):
    return Elasticity(coulomb.box((3.0, 1.0, 1.0), (6, 2, 2), cell), STEEL, clamps)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_nodes_frames_gap_and_area(cell):
    surface = contact_surface(body(cell=cell), "bottom")
    assert len(surface.nodes) == 6 * 3  # the clamped edge is left out
    assert np.allclose(surface.x[:, 2], 0.0, atol=1e-14) and np.all(surface.x[:, 0] > 0.0)
    assert np.allclose(surface.frames, np.array([[0, 0, -1], [1, 0, 0], [0, 1, 0]]))
    assert np.allclose(surface.gap, 0.0)
    inner = (surface.x[:, 0] < 2.99) & np.isclose(surface.x[:, 1], 0.5)
    assert np.allclose(surface.area[inner], 0.25)
    assert surface.area.sum() == pytest.approx(3.0 - 0.25)  # without the hats of the clamped edge


def test_contact_matrix_takes_components():
    elasticity = body()
    surface = contact_surface(elasticity, "bottom")
    u = np.random.default_rng(61).standard_normal(elasticity.x.shape)
    v = elasticity.K.createVecRight()
    v.array[:] = u.ravel()
    product = surface.B.createVecLeft()
    surface.B.mult(v, product)
    assert np.allclose(product.array.reshape(-1, 3), surface.components(u[surface.nodes]))
    assert np.allclose(surface.vectors(surface.components(u[surface.nodes])), u[surface.nodes])


def test_gap_to_a_plane_below_and_tilted():
    elasticity = body()
    low = contact_surface(elasticity, "bottom", Plane((0, 0, -0.25), (0, 0, 2.0)))
    assert np.allclose(low.gap, 0.25)
    tilted = contact_surface(elasticity, "bottom", Plane((0, 0, 0), (-0.6, 0, 0.8)))
    assert np.allclose(tilted.gap, -0.6 * tilted.x[:, 0])
    assert np.allclose(tilted.frames[:, 0], [0.6, 0, -0.8])


def test_frames_are_orthonormal_and_keep_axes():
    rng = np.random.default_rng(62)
    n = rng.standard_normal((200, 3))
    n[np.arange(50), rng.integers(0, 3, 50)] = 0.0
    n[50:53] = np.eye(3)
    n /= np.linalg.norm(n, axis=1)[:, None]
    frames = tangent_frames(n)
    assert np.allclose(np.einsum("kij,klj->kil", frames, frames), np.eye(3), atol=1e-12)
    assert np.array_equal(frames[:, 0], n)
    for k in range(200):
        for axis in range(3):
            if n[k, axis] == 0.0:  # an axis perpendicular to n is a tangent, up to rounding
                assert np.abs(frames[k, 1:, axis]).max() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Contact("bottom", 0.3, 1e7), "either friction .* or slip_stress"),
        (lambda: Contact("bottom", slip_stress=float("inf")), "slip_stress must be a number >= 0"),
    ],
)
def test_bad_contact(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_frames_at_45_degrees_do_not_depend_on_rounding():
    """Two axes at equal angles to the normal: a normal rounded in a file must give the same tangents."""
    n = np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0) + 1e-16 * np.random.default_rng(0).integers(-3, 4, (40, 3))
    frames = tangent_frames(n)
    assert np.abs(frames - frames[0]).max() < 1e-14


def test_a_surface_is_computed_once_per_position_of_its_foundation():
    """A load step with the foundation and the gaps where they were has the same surface; with others it has its own."""
    factor = {0.0: 0.0, 1.0: 0.0, 2.0: 0.0, 3.0: 1.0}
    contact = coulomb.Contact(
        "bottom", 0.3, motion=lambda t: (0.0, 0.0, 1e-3 * (t == 1.0)), gap=1e-4, gap_amplitude=lambda t: factor[t]
    )
    problem = coulomb.ContactProblem(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)), STEEL, [coulomb.Clamp("top")], contact)
    surfaces = [problem.body.state(time).surface for time in (0.0, 1.0, 2.0, 2.0, 3.0)]
    at_rest, moved, back, again, wider = surfaces
    assert at_rest is problem.surface and again is back
    gaps = [np.unique(np.round(surface.gap, 12)).tolist() for surface in (at_rest, moved, back, wider)]
    assert gaps == [[0.0], [-1e-3], [0.0], [1e-4]]


def test_a_block_far_away_is_solved_in_the_same_steps():
    """Rounding of normals leaves entries in rows of B along held directions that are no freedom: 14 steps for 9."""
    turn = Rotation.from_rotvec([0.3, 0.7, -0.4]).as_matrix()
    steps = []
    for distance in (0.0, 100.0, 1e4):
        far = distance * np.array([[1.0], [2.0], [-1.0]])
        mesh = coulomb.box((1.0, 1.0, 0.5), (4, 4, 2), place=lambda x, far=far: turn @ x + far)
        supports = [coulomb.SymmetryPlane("left"), coulomb.SymmetryPlane("front")]
        load = coulomb.Traction("top", tuple(turn @ np.array([1e6, 2e6, -2e7])))
        answer = coulomb.ContactProblem(mesh, STEEL, supports, Contact("bottom", friction=0.3), [load]).solve()
        assert answer.valid
        steps.append(answer.result.newton_steps)
    assert steps == [steps[0]] * 3
