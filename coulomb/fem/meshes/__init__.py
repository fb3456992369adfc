"""Meshes with named groups of cells and facets: built (`box_mesh`), read from files (`read_mesh`), inspected, moved,
joined and raised to second order.  Nodal fields in files belong here as well.
"""

from .exchange import Exchange, Slabs, even_starts, fetched, owner_of, starts_of
from .hdf5_target import HDF5Target
from .inspection import inspect
from .joined_mesh import SEPARATOR, JoinedMesh
from .lagrange import corner_geometry, facet_columns, lagrange_points, lagrange_slopes, lagrange_values
from .mesh_file import MeshFile
from .mesh_groups import corners_of, local_facets
from .mesh_parts import SAME_PLACE, IntArray
from .meshes import box, distributed, known_format, read_file, read_gmsh, read_mesh, read_xdmf
from .moved_mesh import moved
from .named_mesh import NamedMesh, aspects, volume
from .nodal_field import NodalField
from .raised import raised
from .second_order import in_vtk_order, nodes_between
from .xdmf_writing import FACETS, SOLIDS, write

__all__ = [
    "FACETS",
    "SAME_PLACE",
    "SEPARATOR",
    "SOLIDS",
    "Exchange",
    "HDF5Target",
    "IntArray",
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
