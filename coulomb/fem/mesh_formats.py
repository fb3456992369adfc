"""What meshes a case file may name, without loading a library: the formats that can be read, the faces of a box."""

from collections.abc import Container

BOX_FACES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0), "top": (2, 1)}
"""By name: axis, and whether at its lower (0) or upper (1) end."""

FORMATS = {
    ".msh": ("gmsh", "gmsh"),
    ".xdmf": ("XDMF", "xdmf"),
    ".inp": ("Abaqus, CalculiX", "abaqus"),
    ".med": ("Salome", "med"),
    **dict.fromkeys((".e", ".exo", ".exii", ".g"), ("Exodus II", "exodus")),
    **dict.fromkeys((".vtu", ".vtk"), ("VTK", "meshio")),
    **dict.fromkeys((".bdf", ".nas"), ("Nastran", "meshio")),
    ".mesh": ("Medit", "meshio"),
}
"""By file name extension in lower case: the program that writes it, and X of the module meshes.X_format that reads
it."""

NUMBERED = {".xdmf", ".vtu", ".vtk", ".bdf", ".nas", ".mesh"}
"""Formats whose groups are numbers on facets and cells, to which a user gives names."""

SECTIONS = {".msh", ".med", ".inp", *NUMBERED}
"""Formats of which meshes in 2D are read."""

BY_GROUP = FORMATS.keys() - {".xdmf", ".e", ".exo", ".exii", ".g"}
"""Formats of which one group of cells can be read."""


def other_side(cut: str) -> str:
    """Name of the second face of a cut."""
    return f"{cut}_opposite"


def listed(some: Container[str] = FORMATS) -> str:
    """The formats, or some, and the ends of their names, for messages."""
    ends: dict[str, list[str]] = {}
    for end, (title, _) in FORMATS.items():
        if end not in some:
            continue
        ends.setdefault(title, []).append(end)
    return ", ".join(f"{', '.join(group)} ({title})" for title, group in ends.items())
