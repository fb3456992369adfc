"""What meshes a case file may name, without loading a library: the formats that can be read, the faces of a box."""

BOX_FACES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0), "top": (2, 1)}
"""By name: axis, and whether at its lower (0) or upper (1) end."""

FORMATS = {
    ".msh": "gmsh",
    ".xdmf": "XDMF",
    ".inp": "Abaqus, CalculiX",
    ".med": "Salome",
    **dict.fromkeys((".e", ".exo", ".exii", ".g"), "Exodus II"),
    **dict.fromkeys((".vtu", ".vtk"), "VTK"),
    **dict.fromkeys((".bdf", ".nas"), "Nastran"),
    ".mesh": "Medit",
}
"""The programs that write them, by file name extension in lower case."""

NUMBERED = {".xdmf", ".vtu", ".vtk", ".bdf", ".nas", ".mesh"}
"""Formats whose groups are numbers on facets and cells, to which a user gives names."""


def listed() -> str:
    """The formats and the ends of their names, for messages."""
    ends: dict[str, list[str]] = {}
    for end, title in FORMATS.items():
        ends.setdefault(title, []).append(end)
    return ", ".join(f"{', '.join(group)} ({title})" for title, group in ends.items())
