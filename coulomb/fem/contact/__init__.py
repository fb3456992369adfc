"""Contact surfaces: contact points with frames, weights and gaps on a rigid foundation (`contact_surface`), pairs of
deformable faces by dual mortar elements (`pair_of`), and the sparse matrix B from displacements to contact points.
"""

from .contact_points import (
    ContactPoints,
    KeptMatrix,
    at_nodes_of,
    bounded_gap,
    contact_matrix,
    contact_points,
    joined_points,
    row_products,
    rows_of,
)
from .mortar import MortarRows, mortar_rows
from .near_facets import FaceSamples, NearFace, face_samples, whole_face
from .pair import NO_SHAPE, Pair, Shape, bulges_at_points, curved_patch, pair_frames, pair_of, pair_surface
from .slave_side import lost_nodes, slave_side
from .surface import (
    ContactSurface,
    Normals,
    contact_surface,
    interpolated_forces,
    joined,
    plane_of_face,
    turned_away,
    way_along,
)
from .symmetric_pair import held_on_both, planes_of_symmetry, shares, within

__all__ = [
    "NO_SHAPE",
    "ContactPoints",
    "ContactSurface",
    "FaceSamples",
    "KeptMatrix",
    "MortarRows",
    "NearFace",
    "Normals",
    "Pair",
    "Shape",
    "at_nodes_of",
    "bounded_gap",
    "bulges_at_points",
    "contact_matrix",
    "contact_points",
    "contact_surface",
    "curved_patch",
    "face_samples",
    "held_on_both",
    "interpolated_forces",
    "joined",
    "joined_points",
    "lost_nodes",
    "mortar_rows",
    "pair_frames",
    "pair_of",
    "pair_surface",
    "plane_of_face",
    "planes_of_symmetry",
    "row_products",
    "rows_of",
    "shares",
    "slave_side",
    "turned_away",
    "way_along",
    "whole_face",
    "within",
]
