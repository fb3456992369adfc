"""Load histories of which files tell how they go on: what begins and ends, turns, locks and wears."""

from case_texts import body, one_body
from rubber_blocks import MOVED

ENDING_TIES = """
[[body]]
name = "a"
box = [1.0, 1.0, 1.0]
cells = [2, 2, 1]
material = {young = 1e6, poisson = 0.3}
[[body]]
name = "b"
box = [1.0, 1.0, 1.0]
cells = [3, 3, 1]
translate = [0.0, 0.0, 1.0]
material = {young = 1e6, poisson = 0.3}
[[clamp]]
face = "a:bottom"
[[prescribed_displacement]]
face = "b:top"
value = [0.5e-3, 0.0, 1e-3]
amplitude = [[0, 0], [1, 1], [2, 0], [3, -1]]
[[tie]]
face = "b:bottom"
against = "a:top"
end = 1.0
[[tie]]
face = "b:bottom"
against = "a:top"
begin = 3.0
[contact]
face = "b:bottom"
against = "a:top"
friction = 0.5
[history]
times = [1.0, 2.0, 3.0, 4.0]
[output]
directory = "run"
"""

ENDING_SUPPORTS = """
[mesh]
box = [0.1, 0.1, 0.05]
cells = [3, 3, 2]
[material]
young = 5e6
poisson = 0.4
[[prescribed_displacement]]
face = "top"
value = [0.0, 0.0, -0.0005]
components = "z"
amplitude = [[0, 0], [1, 1]]
[[clamp]]
face = "right"
components = "xy"
end = 1.0
[[symmetry]]
face = "left"
end = 1.0
[[prescribed_displacement]]
face = "top"
components = "xy"
begin = 1.0
reaches = 2.0
value = [0.001, 0.0005, 0.0]
[contact]
face = "bottom"
friction = 0.5
[history]
times = [1.0, 1.5, 2.0, 3.0]
[output]
directory = "run"
picture = false
"""

TURNED_BOLT = """\
clamp = [{ face = "low:bottom" }]
contact = { face = "up:top", friction = 0.3 }
solver = { kinematics = "large" }
history = { times = [1.0, 2.0] }
output = { picture = false }
[[prescribed_displacement]]
face = "up:top"
value = [0.01, 0.0, 0.0]
components = "xy"
amplitude = [[1.0, 0.0], [2.0, 1.0]]
[[pretension]]
face = "up:bottom"
against = "low:top"
force = -2e8
amplitude = [[0.0, 0.0], [1.0, 1.0]]
lock = 1.0
"""
TURNED_BOLT += body("low", (0.1, 0.1, 0.4), (1, 1, 2), law='"st-venant-kirchhoff"')
TURNED_BOLT += body("up", (0.1, 0.1, 0.3), (2, 1, 1), (0.0, 0.0, 0.4), law='"st-venant-kirchhoff"')
"""A strut under a ceiling, locked, whose end is drawn aside."""

TURNED_FACE = one_body((1.0, 1.0, 0.6), (1, 1, 1), 1e6, law='"neo-hookean"')
TURNED_FACE += """\
[[rigid_face]]
face = "top"
translation = { x = 0.0, y = 0.0, z = -0.04 }
rotation = { x = 0.0, y = 0.0 }
rotation_stiffness = [0.0, 0.0, 500.0]
amplitude = [[0.0, 0.0], [1.0, 1.0]]
[[point_load]]
face = "top"
moment = [0.0, 0.0, 2e3]
amplitude = [[0.0, 0.0], [1.0, 0.0], [4.0, 1.0], [5.0, 1.1]]
[contact]
face = "bottom"
friction = 0.0
foundation = { point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }
[solver]
kinematics = "large"
tolerance = 1e-11
[history]
times = [1.0, 2.0, 3.0, 4.0, 5.0]
[output]
picture = false
"""
"""A block on a smooth floor, pressed, and turned by more than half a turn by a moment against a spring."""

SHOE = """\
material = { young = 1e7, poisson = 0.3 }
clamp = [{ face = "top", components = "xy" }]
history = { times = [1, 2, 3, 4] }
output = { picture = false }
[mesh]
box = [0.1, 0.05, 0.04]
cells = [6, 3, 3]
cell = "hexahedron"
[[prescribed_displacement]]
face = "top"
value = [0, 0, -3e-3]
components = "z"
amplitude = [[0, 0], [1, 1]]
[contact]
face = "bottom"
friction = 0.4
motion = [[0, 0, 0, 0], [4, 0, 0, 1e-3]]
foundation = {shape = "cylinder", point = [0.06, 0, -0.5], axis = [0, 1, 0], radius = 0.5}
[contact.rotation]
point = [0.061, 0.02, -0.5]
axis = [0, 2, 0]
angle = [[0, 0], [1, 0], [4, 0.4]]
"""
"""A block of rubber on a drum that turns, a little off its axis, and rises meanwhile."""
TURNTABLE = (
    SHOE.replace('"hexahedron"', '"tetrahedron"')
    .replace(', shape = "cylinder"', "")
    .replace(
        '{shape = "cylinder", point = [0.06, 0, -0.5], axis = [0, 1, 0], radius = 0.5}',
        "{point = [0, 0, 0], normal = [0, 0, 1]}",
    )
    .replace("axis = [0, 2, 0]", "axis = [0, 0, -1]")
    .replace("motion = [[0, 0, 0, 0], [4, 0, 0, 1e-3]]\n", "")
)
"""Tetrahedra on a plane that rotates about its normal."""

RUBBER_ON_RUBBER = body("lower", (1.6, 1.0, 0.5), (2, 1, 1), young=3e6, law='"neo-hookean"')
RUBBER_ON_RUBBER += body("upper", (0.8, 0.8, 0.5), (2, 1, 1), (0.1, 0.1, 0.5), 1e6)
RUBBER_ON_RUBBER += MOVED.replace("TOP", "upper:top").replace("DOWN", "-0.05").replace("ALONG", "0.3")
RUBBER_ON_RUBBER += """\
[[clamp]]
face = "lower:bottom"
[contact]
face = "upper:bottom"
against = "lower:top"
friction = 0.2
[history]
times = [1.0, 2.0]
"""

PRESS_FIT = one_body((2, 1, 0.5), (4, 2, 2), 1e7)
PRESS_FIT += """\
[[clamp]]
face = "top"
[contact]
face = "bottom"
friction = 0.4
gap = "1e-3*(x - 1.2)"
gap_amplitude = [[0, 0], [1, 1], [2, -0.5]]
motion = [[0, 0, 0, 0], [1, 0, 0, 0], [2, 2e-3, 0, 1e-4]]
[history]
times = [0.5, 1.5]
"""
"""Given gaps that grow and end, on a foundation that moves."""
