"""The names of a box's faces."""

BOX_FACES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0), "top": (2, 1)}
"""By name: axis, and whether at its lower (0) or upper (1) end."""
