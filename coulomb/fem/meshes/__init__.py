"""Meshes with named groups of cells and facets: built (`box_mesh`), read from files (`read_mesh`), inspected, moved,
joined and raised to second order.  Nodal fields in files belong here as well.
"""

from .exchange import Exchange, Slabs, even_starts, fetched, owner_of, starts_of
from .inspection import inspect
from .joined_mesh import SEPARATOR, JoinedMesh, moved
from .lagrange import (
    corner_geometry,
    facet_columns,
    in_vtk_order,
    lagrange_points,
    lagrange_slopes,
    lagrange_values,
    nodes_between,
)
from .mesh_file import MeshFile
from .mesh_parts import SAME_PLACE, corners_of, local_facets
from .meshes import box, distributed, known_format, read_file, read_gmsh, read_mesh, read_xdmf
from .named_mesh import NamedMesh, aspects, volume
from .nodal_field import NodalField
from .raised import raised
from .xdmf_writing import FACETS, SOLIDS, HDF5Target, write

__all__ = [
    "FACETS",
    "SAME_PLACE",
    "SEPARATOR",
    "SOLIDS",
    "Exchange",
    "HDF5Target",
    "JoinedMesh",
    "MeshFile",
    "NamedMesh",
    "NodalField",
    "Slabs",
    "aspects",
    "box",
    "corner_geometry",
    "corners_of",
    "distributed",
    "even_starts",
    "facet_columns",
    "fetched",
    "in_vtk_order",
    "inspect",
    "known_format",
    "lagrange_points",
    "lagrange_slopes",
    "lagrange_values",
    "local_facets",
    "moved",
    "nodes_between",
    "owner_of",
    "raised",
    "read_file",
    "read_gmsh",
    "read_mesh",
    "read_xdmf",
    "starts_of",
    "volume",
    "write",
]
