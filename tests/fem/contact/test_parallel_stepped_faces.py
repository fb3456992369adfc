"""Masters with steps: what is beyond the edge of one does not count where there is a nearer part."""

import numpy as np
import pytest
from mpi4py import MPI
from sections import write

import coulomb
from coulomb import Clamp, Contact, ContactProblem, PrescribedDisplacement
from coulomb.fem.meshes.mesh_file import SectionFile

MATERIAL = coulomb.Material(2.1e11, 0.3)


def ledge(depth, cells=(20, 2, 4)):
    """A block of 2 x 0.2 x 0.5, lower by a depth where x > 1; "floor" is all of the top, "ledge" what is not lower."""
    domain = coulomb.box((2.0, 0.2, 0.5), cells).domain
    x = domain.geometry.x
    x[np.isclose(x[:, 0], 1.1), 0] = 1.0 + 0.02 * depth  # the step, too steep to be opposite to anything
    x[:, 2] *= np.where(x[:, 0] > 1.0 + 1e-9, 1.0 - depth / 0.5, 1.0)

    def at(places, low):
        return np.isclose(places[2], np.where(places[0] > 1.0 + 1e-9, 0.5 - depth, 0.5)) & (places[0] <= low)

    faces = {"floor": lambda x: at(x, 3.0), "ledge": lambda x: at(x, 1.0 + 1e-9), "base": lambda x: x[2] < 1e-9}
    return coulomb.NamedMesh(domain, faces=faces)


def pressed(against, depth, right, degree=1):
    upper = coulomb.moved(coulomb.box((right - 0.3, 0.2, 0.3), (13, 2, 2)), translate=(0.3, 0.0, 0.5))
    bodies, held = {"upper": upper, "lower": ledge(depth)}, PrescribedDisplacement("upper:top", (0.0, 0.0, -1e-5))
    contact = Contact("upper:bottom", 0.15, against=f"lower:{against}")
    supports = [Clamp("lower:base"), held, coulomb.SymmetryPlane("upper:front"), coulomb.SymmetryPlane("upper:back")]
    return ContactProblem(coulomb.join(**bodies), MATERIAL, supports, contact).solve()


@pytest.mark.parametrize("right", [1.6, 1.57])
@pytest.mark.parametrize("depth", [0.3, 0.02])
def test_a_face_with_a_step_is_touched_as_its_upper_part_alone(right, depth):
    """With nodes of the slave at the edge of the step, and between them."""
    whole, ledge = pressed("floor", depth, right), pressed("ledge", depth, right)
    assert whole.valid and ledge.certificate.passed
    assert whole.forces["normal_force"] == pytest.approx(ledge.forces["normal_force"], rel=1e-7)
    lower = whole.at_nodes.x[:, 0] > 1.0 + 1e-6
    assert MPI.COMM_WORLD.allreduce(np.sum(lower)) > 0
    assert whole.at_nodes.gap == pytest.approx(np.where(lower, depth, 0.0), rel=1e-9, abs=1e-12)


def comb(path, x, y, solid):
    """A section of the rectangles between lines x and y that are solid, (n, m); the faces "up" and "down" are its sides
    towards y and -y, "up2" those with the bottom at the number 2 of y, and so on, and "left", "right" its ends."""
    number = np.arange(len(x) * len(y)).reshape(len(x), len(y))
    cells, lines = [], {"left": [], "right": []}
    for i, j in zip(*np.nonzero(solid), strict=True):
        cells.append([number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]])
        for way, name in ((1, "up"), (-1, "down")):
            if not (0 <= j + way < solid.shape[1] and solid[i, j + way]):
                line = cells[-1][2:] if way == 1 else cells[-1][:2]
                lines.setdefault(name, []).append(line)
                lines.setdefault(f"{name}{j}", []).append(line)
        if i == 0:
            lines["left"].append([cells[-1][0], cells[-1][3]])
        if i == len(solid) - 1:
            lines["right"].append(cells[-1][1:3])
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=2).reshape(-1, 2)
    used = np.unique(cells)
    new = np.full(len(points), -1)
    new[used] = np.arange(len(used))
    named = {name: new[np.array(of)] for name, of in lines.items()}
    if MPI.COMM_WORLD.rank == 0:
        write(path, SectionFile("comb", points[used], {4: new[np.array(cells)]}, {}, named))
    MPI.COMM_WORLD.barrier()
    return path


@pytest.fixture(scope="module")
def combs(tmp_path_factory):
    """The lower one, from the left, has four teeth, each a unit high; the upper one two, on those in the middle."""
    folder = MPI.COMM_WORLD.bcast(tmp_path_factory.mktemp("combs"))
    fine = np.arange(0.0, 8.01, 0.5)
    x = np.concatenate([np.linspace(0.0, 2.0, 5), [2.25, 2.5, 2.75, 3.0]])
    solid = np.ones((len(x) - 1, len(fine) - 1), dtype=bool)
    solid[4:] = np.floor(fine[:-1]) % 2 == 0
    one = comb(folder / "lower.msh", x, fine, solid)
    x = np.concatenate([[2.2, 2.6, 3.0, 3.2], np.linspace(3.7, 5.2, 4)])
    y = np.array([2.9, 3.0, 3.4, 3.9, 5.0, 5.4, 5.9, 6.5])
    solid = np.ones((len(x) - 1, len(y) - 1), dtype=bool)
    solid[:3] = np.isin(np.arange(len(y) - 1), [1, 2, 4, 5])
    return one, comb(folder / "upper.msh", x, y, solid)


@pytest.mark.parametrize("slave", ["lower", "upper"])
@pytest.mark.parametrize("degree", [1, 2])
def test_teeth_touch_those_of_their_grooves_alone(combs, slave, degree):
    """Lines from beyond the tip of a tooth, and from teeth without a groove, meet others through both bodies."""
    bodies = {
        name: coulomb.slice(file, "plane strain", degree=degree)
        for name, file in zip(("lower", "upper"), combs, strict=True)
    }
    supports = [Clamp("lower:left"), PrescribedDisplacement("upper:right", (0.0, -1e-4, 0.0))]

    def solve(*pairs):
        ends = [pair if slave == "lower" else pair[::-1] for pair in pairs]
        contacts = [Contact(one, 0.15, against=other) for one, other in ends]
        return ContactProblem(coulomb.join(**bodies), MATERIAL, supports, contacts).solve()

    whole = solve(("lower:up", "upper:down"))
    each = solve(("lower:up5", "upper:down1"), ("lower:up9", "upper:down4"))
    assert whole.valid and each.valid
    assert np.all(np.abs(whole.at_nodes.gap) < 1e-12)
    (count, force), (expected, theirs) = (
        MPI.COMM_WORLD.allreduce(np.array([len(of.gap), of.force[:, 0].sum()]))
        for of in (whole.at_nodes, each.at_nodes)
    )
    assert count == expected and force == pytest.approx(theirs, rel=1e-6)


@pytest.mark.parametrize("slave", ["ball", "floor"])
def test_a_rounded_face_far_away_has_no_steps(slave):
    """Half a ring eight radii above a floor: lines from its flanks part, and so do their distances."""
    upper = coulomb.box((1.0, 0.2, 1.0), (16, 2, 3)).domain
    x = upper.geometry.x
    angle, radius = np.radians(160) * (x[:, 0] - 0.5), 0.5 - 0.2 * x[:, 2]
    x[:, 0], x[:, 2] = 1.0 + radius * np.sin(angle), 5.0 - radius * np.cos(angle)

    def around(radius):
        return lambda x: np.isclose(np.hypot(x[0] - 1.0, x[2] - 5.0), radius)

    bodies = {"upper": coulomb.NamedMesh(upper, faces={"rim": around(0.5), "bore": around(0.3)})}
    bodies["lower"] = coulomb.box((2.0, 0.2, 0.5), (17, 2, 3))
    pair = ("upper:rim", "lower:top") if slave == "ball" else ("lower:top", "upper:rim")
    supports = [Clamp("lower:bottom"), PrescribedDisplacement("upper:bore", (0.0, 0.0, -1e-5))]
    answer = ContactProblem(coulomb.join(**bodies), MATERIAL, supports, Contact(pair[0], 0.2, against=pair[1])).solve()
    assert answer.certificate.passed
    nodes = answer.at_nodes
    assert MPI.COMM_WORLD.allreduce(len(nodes.gap)) == 3 * (3 if slave == "ball" else 10)  # what lines still meet
    if slave == "floor":
        inner = np.abs(nodes.x[:, 0] - 1.0) < 0.45
        assert nodes.gap[inner] == pytest.approx(4.5 - np.sqrt(0.25 - (nodes.x[inner, 0] - 1.0) ** 2), rel=0.01)
