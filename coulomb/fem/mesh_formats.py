"""The mesh formats that can be read, without loading a library that reads them."""

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
