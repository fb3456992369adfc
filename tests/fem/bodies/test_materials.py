"""Orthotropic materials: constants, rotation, positive energy, bodies of several kinds."""

import numpy as np
import pytest

import coulomb
from coulomb import Clamp, Elasticity, Material, OrthotropicMaterial
from coulomb.fem.bodies import locking_by_volume
from coulomb.fem.bodies.materials import (
    PAIRS,
    UPPER,
    along_directions,
    perpendicular,
    stiffness,
    symmetric,
    thermal_strain,
)

PLY = OrthotropicMaterial((1.3e11, 1.1e10, 9e9), (0.28, 0.3, 0.4), (5e9, 4.5e9, 3.5e9))


def rotations(count):
    q = np.linalg.qr(np.random.default_rng(5).normal(size=(count, 3, 3)))[0]
    return q * np.linalg.det(q)[:, None, None]


def constants(count, material=PLY):
    return tuple(np.tile(values, (count, 1)) for values in (material.young, material.poisson, material.shear))


def test_stiffness_in_space_is_the_rotated_tensor():
    """All 81 components, rotated index by index."""
    R, given = rotations(4), constants(4)
    C = along_directions(*given)
    number = {(i, j): k for k, pair in enumerate(PAIRS) for i, j in (pair, pair[::-1])}
    tensor = np.array(
        [[[[C[0][number[i, j], number[k, m]] for m in range(3)] for k in range(3)] for j in range(3)] for i in range(3)]
    )
    found = stiffness(*given, R)
    for rotation, values in zip(R, found, strict=True):
        rotated = np.einsum("abcd,ai,bj,ck,dm->ijkm", tensor, *[rotation] * 4)
        expected = [rotated[(*PAIRS[i], *PAIRS[j])] for i, j in UPPER]
        assert values == pytest.approx(expected, abs=1e-13 * C.max())


def test_compliance_is_that_of_the_definition():
    """Extension along 1 contracts 2 by nu12; the shear moduli belong to 12, 13, 23."""
    C = along_directions(*constants(1))[0]
    strain = np.linalg.solve(C, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert strain[:3] * PLY.young[0] == pytest.approx([1.0, -PLY.poisson[0], -PLY.poisson[1]])
    assert np.linalg.solve(C, [0.0, 1.0, 0.0, 0.0, 0.0, 0.0])[2] * PLY.young[1] == pytest.approx(-PLY.poisson[2])
    assert np.diag(C)[3:] == pytest.approx(PLY.shear[::-1])


def test_thermal_strain_gives_no_stress_beyond_its_own():
    R, given = rotations(2), constants(2)
    strain = thermal_strain(np.tile([-1e-6, 3e-5, 2e-5], (2, 1)), R)
    tensor = R[1].T @ np.diag([-1e-6, 3e-5, 2e-5]) @ R[1]
    doubled = [tensor[i, j] * (1 if i == j else 2) for i, j in PAIRS]
    assert strain[1] == pytest.approx(doubled, abs=1e-20)
    whole = np.zeros((6, 6))
    for k, (i, j) in enumerate(UPPER):
        whole[i, j] = whole[j, i] = stiffness(*given, R)[1][k]
    assert (symmetric(stiffness(*given, R)) @ strain[:, :, None])[1, :, 0] == pytest.approx(whole @ doubled)


def test_directions_are_made_perpendicular():
    d1, d2, d3 = perpendicular(np.array([[2.0, 0.0, 0.0]]), np.array([[5.0, 0.0, -3.0]]))[0]
    assert np.allclose([d1, d2, d3], [[1, 0, 0], [0, 0, -1], [0, 1, 0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"poisson": (3.5, 0.3, 0.4)}, r"nu12 = 3\.5 .* below sqrt\(E1/E2\) = 3\.438"),
        ({"poisson": (0.28, 0.3, -1.2)}, r"nu23 = -1\.2 .* below sqrt\(E2/E3\)"),
        ({"young": (1e9, 1e9, 1e9), "poisson": (0.6, 0.6, 0.6)}, r"1 - nu12 nu21 .* must be positive, but is -0\.5"),
        ({"young": (1e9, -1e9, 1e9)}, "young must be three positive Young's moduli"),
        ({"shear": (1e9, 1e9)}, "shear must be three finite shear moduli"),
        ({"directions": ((0, 0, 0), (1, 0, 0))}, "the two directions must not be zero"),
        ({"directions": (1, 0, 0)}, "directions must be two"),
        ({"expansion": (1e-5, 1e-5)}, "expansion must be a finite number in 1/K, or three"),
    ],
)
def test_wrong_constants(changes, message):
    given = {"young": PLY.young, "poisson": PLY.poisson, "shear": PLY.shear, **changes}
    with pytest.raises(ValueError, match=message):
        OrthotropicMaterial(**given)


@pytest.mark.parametrize(
    ("cells", "winding", "at"),
    [
        ((2, 2, 2), lambda x: np.array([x[1] - 0.25, 0 * x[0], 0 * x[0]]), r"0\.25, 0\.25, 0\.25"),
        # on the axis of a wound shaft, where it is a rounding error
        ((3, 3, 1), lambda x: np.array([0.5 - x[1], x[0] - 0.5, 0 * x[0]]), r"0\.5, 0\.5, 0\.5"),
    ],
)
def test_directions_that_are_zero_somewhere(cells, winding, at):
    wound = OrthotropicMaterial(PLY.young, PLY.poisson, PLY.shear, (winding, (0.0, 0.0, 1.0)))
    with pytest.raises(ValueError, match=rf"directions must not be zero, but are at x = {at}"):
        Elasticity(coulomb.box((1.0, 1.0, 1.0), cells), wound, [Clamp("top")])


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_equal_constants_in_all_directions_are_an_isotropic_body(cell, degree):
    """Half of it given as orthotropic: the same matrix, internal forces, thermal forces and stress."""
    mesh = coulomb.box((1.0, 0.7, 0.5), (2, 2, 2), cell, degree=degree)
    steel = Material(2e11, 0.3, 7800.0, 1.2e-5)
    G = steel.young / (2 * (1 + steel.poisson))
    alike = OrthotropicMaterial((2e11,) * 3, (0.3,) * 3, (G,) * 3, ((1, 2, 3), (0, 1, 1)), 7800.0, 1.2e-5)
    half = np.arange(mesh.domain.topology.index_map(3).size_local, dtype=np.int32)
    groups = {"one": half[::2], "other": half[1::2]}
    mixed = coulomb.NamedMesh(mesh.domain, mesh.faces, groups)
    heat = coulomb.fem.bodies.loads.ThermalLoad(lambda x: 50 * x[0] + 3, 1.0)
    bodies = [
        Elasticity(mixed, materials, [Clamp("left")], gravity=(0, 0, -9.81), thermal=heat)
        for materials in (steel, {"one": steel, "other": alike})
    ]
    one, other = bodies
    assert (one.K - other.K).norm() <= 1e-13 * one.K.norm()
    u = np.random.default_rng(1).normal(size=one.x.shape)
    assert other.internal_force(u) == pytest.approx(
        one.internal_force(u), abs=1e-12 * np.abs(one.internal_force(u)).max()
    )
    loads = [body.at(0.0) for body in bodies]
    assert loads[1].load == pytest.approx(loads[0].load, abs=1e-12 * np.abs(loads[0].load).max())
    assert loads[1].temperature.displacement == pytest.approx(loads[0].temperature.displacement)
    stress = [body.cell_fields(body.function(1e-4 * u), loads[0])[0].x.array for body in bodies]
    assert stress[1] == pytest.approx(stress[0], rel=1e-10)


@pytest.mark.parametrize(
    ("degree", "cell", "warnings"), [(1, "tetrahedron", 1), (1, "hexahedron", 0), (2, "tetrahedron", 0)]
)
@pytest.mark.parametrize("kinematics", ["small", "large"])
def test_locking_is_of_first_order_tetrahedra(caplog, kinematics, degree, cell, warnings):
    """Also in large motions, whatever the law is given by; the message is logged and in the summary."""
    rubber = Material(1e6, 0.46) if kinematics == "small" else coulomb.MooneyRivlin(1.6e5, 0.0, 1.6e7)
    mesh, held = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), cell, degree=degree), [coulomb.Clamp("top")]
    problem = coulomb.ContactProblem(mesh, rubber, held, coulomb.Contact("bottom", 0.3), kinematics=kinematics)
    texts = locking_by_volume(problem.elasticity)
    assert len(texts) == warnings and all("the first-order elements lock" in text for text in texts)
    assert [record.getMessage() for record in caplog.records if "lock" in record.getMessage()] == texts
