"""Small gmsh files, written without gmsh: a box of hexahedra or tetrahedra in MSH 2.2 or 4.1, ASCII or binary."""

import struct
from itertools import permutations, product

import numpy as np
from mpi4py import MPI

from coulomb.fem import compat
from coulomb.fem.compat import fem, ufl

FACETS = {
    4: [(0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)],
    8: [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
}
KINDS = {3: 2, 4: 3, 6: 9, 9: 10}, {4: 4, 8: 5, 10: 11, 27: 12}  # gmsh's types of facets and cells, by number of nodes

GMSH = {
    4: [(0, 1), (1, 2), (2, 0), (3, 0), (3, 2), (3, 1)],
    8: [
        *((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
        *((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
        tuple(range(8)),
    ],
}
VTK = {
    4: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    8: [
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
        *((0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)),
        tuple(range(8)),
    ],
}
EXODUS = {4: VTK[4], 8: [VTK[8][k] for k in (*range(4), *range(8, 12), *range(4, 8), 18, 16, 17, 12, 13, 14, 15)]}
"""Corners around every further node of second-order cells: gmsh's reference manual, 9.2; VTK's file formats; Exodus II,
figure 4.14."""

AROUND = {3: [(0, 1), (1, 2), (2, 0)], 4: [(0, 1), (1, 2), (2, 3), (3, 0), (0, 1, 2, 3)]}


class BoxFile:
    """Points, cells and named groups of a box, which a test may change before writing."""

    def __init__(self, lengths=(2.0, 1.0, 1.0), cells=(4, 2, 2), cell="hexahedron", interface=None):
        self.step = 1  # between the numbers of nodes in the file, which begin with it
        axes = [np.linspace(0.0, length, n + 1) for length, n in zip(lengths, cells, strict=True)]
        self.points = np.array(list(product(*axes)))
        shape = np.array(cells) + 1

        def number(corner):
            return int(np.ravel_multi_index(tuple(corner), shape))

        self.cells = []
        for origin in product(*(range(n) for n in cells)):
            if cell == "hexahedron":
                corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
                self.cells.append([number(np.add(origin, c)) for c in corners])
            else:  # six round the diagonal, as DOLFINx cuts
                for path in permutations(np.eye(3, dtype=int)):
                    steps = [np.zeros(3, dtype=int), path[0], path[0] + path[1], np.ones(3, dtype=int)]
                    self.cells.append([number(np.add(origin, c)) for c in steps])
        self.cells = np.array(self.cells)
        middle = self.points[self.cells].mean(axis=1)
        half = lengths[0] / 2.0 if interface is None else interface
        self.cell_groups = {"soft": np.flatnonzero(middle[:, 0] < half), "stiff": np.flatnonzero(middle[:, 0] > half)}

        facets = self.cells[:, FACETS[self.cells.shape[1]]].reshape(-1, len(FACETS[self.cells.shape[1]][0]))
        _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
        boundary, inside = facets[first[count == 1]], facets[first[count == 2]]
        self.faces = {}
        for axis, names in enumerate((("left", "right"), ("front", "back"), ("bottom", "top"))):
            for name, end in zip(names, (0.0, lengths[axis]), strict=True):
                self.faces[name] = boundary[np.all(np.abs(self.points[boundary][:, :, axis] - end) < 1e-12, axis=1)]
        self.interface = inside[np.all(np.abs(self.points[inside][:, :, 0] - half) < 1e-12, axis=1)]

    def second_order(self, place=lambda x: x, order=GMSH):
        """The same box with nodes in the middles of edges, faces and cells, all of them moved by `place`: (k, 3)."""
        points, made = list(self.points), {}

        def middle(corners):
            key = tuple(sorted(corners))
            if key not in made:
                made[key] = len(points)
                points.append(self.points[list(corners)].mean(axis=0))
            return made[key]

        def second_order(rows, around):
            return np.array([[*row, *(middle(row[list(of)]) for of in around)] for row in rows])

        self.cells = second_order(self.cells, order[self.cells.shape[1]])
        self.faces = {name: second_order(rows, AROUND[rows.shape[1]]) for name, rows in self.faces.items()}
        self.points = place(np.array(points))
        return self

    def _blocks(self):
        """Dimension, physical group, gmsh's type, rows of nodes by their numbers."""
        kinds = KINDS
        for number, rows in enumerate(self.faces.values(), start=1):
            if len(rows):
                yield 2, number, kinds[0][rows.shape[1]], self.step * (rows + 1)
        for number, members in enumerate(self.cell_groups.values(), start=1):
            yield 3, number, kinds[1][self.cells.shape[1]], self.step * (self.cells[members] + 1)

    def _names(self, named):
        names = [(2, i, name) for i, name in enumerate(self.faces, start=1)]
        names += [(3, i, name) for i, name in enumerate(self.cell_groups, start=1)]
        lines = [f'{dim} {number} "{name}"' for dim, number, name in names]
        return "\n".join(["$PhysicalNames", str(len(lines)), *lines, "$EndPhysicalNames", ""]) if named else ""

    def write(self, path, version="2.2", binary=False, named=True):
        head = f"$MeshFormat\n{version} {int(binary)} 8\n".encode()
        head += struct.pack("<i", 1) + b"\n" if binary else b""
        head += b"$EndMeshFormat\n" + self._names(named).encode()
        write = {"2.2": self._write_22, "4.1": self._write_41}[version]
        path.write_bytes(head + write(binary))
        return path

    def _write_22(self, binary):
        total = sum(len(rows) for *_, rows in self._blocks())
        out = [f"$Nodes\n{len(self.points)}\n".encode()]
        for i, x in zip(self.step * np.arange(1, len(self.points) + 1), self.points, strict=True):
            out.append(
                struct.pack("<i3d", i, *x) if binary else (f"{i} " + " ".join(map(repr, map(float, x))) + "\n").encode()
            )
        out.append(b"\n$EndNodes\n" if binary else b"$EndNodes\n")
        out.append(f"$Elements\n{total}\n".encode())
        i = 0
        for _, group, kind, rows in self._blocks():
            if binary:
                out.append(struct.pack("<3i", kind, len(rows), 2))
            for row in rows:
                i += 1
                entries = [i, group, group, *row] if binary else [i, kind, 2, group, group, *row]
                line = (
                    struct.pack(f"<{len(entries)}i", *entries)
                    if binary
                    else (" ".join(map(str, entries)) + "\n").encode()
                )
                out.append(line)
        out.append(b"\n$EndElements\n" if binary else b"$EndElements\n")
        return b"".join(out)

    def _write_41(self, binary):
        def numbers(code, *values):
            if binary:
                return struct.pack(f"<{len(values)}{code}", *values)
            return (" ".join(repr(v) if code == "d" else str(v) for v in values) + "\n").encode()

        blocks = list(self._blocks())
        surfaces, volumes = ([b for b in blocks if b[0] == dim] for dim in (2, 3))
        out = [b"$Entities\n", numbers("Q", 0, 0, len(surfaces), len(volumes))]
        for _, group, *_ in (*surfaces, *volumes):
            out += [
                numbers("i", group),
                numbers("d", *[0.0] * 6),
                numbers("Q", 1),
                numbers("i", group),
                numbers("Q", 0),
            ]
        n, total = len(self.points), sum(len(rows) for *_, rows in blocks)
        out += [b"\n$EndEntities\n$Nodes\n", numbers("Q", 1, n, 1, n), numbers("i", 3, 1, 0), numbers("Q", n)]
        out += [numbers("Q", self.step * (i + 1)) for i in range(n)]
        out += [numbers("d", *map(float, x)) for x in self.points]
        out += [b"\n$EndNodes\n$Elements\n", numbers("Q", len(blocks), total, 1, total)]
        for dim, group, kind, rows in blocks:
            out += [numbers("i", dim, group, kind), numbers("Q", len(rows))]
            out += [numbers("Q", i, *map(int, row)) for i, row in enumerate(rows, start=1)]
        return b"".join([*out, b"\n$EndElements\n"])


def integral(mesh, face=None, cells=None):
    """The volume of a mesh or of a group of its cells, or the area of a face, with the map of its cells."""
    one, degree = fem.Constant(mesh.domain, 1.0), 6
    measure, where, dim = ufl.dx, cells and mesh.group(cells, "test"), 3
    if face is not None:
        measure, where, dim = ufl.ds, mesh.facets(face, "test"), 2
    if where is not None:
        tags = compat.meshtags(mesh.domain, dim, where, np.ones(len(where), dtype=np.int32))
        measure = measure(domain=mesh.domain, subdomain_data=tags, subdomain_id=1)
    mine = fem.assemble_scalar(fem.form(one * measure(degree=degree)))
    return mesh.comm.allreduce(mine, op=MPI.SUM)
