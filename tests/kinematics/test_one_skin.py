"""One face that is all around a body, between several foundations or other bodies at once."""

import numpy as np
import pytest
from mesh_files import BoxFile
from rubber_blocks import LAME, MU

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    NeoHookean,
    Plane,
    PrescribedDisplacement,
    box,
    join,
    moved,
    read_mesh,
)
from coulomb.io.output import write
from coulomb.recheck import check

SIZE, RUBBER = np.array([0.4, 0.1, 0.2]), NeoHookean(1e6, 0.3)
DOWN = -0.05


def cushion(tmp_path, half=False, crown=0.2):
    """A cushion of this size about the origin, with crowned ends; its face "skin" is below, above and at both ends; the
    upper half alone without the lower one."""
    cells = (6, 1, 2 if half else 4)
    file = BoxFile(SIZE * ([1.0, 1.0, 0.5] if half else 1.0), cells)
    x = file.points - SIZE * (0.5, 0.0, 0.0 if half else 0.5)
    x[:, 0] *= 1.0 + crown * (1.0 - (x[:, 2] / 0.1) ** 2)
    file.points = x
    around = [file.faces.pop(name) for name in ("left", "right", "top", *(() if half else ("bottom",)))]
    file.faces["skin"] = np.concatenate(around)
    return read_mesh(file.write(tmp_path / f"{half}.msh"))


def lid(way, friction):
    plane = Plane((0.0, 0.0, 0.1), (0.0, 0.0, -1.0))
    return Contact("skin", friction, foundation=plane, motion=lambda time: (0.0, 0.0, way * time))


def last(problem, steps=4):
    *_, end = LoadHistory(np.arange(1, steps + 1) / steps).steps(problem)
    assert end.solution.valid, str(end.solution.certificate) + str(end.solution.outside)
    return end.solution


def test_between_floor_and_lid_as_the_mirrored_half(tmp_path):
    """Nothing but contact holds the cushion along z, and friction along x."""
    floor, sides = Contact("skin", 0.3, foundation=Plane((0.0, 0.0, -0.1), (0.0, 0.0, 1.0))), [Clamp("front", "y")]
    whole = last(ContactProblem(cushion(tmp_path), RUBBER, sides, [floor, lid(DOWN, 0.3)], kinematics="large"))
    held = [*sides, Clamp("bottom", "z")]
    half = last(ContactProblem(cushion(tmp_path, True), RUBBER, held, lid(0.5 * DOWN, 0.3), kinematics="large"))
    expected = half.at_nodes.totals()
    for part in range(2):
        assert whole.at_nodes.totals(part)["normal_force"] == pytest.approx(expected["normal_force"], rel=1e-6)
        assert whole.at_nodes.totals(part)["contact_area"] == pytest.approx(expected["contact_area"], rel=1e-6)
    write(whole, tmp_path / "run")
    assert check(tmp_path / "run").passed


@pytest.mark.parametrize("deformable", [False, True])
def test_in_a_box_whose_edges_it_touches(deformable, tmp_path):
    """Two walls, floor and lid without friction: a uniform strain, and the formula's stress on each; nodes at edges
    touch two.  Or floor and lid are bodies, 1e5 times as stiff."""
    mesh, name, down = cushion(tmp_path, crown=0.0), "", DOWN
    supports, material, contacts = [], RUBBER, []
    if deformable:
        name, down = "cushion:", 0.2 * DOWN
        plates = {
            side: moved(box((0.6, 0.1, 0.1), (2, 1, 1)), (-0.3, 0.0, z)) for side, z in (("low", -0.2), ("up", 0.1))
        }
        mesh, material = (
            join(cushion=mesh, **plates),
            {"cushion": RUBBER, **dict.fromkeys(plates, NeoHookean(1e11, 0.0))},
        )
        supports = [Clamp(f"{side}:{end}", "y") for side in plates for end in ("front", "back")]
        supports += [
            Clamp("low:bottom"),
            PrescribedDisplacement("up:top", (0.0, 0.0, down), amplitude=[(0, 0), (1, 1)]),
        ]
        contacts = [Contact("cushion:skin", 0.0, against=to, slave=True) for to in ("low:top", "up:bottom")]
    else:
        contacts = [Contact("skin", 0.0, foundation=Plane((0.0, 0.0, -0.1), (0.0, 0.0, 1.0))), lid(down, 0.0)]
    for side in (1.0, -1.0):
        contacts.append(Contact(f"{name}skin", 0.0, foundation=Plane((-0.2 * side, 0.0, 0.0), (side, 0.0, 0.0))))
    supports += [Clamp(f"{name}{end}", "y") for end in ("front", "back")]
    solution = last(ContactProblem(mesh, material, supports, contacts, kinematics="large"), 1)
    stretch = 1.0 + down / 0.2
    across, along = LAME * np.log(stretch), MU * (stretch - 1.0 / stretch) + LAME * np.log(stretch) / stretch
    for part, force in enumerate([0.04 * along, 0.04 * along, 0.02 * across, 0.02 * across]):
        found = solution.at_nodes.totals(part)["normal_force"]
        assert found == pytest.approx(-force, rel=1e-4 if deformable else 1e-8)
