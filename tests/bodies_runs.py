"""Small runs of several bodies for the tests of their files."""

from case_texts import body

from coulomb import Contact, ContactProblem, Material, SymmetryPlane, Traction, box, join, moved

TWO = """\
clamp = [{ face = "lower:bottom" }]
temperature = { body = "upper", value = 25.0, reference = 20.0 }
history = { times = [1, 2] }
"""
TWO += body("lower", (1.0, 1.0, 0.5), (3, 2, 1), young=2.1e11)
TWO += body("upper", (0.8, 0.7, 0.4), (2, 2, 1), (0.1, 0.15, 0.5), 7e10, 0.33, "tetrahedron", expansion=2e-7)
TWO += """\
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
"""
"""Two steps of a warm block of tetrahedra on one of hexahedra, held by a spring beside contact and a prescribed way."""

UNLOADED = """\
clamp = [{ face = "lower:bottom" }]
prescribed_displacement = [{ face = "upper:top", value = [0, 0, -3e-4], amplitude = [[0, 0], [1, 1], [2, 0]] }]
contact = { face = "upper:bottom", against = "lower:top", friction = 0.3 }
history = { times = [1, 2] }
"""
UNLOADED += body("lower", (1.2, 0.6, 0.4), (5, 3, 2), young=2.1e11)
UNLOADED += body("upper", (0.6, 0.3, 0.2), (4, 3, 2), (0.3, 0.15, 0.4), 7e10, 0.33)
"""Two blocks, pressed together and released."""


def pressed(contact, lower, upper, pressure=1e7):
    """Two blocks of the same cross-section, without lateral strain: everywhere the same pressure."""
    below = box((1.0, 1.0, 0.5), (3, 2, 1), lower[0], degree=lower[1])
    above = box((1.0, 1.0, 0.4), (2, 2, 1), upper[0], degree=upper[1])
    mesh = join(lower=below, upper=moved(above, (0.0, 0.0, 0.5)))
    held = ("lower:bottom", "lower:left", "lower:front", "upper:left", "upper:front")
    planes = [SymmetryPlane(face) for face in held]
    load = [Traction("upper:top", (0.0, 0.0, -pressure))]
    return ContactProblem(mesh, Material(2e11, 0.0), planes, contact, load)


def on_one_base():
    """Two pads, pressed by the same 1e7 Pa and without lateral strain, on the face of one base"""
    base = box((2.0, 1.0, 0.5), (5, 3, 1))
    pads = {name: moved(box((0.8, 1.0, 0.4), (2, 2, 1)), (x, 0.0, 0.5)) for name, x in (("one", 0.0), ("two", 1.2))}
    planes = [SymmetryPlane("base:bottom"), *(SymmetryPlane(f"{name}:front") for name in ("base", *pads))]
    planes += [SymmetryPlane("base:left"), SymmetryPlane("one:left"), SymmetryPlane("two:right")]
    contacts = [Contact(f"{name}:bottom", against="base:top", friction=0.3) for name in pads]
    loads = [Traction(f"{name}:top", (0.0, 0.0, -1e7)) for name in pads]
    return ContactProblem(join(base=base, **pads), Material(2e11, 0.0), planes, contacts, loads)
