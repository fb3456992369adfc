"""Small runs of several bodies for the tests of their files."""

from coulomb import ContactProblem, Material, SymmetryPlane, Traction, box, join, moved

TWO = """\
[[body]]
name = "lower"
box = [1.0, 1.0, 0.5]
cells = [3, 2, 1]
material = {young = 2.1e11, poisson = 0.3}
[[body]]
name = "upper"
box = [0.8, 0.7, 0.4]
cells = [2, 2, 1]
cell = "tetrahedron"
translate = [0.1, 0.15, 0.5]
material = {young = 7e10, poisson = 0.33}
[[clamp]]
face = "lower:bottom"
[[spring]]
face = "upper:left"
stiffness = [1e10, 1e9, 1e9]
[[traction]]
face = "upper:top"
value = [2e6, 0.0, -1e7]
amplitude = [[0, 0], [1, 1], [2, 0.3]]
[[prescribed_displacement]]
face = "upper:right"
components = "y"
value = [0.0, 1e-5, 0.0]
amplitude = [[0, 0], [1, 0], [2, 1]]
[[contact]]
face = "upper:bottom"
against = "lower:top"
friction = 0.3
gap = 1e-6
[[probe]]
name = "heel"
point = [0.5, 0.5, 0.5]
body = "upper"
[[probe]]
name = "deep"
point = [0.5, 0.5, 0.2]
[history]
times = [1, 2]
"""
"""Two steps of a block of tetrahedra on one of hexahedra, held by a spring beside contact and a prescribed way."""


def pressed(contact, lower, upper, pressure=1e7):
    """Two blocks of the same cross-section, without lateral strain: everywhere the same pressure."""
    below = box((1.0, 1.0, 0.5), (3, 2, 1), lower[0], degree=lower[1])
    above = box((1.0, 1.0, 0.4), (2, 2, 1), upper[0], degree=upper[1])
    mesh = join(lower=below, upper=moved(above, (0.0, 0.0, 0.5)))
    held = ("lower:bottom", "lower:left", "lower:front", "upper:left", "upper:front")
    planes = [SymmetryPlane(face) for face in held]
    load = [Traction("upper:top", (0.0, 0.0, -pressure))]
    return ContactProblem(mesh, Material(2e11, 0.0), planes, contact, load)
