"""Slices of meshes in 2D: volumes and areas, what is refused, and plane and axisymmetric bodies against formulas."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import ufl
from mesh_files import integral
from mpi4py import MPI
from sections import rectangle, write

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Cylinder,
    Material,
    Plane,
    PrescribedDisplacement,
    Pressure,
    Rotation,
    SymmetryPlane,
    TotalForce,
)
from coulomb.fem import compat
from coulomb.fem.compat import mesh as dolfinx_mesh
from coulomb.io import output

E, NU = 2.0e11, 0.3
STEEL = Material(E, NU)


def sliced(tmp_path, section, kind, *others):
    return coulomb.slice(write(tmp_path / "section.msh", section), kind, *others)


@pytest.mark.parametrize("nodes", [3, 4, 6, 8, 9])
def test_a_ring_has_its_volume_and_areas(tmp_path, nodes):
    mesh = sliced(tmp_path, rectangle((1.0, 0.0), (2.0, 0.5), (2, 1), nodes), "axisymmetric")
    copies, cells = mesh.slice.copies, mesh.domain.topology.index_map(3).size_local
    assert cells == (12 if nodes in (3, 6) else 2) and mesh.degree == (1 if nodes < 6 else 2)
    assert integral(mesh) * copies == pytest.approx(np.pi * 3.0 * 0.5, rel=1e-9)
    assert integral(mesh, "top") * copies == pytest.approx(np.pi * 3.0, rel=1e-9)
    off = 1.0 / np.cos(np.radians(0.5)) if nodes < 6 else 1.0
    assert integral(mesh, "right") * copies == pytest.approx(off * np.pi * 4.0 * 0.5, rel=1e-9)
    assert set(mesh.faces) == {"left", "right", "bottom", "top", "front", "back"}


@pytest.mark.parametrize("nodes", [3, 4, 6, 9])
def test_cells_that_are_given_clockwise_are_turned(tmp_path, nodes):
    section = rectangle((0.0, 0.0), (2.0, 1.0), (2, 1), nodes)
    upside_down = replace(section, points=section.points * [1.0, -1.0])
    mesh = sliced(tmp_path, upside_down, "plane strain", 0.25)
    assert integral(mesh) == pytest.approx(0.5, rel=1e-12)
    assert integral(mesh, "top") == pytest.approx(0.5, rel=1e-12)


def test_triangles_beside_quadrilaterals(tmp_path):
    """Both are halved along their edges, so that they share the nodes there."""
    section = rectangle((0.0, 0.0), (2.0, 1.0), (2, 1))
    first, second = section.cells[4]
    mixed = {4: first[None], 3: np.array([second[[0, 1, 2]], second[[0, 2, 3]]])}
    mesh = sliced(tmp_path, replace(section, cells=mixed), "plane stress")
    assert mesh.domain.topology.index_map(3).size_local == 4 + 2 * 3
    assert mesh.components == 1 and integral(mesh) == pytest.approx(2.0, rel=1e-12)


def test_first_order_sections_raised_to_second_order(tmp_path):
    mesh = coulomb.slice(
        write(tmp_path / "s.msh", rectangle((1.0, 0.0), (2.0, 0.5), (1, 1), 3)), "axisymmetric", degree=2
    )
    assert mesh.degree == 2 and integral(mesh) * mesh.slice.copies == pytest.approx(np.pi * 1.5, rel=1e-9)


SQUARE = rectangle((0.0, 0.0), (1.0, 1.0), (1, 1))


@pytest.mark.parametrize(
    ("section", "arguments", "words"),
    [
        (SQUARE, ("plane",), "slice must be one of 'plane strain'"),
        (SQUARE, ("axisymmetric", 2.0), "its forces are for 360 degrees"),
        (SQUARE, ("plane strain", -1.0), "thickness must be a positive number"),
        (replace(SQUARE, points=SQUARE.points - [0.5, 0.0]), ("axisymmetric",), "radii x >= 0"),
        (replace(SQUARE, line_groups={"front": SQUARE.line_groups["top"]}), ("plane strain",), "rename 'front'"),
        (replace(SQUARE, cells={}), ("plane strain",), "has no triangles or quadrilaterals"),
        (replace(SQUARE, points=SQUARE.points * [1.0, 0.0]), ("plane strain",), "not convex, or has no area"),
    ],
)
def test_what_is_no_section_is_refused(tmp_path, section, arguments, words):
    with pytest.raises(ValueError, match=words):
        sliced(tmp_path, section, *arguments)


@pytest.mark.parametrize("nodes", [3, 8])
@pytest.mark.parametrize(
    ("kind", "modulus"),
    [("plane strain", E / (1 - NU**2)), ("generalised plane strain", E), ("plane stress", E), ("axisymmetric", E)],
)
def test_a_block_under_a_total_force(tmp_path, kind, modulus, nodes):
    """Uniform stress: exact with any cells, per thickness or on 360 degrees, on the axis, too."""
    axisymmetric = kind == "axisymmetric"
    section = rectangle((0.0, 0.0), (1.0, 2.0), (2, 3), nodes)
    mesh = sliced(tmp_path, section, kind, *([] if axisymmetric else [0.5]))
    area = np.pi if axisymmetric else 0.5
    problem = ContactProblem(
        mesh,
        STEEL,
        [] if axisymmetric else [SymmetryPlane("left")],
        Contact("bottom", friction=0.0, foundation=Plane((0, 0, 0), (0, 1, 0))),
        [TotalForce("top", (0.0, -1e6, 0.0))],
    )
    answer = problem.solve()
    assert answer.valid
    assert answer.forces["normal_force"] == pytest.approx(1e6, rel=1e-7)
    assert answer.forces["contact_area"] == pytest.approx(area, rel=1e-5)
    assert answer.at_nodes.pressure == pytest.approx(1e6 / area, rel=1e-5)
    top = problem.elasticity.x[:, 1] > 1.999
    assert answer.displacement[top, 1] == pytest.approx(-2e6 / area / modulus, rel=1e-5)
    assert answer.loads[0].force == pytest.approx([0.0, -1e6, 0.0], abs=1e-3)


def test_a_ring_under_inner_pressure_in_a_rigid_bore(tmp_path):
    """Lame: u = A r + B/r."""
    a, b, p = 1.0, 2.0, 1e7
    lame, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    A, B = np.linalg.solve([[b, 1 / b], [2 * (lame + mu), -2 * mu / a**2]], [0.0, -p])
    pressure = 2 * mu * B / b**2 - 2 * (lame + mu) * A
    mesh = sliced(tmp_path, rectangle((a, 0.0), (b, 0.2), (8, 1), 9), "axisymmetric")
    bore = Contact("right", friction=0.0, foundation=Cylinder((0, 0, 0), (0, 1, 0), b, True))
    held = [SymmetryPlane("bottom"), SymmetryPlane("top")]
    answer = ContactProblem(mesh, STEEL, held, bore, [Pressure("left", p)]).solve()
    assert answer.valid and answer.at_nodes.pressure == pytest.approx(pressure, rel=5e-5)
    assert answer.forces["normal_force"] == pytest.approx(pressure * 2 * np.pi * b * 0.2, rel=5e-6)


def test_files_of_a_ring_agree_with_its_totals(tmp_path):
    """Nodal forces in the files are those of the layer, totals those of 360 degrees."""
    mesh = sliced(tmp_path, rectangle((1.0, 0.0), (2.0, 1.0), (2, 2)), "axisymmetric")
    floor = Contact("bottom", friction=0.3, foundation=Plane((0, 0, 0), (0, 1, 0)))
    answer = ContactProblem(mesh, STEEL, [], floor, [TotalForce("top", (0.0, -1e6, 0.0))]).solve()
    output.write(answer, tmp_path / "run")
    assert coulomb.check(tmp_path / "run").passed
    for name in ("solution.xdmf", "contact.xdmf"):
        assert (
            f"{mesh.slice.copies:.15g} of these make the totals, for 360 degrees"
            in (tmp_path / "run" / name).read_text()
        )
    assert -answer.force_on_body[:, 1].sum() * mesh.slice.copies == pytest.approx(-1e6, rel=1e-7)


def test_bodies_are_slices_of_one_kind(tmp_path):
    mesh = sliced(tmp_path, SQUARE, "plane strain")
    both = coulomb.join(flat=mesh, solid=coulomb.moved(coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), (0.0, 2.0, 0.0)))
    with pytest.raises(ValueError, match=r"several kinds .*in 3D; plane strain"):
        ContactProblem(both, STEEL, [Clamp("solid:top")], Contact("flat:top", 0.0, against="solid:front"))


def test_med_files(tmp_path):
    section = rectangle((1.0, 0.0), (2.0, 0.5), (2, 1), 3)
    names = list(section.line_groups)
    lines = np.vstack(list(section.line_groups.values()))
    tags = np.repeat([-2, -3, -4, -5], [len(one) for one in section.line_groups.values()])
    blocks, cell_tags = [("triangle", section.cells[3]), ("line", lines)], [np.full(len(section.cells[3]), -1), tags]
    made = meshio.Mesh(section.points, blocks, cell_data={"cell_tags": cell_tags})
    made.cell_tags = {-1: ["body"], **{-2 - k: [name] for k, name in enumerate(names)}}
    made.point_tags = {}
    meshio.med.write(tmp_path / "section.med", made)
    mesh = coulomb.slice(tmp_path / "section.med", "axisymmetric")
    assert integral(mesh) * mesh.slice.copies == pytest.approx(1.5 * np.pi, rel=1e-9)
    assert integral(mesh, "top") * mesh.slice.copies == pytest.approx(3.0 * np.pi, rel=1e-9)
    assert list(mesh.cells) == ["body"]


def test_files_with_numbers(tmp_path):
    """XDMF with points in 2D, as DOLFINx writes it, and formats of meshio: lines and cells are called by numbers, or by
    names with these."""
    section = rectangle((1.0, 0.0), (2.0, 0.5), (2, 1), 4)
    lines, cells = np.vstack([*section.line_groups.values()]), section.cells[4]
    tags = np.repeat([2, 3, 4, 5], [len(one) for one in section.line_groups.values()])
    points = np.column_stack([section.points, np.zeros(len(section.points))])
    of_cells = np.full(len(cells), 1)
    for end in ("vtu", "mesh"):
        data = {"medit:ref" if end == "mesh" else "tag": [of_cells, tags]}
        meshio.Mesh(points, [("quad", cells), ("line", lines)], cell_data=data).write(tmp_path / f"section.{end}")

    def item(tag, values, more=""):
        values, kind = np.asarray(values), "Float" if np.asarray(values).dtype.kind == "f" else "Int"
        size, text = " ".join(map(str, values.shape)), " ".join(map(str, values.ravel().tolist()))
        return f'<{tag} {more}><DataItem Format="XML" NumberType="{kind}" Dimensions="{size}">{text}</DataItem></{tag}>'

    grids = [
        item("Topology", rows, f'TopologyType="{kind}"')
        + item("Geometry", section.points)
        + item("Attribute", numbers, 'Name="n" Center="Cell"')
        for kind, rows, numbers in (("Quadrilateral", cells, of_cells), ("PolyLine", lines, tags))
    ]
    text = "".join(f"<Grid>{grid}</Grid>" for grid in grids)
    (tmp_path / "section.xdmf").write_text(f"<Xdmf><Domain>{text}</Domain></Xdmf>")
    for end in ("vtu", "mesh", "xdmf"):
        named = {"names": {"lid": 5}, "cell_names": {"body": 1}}
        mesh = coulomb.slice(tmp_path / f"section.{end}", "axisymmetric", **named)
        assert set(mesh.faces) == {"2", "3", "4", "lid", "front", "back"} and list(mesh.cells) == ["body"]
        assert integral(mesh, "lid") * mesh.slice.copies == pytest.approx(3.0 * np.pi, rel=1e-9)
        with pytest.raises(ValueError, match=r"names has 'seat' = 9, but the numbers there are 2, 3, 4, 5"):
            coulomb.slice(tmp_path / f"section.{end}", "axisymmetric", names={"seat": 9})


@pytest.mark.parametrize(("nodes", "face", "against"), [(4, "bottom", "top"), (9, "bottom", "top"), (4, "all", "all")])
def test_two_bodies_meet_on_the_axis(tmp_path, nodes, face, against):
    """Second-order nodes on the axis have no area: they are no contact points, and bear nothing.  Of whole boundaries
    the sides of the upper body are parallel to the lower one's facets: lines along their normals meet none of them."""
    sections = rectangle((0.0, 0.0), (1.0, 1.0), (4, 2), nodes), rectangle((0.0, 1.0), (1.0, 2.0), (3, 2), nodes)
    lower, upper = (
        sliced(
            tmp_path,
            replace(one, line_groups=one.line_groups | {"all": np.vstack([*one.line_groups.values()])}),
            "axisymmetric",
        )
        for one in sections
    )
    answer = ContactProblem(
        coulomb.join(lower=lower, upper=upper),
        STEEL,
        [PrescribedDisplacement("lower:bottom", (0.0, 0.0, 0.0), components="y")],
        Contact(f"upper:{face}", 0.0, against=f"lower:{against}"),
        [TotalForce("upper:top", (0.0, -1e6, 0.0))],
    ).solve()
    assert answer.valid
    assert answer.at_nodes.pressure == pytest.approx(1e6 / np.pi, rel=2e-4)
    assert answer.forces["normal_force"] == pytest.approx(1e6, rel=1e-7)


def test_own_meshes_and_forms_in_2d_are_refused_with_what_to_do():
    section = dolfinx_mesh.create_rectangle(
        MPI.COMM_WORLD, [[0.0, 0.0], [1.0, 1.0]], [1, 1], dolfinx_mesh.CellType.quadrilateral
    )
    with pytest.raises(ValueError, match=r"of dimension 2, not 3: .*coulomb\.slice"):
        coulomb.NamedMesh(section)
    V = compat.functionspace(section, 1, (2,))
    form = ufl.inner(ufl.TrialFunction(V), ufl.TestFunction(V)) * ufl.dx
    with pytest.raises(ValueError, match=r'sliced = coulomb\.slice\(domain, "plane strain"'):
        coulomb.Body(form)


def test_slices_stay_in_their_plane_and_on_their_axis(tmp_path):
    flat, ring = (sliced(tmp_path, SQUARE, kind) for kind in ("plane strain", "axisymmetric"))
    turned = coulomb.moved(flat, (1.0, 2.0, 0.0), Rotation((0, 0, 0), (0, 0, 1), 0.5))
    assert turned.slice == flat.slice and coulomb.moved(ring, (0.0, 1.0, 0.0)).slice == ring.slice
    for mesh, way in ((flat, (0.0, 0.0, 1.0)), (ring, (1.0, 0.0, 0.0))):
        with pytest.raises(ValueError, match="slice can be moved along"):
            coulomb.moved(mesh, way)
    with pytest.raises(ValueError, match="rotated about axes along z"):
        coulomb.moved(flat, rotate=Rotation((0, 0, 0), (1, 0, 0), 0.5))
