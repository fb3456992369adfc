"""A box of `mesh_files` in the formats of other programs, most of them written by meshio, the others by hand."""

import h5py
import meshio
import numpy as np
from scipy.io import netcdf_file

NUMBERS = {"left": 1, "right": 2, "front": 3, "back": 4, "bottom": 5, "top": 6}
CELL_NUMBERS = {"soft": 7, "stiff": 8}

SIDES_OF_ABAQUS = {
    4: [(1, 2, 3), (1, 4, 2), (2, 4, 3), (3, 4, 1)],
    8: [(1, 2, 3, 4), (5, 8, 7, 6), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 8, 4), (4, 8, 5, 1)],
}
SIDES_OF_EXODUS = {
    4: [(1, 2, 4), (2, 3, 4), (1, 4, 3), (1, 3, 2)],
    8: [(1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (1, 5, 8, 4), (1, 4, 3, 2), (5, 6, 7, 8)],
}
"""As their manuals list them, nodes from 1."""


def numbered_mesh(file, key, facets=True):
    """For meshio: cells and facets with a number each, under `key`."""
    cell = {4: "tetra", 8: "hexahedron", 10: "tetra10", 27: "hexahedron27"}[file.cells.shape[1]]
    facet = {4: "triangle", 8: "quad", 10: "triangle6", 27: "quad9"}[file.cells.shape[1]]
    on_cells = np.zeros(len(file.cells), dtype=int)
    for name, members in file.cell_groups.items():
        on_cells[members] = CELL_NUMBERS[name]
    on_facets = np.concatenate([np.full(len(rows), NUMBERS[name]) for name, rows in file.faces.items()])
    blocks, numbers = [(cell, file.cells)], [on_cells]
    if facets:
        blocks, numbers = [*blocks, (facet, np.vstack(list(file.faces.values())))], [*numbers, on_facets]
    return meshio.Mesh(file.points, blocks, cell_data={key: numbers})


def vtu(file, path):
    meshio.vtu.write(path, numbered_mesh(file, "numbers"))


def vtk(file, path):
    meshio.vtk.write(path, numbered_mesh(file, "numbers"))


def nastran(file, path):
    meshio.nastran.write(path, numbered_mesh(file, "nastran:ref"), cell_format="fixed-small")


def medit(file, path):
    meshio.medit.write(path, numbered_mesh(file, "medit:ref"))


def xdmf(file, path):
    """Cells in one file, facets in another beside it."""
    meshio.xdmf.write(path, numbered_mesh(file, "numbers", facets=False))
    whole = numbered_mesh(file, "numbers")
    facets = meshio.Mesh(file.points, whole.cells[1:], cell_data={"numbers": whole.cell_data["numbers"][1:]})
    meshio.xdmf.write(path.with_name("facets.xdmf"), facets)


def med(file, path, nodes=False):
    """Groups of facets (or of their nodes) and of cells; families as Salome makes them, one for every set of groups."""
    mesh = numbered_mesh(file, "cell_tags", facets=not nodes)
    mesh.cell_data["cell_tags"] = [-tags for tags in mesh.cell_data["cell_tags"]]
    mesh.cell_tags = {-number: [name, "all"] for name, number in CELL_NUMBERS.items()}
    mesh.point_tags = {}
    if nodes:
        groups = {}  # a node at an edge is in two groups
        for name, rows in file.faces.items():
            for node in np.unique(rows):
                groups.setdefault(node, []).append(name)
        families = {names: number for number, names in enumerate(sorted({tuple(n) for n in groups.values()}), start=1)}
        tags = np.array([families[tuple(groups[n])] if n in groups else 0 for n in range(len(file.points))])
        mesh.point_data["point_tags"] = tags
        mesh.point_tags = {number: list(names) for names, number in families.items()}
    else:
        mesh.cell_tags |= {-number: [name] for name, number in NUMBERS.items()}
    meshio.med.write(path, mesh)


def without_families_of(path, kind):
    """As Salome writes elements that are in no group."""
    with h5py.File(path, "a") as med_file:
        step = next(iter(med_file["ENS_MAA"]["mesh"].values()))
        del step["MAI"][kind]["FAM"]


def sides(file, rows, table):
    """Of every facet the cell and the number of its side, both from 1, in a manual's table of sides."""
    found, (count, corner) = {}, {4: (4, 3), 8: (8, 4), 10: (4, 3), 27: (8, 4)}[file.cells.shape[1]]
    for number, cell in enumerate(file.cells, start=1):
        for side, corners in enumerate(table[count], start=1):
            found[tuple(sorted(cell[np.array(corners) - 1]))] = (number, side)
    return [found[tuple(sorted(row[:corner]))] for row in rows]


def abaqus(file, path, faces="surfaces"):
    """An input file with numbers that do not follow each other; faces as surfaces, as shells or as node sets."""
    width = file.cells.shape[1]

    def data(rows):
        return "\n".join(", ".join(map(str, row)) for row in rows) + "\n"

    out = ["*Heading\n a box\n** comment\n*Part, name=Part-1\n*Node, nset=everything\n"]
    out.append(data([10 * i + 10, *map(float, x)] for i, x in enumerate(file.points)))
    for name, members in file.cell_groups.items():
        out.append(f"*Element, type=c3d{width}, elset={name}\n")
        out.append(data([3 * (i + 1), *(10 * file.cells[i] + 10)] for i in members))
    number = 3 * len(file.cells) + 1
    for name, rows in file.faces.items():
        if faces == "surfaces":
            at = sides(file, rows, SIDES_OF_ABAQUS)
            for side in sorted({side for _, side in at}):
                cells = [3 * cell for cell, of_cell in at if of_cell == side]
                out.append(
                    f"*Elset, elset=_{name}_S{side}, internal\n"
                    + data(cells[k : k + 8] for k in range(0, len(cells), 8))
                )
            out.append(f"*Surface, type=ELEMENT, name={name}\n")
            out.append(data([f"_{name.upper()}_s{side}", f"S{side}"] for side in sorted({side for _, side in at})))
        elif faces == "shells":
            out.append(f"*Element, type=SFM3D{rows.shape[1]}, elset=of_{name}\n")
            out.append(data([number + k, *(10 * row + 10)] for k, row in enumerate(rows)))
            out.append(f"*Elset, elset={name}\nof_{name},\n")
            number += len(rows)
        else:
            nodes = 10 * np.unique(rows) + 10
            out.append(f"*Nset, nset={name}\n" + data(nodes[k : k + 16] for k in range(0, len(nodes), 16)))
    out.append("*End Part\n*Material, name=steel\n*Elastic\n2e11, 0.3\n")
    path.write_text("".join(out))


def abaqus_by_meshio(file, path):
    mesh = numbered_mesh(file, "numbers")
    mesh.cell_sets = {
        **{name: [members, []] for name, members in file.cell_groups.items()},
        **{name: [[], np.flatnonzero(mesh.cell_data["numbers"][1] == NUMBERS[name])] for name in file.faces},
    }
    meshio.abaqus.write(path, mesh)


def exodus(file, path, hdf5=False, nodes=False):
    """Blocks of the cell groups, and side sets (or node sets) of the faces; NetCDF-3 or HDF5."""
    kind = {4: "TETRA4", 8: "HEX8", 10: "TETRA10", 27: "HEX27"}[file.cells.shape[1]]
    order = np.concatenate(list(file.cell_groups.values()))  # elements are numbered block by block
    number = np.empty(len(order), dtype=int)
    number[order] = np.arange(1, len(order) + 1)
    variables = {f"coord{axis}": file.points[:, k] for k, axis in enumerate("xyz")}
    for k, members in enumerate(file.cell_groups.values(), start=1):
        variables[f"connect{k}"] = (file.cells[members] + 1).astype("i4")
    for k, rows in enumerate(file.faces.values(), start=1):
        if nodes:
            variables[f"node_ns{k}"] = (np.unique(rows) + 1).astype("i4")
        else:
            at = np.array(sides(file, rows, SIDES_OF_EXODUS))
            variables[f"elem_ss{k}"] = number[at[:, 0] - 1].astype("i4")
            variables[f"side_ss{k}"] = at[:, 1].astype("i4")
    for prefix, names in (("eb", file.cell_groups), ("ns" if nodes else "ss", file.faces)):
        variables[f"{prefix}_prop1"] = np.arange(100, 100 + len(names), dtype="i4")
        letters = np.array([list(name.ljust(33, "\0").encode()) for name in names], dtype="u1")
        variables[f"{prefix}_names"] = letters.view("S1")
    if hdf5:
        with h5py.File(path, "w") as out:
            for name, values in variables.items():
                out[name] = values
                if name.startswith("connect"):
                    out[name].attrs["elem_type"] = np.bytes_(kind)
        return
    with netcdf_file(path, "w", version=2) as out:
        for name, values in variables.items():
            dimensions = tuple(f"{name}_{axis}" for axis in range(values.ndim))
            for dimension, size in zip(dimensions, values.shape, strict=True):
                out.createDimension(dimension, size)
            variable = out.createVariable(name, values.dtype, dimensions)
            variable[...] = values
            if name.startswith("connect"):
                variable.elem_type = kind
