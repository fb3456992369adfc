"""Equations of decks with reference nodes, in frames of their own, and couplings of some directions."""

import numpy as np
import pytest
from test_deck_tables import CUBES, STEP, tables_of

from coulomb.case.case import read_case
from coulomb.decks.equations import _reduce

REFERENCE = CUBES.replace("*ELEMENT", "101, .5, .5, 2\n*ELEMENT", 1)
TIED = "".join(f"*EQUATION\n2\n{node}, 3, 1., 101, 3, -1.\n" for node in (15, 16, 17, 18))
"""The lid goes down with the reference node."""


def displacement(tmp_path, text):
    tables = tables_of(tmp_path, text).tables
    problem = read_case(tmp_path / "deck.inp").problem()
    solution = problem.solve()
    return tables, problem.body.elasticity.x, solution.displacement, solution.at_nodes.totals()


def test_a_reference_node_with_a_force(tmp_path):
    """It goes with an equation, and its force goes to the node of that; the mean of four nodes, and a lid."""
    tables, x, u, totals = displacement(tmp_path, REFERENCE + TIED + STEP.format("*CLOAD\n101, 3, -8."))
    assert tables["nodal_force"] == [{"nodes": [15], "force": [0.0, 0.0, -8.0]}]
    assert totals["force"][2] == pytest.approx(8.0) and np.ptp(u[x[:, 2] == 2.0, 2]) < 1e-12
    mean = "*EQUATION\n5\n15, 3, 1., 16, 3, 1., 17, 3, 1., 18, 3, 1.\n101, 3, -4.\n"
    tables, _, _, _ = displacement(tmp_path, REFERENCE + mean + STEP.format("*CLOAD\n101, 3, -8."))
    assert "equation" not in tables
    assert {tuple(one["force"]) for one in tables["nodal_force"]} == {(0.0, 0.0, -2.0)}
    with pytest.raises(ValueError, match=r"deck.inp: line \d+: .*no equation says where node 101 is"):
        tables_of(tmp_path, REFERENCE + TIED + STEP.format("*CLOAD\n101, 1, -8."))


def test_a_reference_node_that_is_moved(tmp_path):
    """A constant of every equation, in the course of time, too."""
    moved = REFERENCE + TIED + STEP.format("*BOUNDARY\n101, 3, 3, -.001")
    tables, x, u, _ = displacement(tmp_path, moved)
    assert tables["equation"][0]["constant"] == -0.001 and np.allclose(u[x[:, 2] == 2.0, 2], -0.001)
    tables = tables_of(tmp_path, moved + STEP.format("*BOUNDARY\n101, 3, 3, -.003")).tables
    assert tables["equation"][0]["constant"] == -0.003
    assert np.allclose(tables["equation"][0]["amplitude"], [[0.0, 0.0], [1.0, 1.0 / 3.0], [2.0, 1.0]])


def test_reference_nodes_that_are_moved_one_after_the_other(tmp_path):
    """The constant of an equation follows both; it was refused."""
    both = REFERENCE.replace("101, .5, .5, 2", "101, .5, .5, 2\n102, .5, .5, 3")
    both += "".join(f"*EQUATION\n3\n{node}, 3, 1., 101, 3, -1., 102, 3, -2.\n" for node in (15, 16, 17, 18))
    steps = ("*BOUNDARY\n101, 3, 3, -.001\n102, 3, 3, 0.", "*BOUNDARY\n102, 3, 3, -.001")
    (equation,) = displacement(tmp_path, both + "".join(map(STEP.format, steps)))[0]["equation"]
    assert equation["constant"] == -0.003
    assert np.allclose(equation["amplitude"], [[0.0, 0.0], [1.0, 1.0 / 3.0], [2.0, 1.0]])


def test_equations_in_frames_of_their_own(tmp_path):
    """Degrees of freedom along axes that are turned by 45 degrees: x' = (x + y) / sqrt(2)."""
    frame = "*NSET, NSET=two\n15, 16\n*TRANSFORM, NSET=two, TYPE=R\n1., 1., 0., -1., 1., 0.\n"
    equation = "*EQUATION\n2\n16, 1, 2., 17, 1, -1.\n"
    tables = tables_of(
        tmp_path, CUBES.replace("top, 1, 2\n", "") + frame + equation + STEP.format("*CLOAD\ntop, 3, -1.")
    )
    terms = tables.tables["equation"][0]["terms"]
    assert [(one["nodes"], one["component"]) for one in terms] == [([16], "x"), ([16], "y"), ([17], "x")]
    assert np.allclose([one["coefficient"] for one in terms], [np.sqrt(2.0), np.sqrt(2.0), -1.0])


def test_a_coupling_of_one_direction(tmp_path):
    """A lid that is held along x and y tilts alike, whether its coupling leaves these free or not."""
    of = "*SURFACE, NAME=lid\n2, S2\n*COUPLING, REF NODE=101, SURFACE=lid, CONSTRAINT NAME=c\n*KINEMATIC\n{}\n"
    load = STEP.format("*CLOAD\n101, 3, -10.\n101, 4, .5\n101, 5, .25")
    one = displacement(tmp_path, REFERENCE + of.format("3, 3") + load)
    free = REFERENCE.replace("top, 1, 2\n", "")
    both = displacement(
        tmp_path, free + of.format("1, 3") + load.replace("*CLOAD", "*BOUNDARY\n101, 1, 2\n101, 6, 6\n*CLOAD")
    )
    assert np.allclose(one[2], both[2], rtol=0.0, atol=1e-6 * np.abs(one[2]).max())
    assert np.ptp(one[2][one[1][:, 2] == 2.0, 2]) > 0.1 * np.abs(one[2]).max()
    turned = REFERENCE + of.format("3, 3") + STEP.format("*BOUNDARY\n101, 5, 5, .3")
    assert abs(tables_of(tmp_path, turned).tables["equation"][0]["constant"]) == pytest.approx(0.3)
    with pytest.raises(ValueError, match=r"deck.inp: line \d+: .*node 101 turns by 0.3 rad with NLGEOM"):
        tables_of(tmp_path, turned.replace("*STEP", "*STEP, NLGEOM"))


def of_tetrahedra():
    """The cubes of `REFERENCE` as ten-node tetrahedra, without supports of the top, and their sides at z = 2."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
    nodes, elements = dict[tuple[float, ...], int](), list[str]()
    surfaces = {"master": "", "slave": "", "lid": ""}
    for lower in (0, 1):
        for path in ((1, 2), (3, 2), (1, 5), (4, 5), (3, 7), (4, 7)):
            x = corners[[0, *path, 6]] + np.array([0.0, 0.0, lower])
            x = x if np.linalg.det(x[1:] - x[0]) > 0.0 else x[[0, 2, 1, 3]]
            middles = [0.5 * (x[i] + x[j]) for i, j in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))]
            name = len(elements) + 1
            own = [str(nodes.setdefault((lower, *one), 1000 + len(nodes))) for one in (*x, *middles)]
            elements.append(f"{name}, {', '.join(own)}\n")
            for side, at in enumerate(((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)), 1):
                for surface, z in (("master", 1.0), ("slave", 1.0), ("lid", 2.0)):
                    if np.all(x[list(at), 2] == z) and lower == (surface != "master"):
                        surfaces[surface] += f"{name}, S{side}\n"
    lines = "".join(f"{number}, {', '.join(map(str, x))}\n" for (_, *x), number in nodes.items())
    base, top = ("\n".join(str(number) for x, number in nodes.items() if x[3] == z) for z in (0.0, 2.0))
    rest = CUBES[CUBES.index("*MATERIAL") :].replace("top, 1, 2\n", "")
    return (
        f"*NODE\n{lines}101, .5, .5, 2\n*ELEMENT, TYPE=C3D10, ELSET=cubes\n{''.join(elements)}"
        f"*NSET, NSET=base\n{base}\n*NSET, NSET=lid\n{top}\n"
        + "".join(f"*SURFACE, NAME={name}\n{sides}" for name, sides in surfaces.items())
        + rest
    )


def test_a_coupling_of_some_directions_of_ten_node_tetrahedra(tmp_path):
    """Nodes in the middles of edges follow as well: as a rigid lid, of which the reference node is held along y."""
    of = "*COUPLING, REF NODE=101, SURFACE=lid, CONSTRAINT NAME=c\n*KINEMATIC\n{}\n"
    load = STEP.format("*BOUNDARY\n101, 6, 6\n{}*CLOAD\n101, 3, -10.\n101, 1, .5")
    deck = of_tetrahedra() + "*BOUNDARY\nlid, 2, 2\n" + of
    some = displacement(tmp_path, deck.format("1, 1\n3, 3") + load.format(""))
    whole = displacement(tmp_path, deck.format("1, 3") + load.format("101, 2, 2\n"))
    top = some[1][:, 2] == 2.0
    assert np.count_nonzero(top) == 9 and np.ptp(some[2][top, 2]) > 1e-6
    assert np.allclose(some[2], whole[2], rtol=0.0, atol=1e-6 * np.abs(whole[2]).max())


def test_equations_of_a_slice(tmp_path):
    """Nodes of all its layers follow: a lid that goes down as a whole, and a spring, which is that of one node."""
    nodes = "1, 1, 0\n2, 2, 0\n3, 2, 1\n4, 1, 1\n11, 1, 1\n12, 2, 1\n13, 2, 2\n14, 1, 2\n"
    deck = (
        f"*NODE\n{nodes}*ELEMENT, TYPE=CPE4, ELSET=all\n1, 1, 2, 3, 4\n2, 11, 12, 13, 14\n*NSET, NSET=base\n1, 2\n"
        "*SURFACE, NAME=m\n1, S3\n*SURFACE, NAME=s\n2, S1\n*MATERIAL, NAME=e\n*ELASTIC\n1000., 0.\n"
        "*SOLID SECTION, ELSET=all, MATERIAL=e\n.5\n*BOUNDARY\nbase, 1, 2\n13, 1\n14, 1\n"
        "*CONTACT PAIR, INTERACTION=i, TYPE=SURFACE TO SURFACE\ns, m\n*SURFACE INTERACTION, NAME=i\n"
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD\n*EQUATION\n2\n14, 2, 1., 13, 2, -1.\n"
    )
    _, x, u, totals = displacement(tmp_path, deck + STEP.format("*CLOAD\n13, 2, -10."))
    assert np.allclose(u[x[:, 1] == 2.0, 1], -10.0 * 2.0 / (0.5 * 1000.0), rtol=1e-9)
    assert totals["force"][1] == pytest.approx(10.0)
    spring = "*ELEMENT, TYPE=SPRING2, ELSET=k\n50, 13, 1\n*SPRING, ELSET=k\n2, 2\n250.\n"  # beside one of 250 N/m
    _, x, u, totals = displacement(tmp_path, deck + spring + STEP.format("*CLOAD\n13, 2, -10."))
    assert np.allclose(u[x[:, 1] == 2.0, 1], -0.02, rtol=1e-9) and totals["force"][1] == pytest.approx(5.0)


def test_a_reference_node_with_a_frame_of_its_own(tmp_path):
    """Its first degree of freedom is that of its *TRANSFORM in equations, supports and loads alike: the lid moves along
    x with it (CalculiX 2.20: by the same); that of a face has none."""
    frame = "*NSET, NSET=ref\n101\n*TRANSFORM, NSET=ref\n1., 1., 0., -1., 1., 0.\n"
    free = REFERENCE.replace("top, 1, 2\n", "")
    lid = "".join(f"*EQUATION\n2\n{node}, {k}, 1., 101, {k}, -1.\n" for node in (15, 16, 17, 18) for k in (1, 2, 3))
    moved = "*CLOAD\ntop, 3, -10.\n*BOUNDARY\n101, 1, 1, 1e-5\n101, 2, 2"
    _, x, u, _ = displacement(tmp_path, free + lid + frame + STEP.format(moved))
    assert np.allclose(u[x[:, 2] == 2.0, :2], [1e-5, 0.0], atol=1e-14)
    _, _, _, totals = displacement(tmp_path, free + lid + frame + STEP.format("*CLOAD\n101, 3, -10.\n101, 1, 1."))
    assert np.allclose(totals["force"][:2], [-1.0, 0.0], atol=1e-6)
    face = free + "*SURFACE, NAME=lid\n2, S2\n*COUPLING, REF NODE=101, SURFACE=lid, CONSTRAINT NAME=c\n*KINEMATIC\n{}\n"
    for directions, wrong in (("1, 3", "*CLOAD\n101, 3, -1."), ("1, 3", "*BOUNDARY\n101, 1, 2"), ("3, 3", "")):
        with pytest.raises(ValueError, match=r"deck.inp: line \d+: .*node 101 is the reference .* a \*TRANSFORM"):
            tables_of(tmp_path, face.format(directions) + frame + STEP.format(wrong))
    held = tables_of(tmp_path, face.format("1, 3") + frame + STEP.format("*BOUNDARY\n101, 1, 6")).tables
    assert held["rigid_face"][0]["translation"] == {"x": 0.0, "y": 0.0, "z": 0.0}


def test_a_reference_node_that_follows_a_mean(tmp_path):
    """CalculiX' *DISTRIBUTING COUPLING: a force is shared by weights; held, the mean stays, and nodes differ."""
    mean = "*ELEMENT, TYPE=DCOUP3D, ELSET=d\n9, 101\n*DISTRIBUTING COUPLING, ELSET=d\n{}\n"
    mean = REFERENCE + mean.format("15, 1.\n16, 1.\n17, 2.\n18, 0.")
    tables, _, _, totals = displacement(tmp_path, mean + STEP.format("*CLOAD\n101, 3, -8."))
    forces = {one["nodes"][0]: one["force"][2] for one in tables["nodal_force"]}
    assert forces == {15: -2.0, 16: -2.0, 17: -4.0} and totals["force"][2] == pytest.approx(8.0)
    moved = STEP.format("*BOUNDARY\n101, 3, 3, -.001\n*CLOAD\n17, 3, -50.")
    _, x, u, _ = displacement(tmp_path, mean + moved)
    lid = {tuple(at[:2]): down for at, down in zip(x, u[:, 2], strict=True) if at[2] == 2.0}
    assert lid[0, 0] + lid[1, 0] + 2.0 * lid[1, 1] == pytest.approx(-0.004) and lid[1, 1] < lid[0, 0]
    for wrong, said in (
        (mean.replace("9, 101", "9, 101\n10, 101"), "should be one element DCOUP3D, but has 2"),
        (mean.replace("17, 2.", "17, -2."), "weights that are not negative, nor all 0"),
        (mean.replace("ELSET=d\n15", "ELSET=e\n15"), "no element set 'e'"),
    ):
        with pytest.raises(ValueError, match=rf"deck.inp: line \d+: \*DISTRIBUTING COUPLING: .*{said}"):
            tables_of(tmp_path, wrong + STEP.format("*CLOAD\n101, 3, -8."))


def test_nodes_that_are_coupled_without_a_surface(tmp_path):
    """Abaqus' *KINEMATIC COUPLING is the coupling of a surface with the same nodes."""
    free, load = REFERENCE.replace("top, 1, 2\n", ""), STEP.format("*CLOAD\n101, 3, -10.\n101, 1, 1.\n101, 5, -.5")
    of_surface = (
        "*SURFACE, NAME=lid\n2, S2\n*COUPLING, REF NODE=101, SURFACE=lid, CONSTRAINT NAME=c\n*KINEMATIC\n1, 3\n"
    )
    right = displacement(tmp_path, free + of_surface + load)
    for lines in ("top, 1, 3", "top", "15, 1, 2\n15, 3\n16, 1, 6\n17, 1, 3\n18, 1, 3"):
        own = displacement(tmp_path, f"{free}*KINEMATIC COUPLING, REF NODE=101\n{lines}\n{load}")
        assert np.allclose(own[2], right[2], rtol=0.0, atol=1e-7 * np.abs(right[2]).max())


def test_the_reference_node_of_a_distributing_coupling_is_moved(tmp_path):
    """Abaqus: by the mean motion of a pressed, pushed and tilted lid, without the loads: all else is as under these."""
    free = REFERENCE.replace("top, 1, 2\n", "").replace("101, .5, .5, 2", "101, .25, .5, 2.5")
    lid = "*SURFACE, NAME=lid\n2, S2\n*COUPLING, REF NODE=101, SURFACE=lid, CONSTRAINT NAME=c\n*DISTRIBUTING\n1, 6\n"
    load = "*CLOAD\n101, 3, -10.\n101, 1, 1.\n101, 6, .02\n101, 5, -4.\n"
    _, x, right, totals = displacement(tmp_path, free + lid + STEP.format(load))
    on = x[:, 2] == 2.0
    r, u = x[on] - [0.5, 0.5, 2.0], right[on]
    inertia = np.sum(r * r) * np.eye(3) - r.T @ r
    theta = np.linalg.solve(inertia, np.cross(r, u).sum(axis=0))
    mean = u.mean(axis=0) + np.cross(theta, [-0.25, 0.0, 0.5])
    held = "".join(f"101, {k}, {k}, {value:.17g}\n" for k, value in enumerate([*mean, *theta], 1))
    for lines, loaded in ((held, ""), (held.replace("101, 5, 5", "base, 5, 5"), "*CLOAD\n101, 5, -4.\n")):
        moved = free + lid + STEP.format(f"*BOUNDARY\n{lines}{loaded}")
        tables, _, own, forces = displacement(tmp_path, moved)
        assert "point_load" not in tables
        assert np.allclose(own, right, rtol=0.0, atol=1e-7 * np.abs(right).max())
        assert np.allclose(forces["force"], totals["force"], rtol=0.0, atol=1e-5)
    line = moved.replace("*SURFACE, NAME=lid\n2, S2", "*SURFACE, NAME=lid, TYPE=NODE\n15\n16")
    with pytest.raises(ValueError, match=r"line \d+: \*COUPLING: nodes on a line have no mean rotation"):
        tables_of(tmp_path, line)


def test_equations_of_the_same_displacements_have_each_one_of_their_own():
    """And no term that is a rounding error, which a case refuses: meshes of several facets had some."""
    a, b, c, held = (1, 1), (2, 1), (3, 1), (9, 1)
    rows = [{a: 1.0, b: 1.0 / 3.0, held: 2.0}, {a: 3.0, b: 1.0 + 2e-16, c: 1.0}]
    _reduce(rows, {held: ((0.0, 1.0),)})
    assert rows == [{a: 1.0, b: 1.0 / 3.0, held: 2.0}, {c: 1.0, held: -6.0}] and next(iter(rows[1])) == c
