"""Meshes with named groups of cells and facets: built (`box`), read from files (`read_mesh`), inspected, moved,
joined, refined and made of first or second order.  Nodal fields in files belong here as well.
"""

from ...exchange import Exchange, even_starts, fetched, owner_of, starts_of
from .among_ranks import Slabs, bounds
from .coarsening import coarsened
from .comparison import coarser_meshes, finer, same_cells, smaller_cells
from .curving import CurvedFaces, few_chords, split
from .inspection import InspectedMesh, inspect
from .lagrange import (
    corner_geometry,
    facet_columns,
    functions_of_nodes,
    in_vtk_order,
    lagrange_points,
    lagrange_slopes,
    lagrange_values,
    nodes_between,
)
from .mesh_file import MeshFile
from .mesh_parts import SAME_PLACE, boundary_facets, corners_of, local_facets, neighbours
from .meshes import box, distributed, first_order, known_format, polygon, read_file, read_mesh, read_xdmf, second_order
from .named_mesh import SEPARATOR, JoinedMesh, NamedMesh, moved, volume, with_surfaces
from .nodal_field import NodalField
from .refinement import refined
from .slices import AXISYMMETRIC, FORMS_IN_2D, Slice
from .slicing import slice
from .user_groups import faces_of, is_mesh, is_mesh_data
from .xdmf_format import FACETS, NODE_NUMBER, SOLIDS
from .xdmf_writing import HDF5Target, gathered, write
