"""Sections of rectangles for slices: as read from files, and as MSH files of gmsh's."""

import numpy as np

from coulomb.fem.meshes.mesh_file import SectionFile

TYPES = {3: 2, 4: 3, 6: 9, 8: 16, 9: 10}
"""gmsh's types of elements in 2D by their nodes."""


def rectangle(low, high, cells, nodes=4):
    """Corners, numbers of cells along x and y, nodes of a cell; lines "left", "right", "bottom", "top"."""
    order = 1 if nodes in (3, 4) else 2
    n, m = (order * count + 1 for count in cells)
    x, y = np.meshgrid(np.linspace(low[0], high[0], n), np.linspace(low[1], high[1], m), indexing="ij")
    number = np.arange(n * m).reshape(n, m)
    rows = []
    for i in range(0, n - 1, order):
        for j in range(0, m - 1, order):
            part = number[i : i + order + 1, j : j + order + 1]
            corners = [(0, 0), (order, 0), (order, order), (0, order)]
            for of in [corners] if nodes in (4, 8, 9) else [corners[:3], [corners[0], *corners[2:]]]:
                at = [part[place] for place in of]
                if order == 2:
                    ends = zip(of, of[1:] + of[:1], strict=True)
                    at += [part[(a[0] + b[0]) // 2, (a[1] + b[1]) // 2] for a, b in ends]
                rows.append([*at, part[1, 1]] if nodes == 9 else at)
    sides = {"left": number[0], "right": number[-1], "bottom": number[:, 0], "top": number[:, -1]}
    lines = {name: np.column_stack([line[:-1:order], line[order::order]]) for name, line in sides.items()}
    used = np.isin(number.ravel(), rows)  # 8-node cells leave the middles out
    new = np.cumsum(used) - 1
    points = np.column_stack([x.ravel(), y.ravel()])[used]
    return SectionFile("section", points, {nodes: new[rows]}, {}, {name: new[line] for name, line in lines.items()})


def write(path, section):
    """An MSH file, version 2.2."""
    names = list(section.line_groups)
    text = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names) + 1)]
    text += [f'1 {k} "{name}"' for k, name in enumerate(names, 1)] + ['2 9 "body"', "$EndPhysicalNames"]
    text += ["$Nodes", str(len(section.points))]
    text += [f"{k} {x!r} {y!r} 0" for k, (x, y) in enumerate(section.points.tolist(), 1)] + ["$EndNodes"]
    lines = [(1, k, row) for k, name in enumerate(names, 1) for row in section.line_groups[name]]
    cells = [(TYPES[width], 9, row) for width, rows in section.cells.items() for row in rows]
    text += ["$Elements", str(len(lines) + len(cells))]
    for number, (kind, group, row) in enumerate([*lines, *cells], 1):
        text.append(f"{number} {kind} 2 {group} {group} {' '.join(str(node + 1) for node in row)}")
    path.write_text("\n".join([*text, "$EndElements", ""]))
    return path
