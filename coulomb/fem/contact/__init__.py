"""Contact surfaces: contact points with frames, weights and gaps on a rigid foundation (`contact_surface`), pairs of
deformable faces by dual mortar elements (`pair_of`), and the sparse matrix B from displacements to contact points.
"""

from ..bodies import at_nodes_of, rows_of
from .auto_pairs import FoundPair, FoundPairs, auto_pairs
from .body_boundary import Face
from .closest_points import facets_of, gathered, hits, off_linear, opposite_nodes
from .contact_points import (
    ContactPoints,
    KeptMatrix,
    bounded_gap,
    contact_matrix,
    contact_points,
    free_lengths,
    joined_points,
    nodal_points,
    places_among,
    row_products,
    springs_at,
)
from .facet_patch import facet_patch
from .mortar import MortarRows, mortar_rows
from .near_facets import FaceSamples, NearFace, face_samples, whole_face
from .overlaps import Obstacle, Overlap, Sides, Surface
from .pair import (
    NO_SHAPE,
    Candidates,
    NothingOpposite,
    Pair,
    Shape,
    bulges_at_points,
    clamped_nodes,
    curved_patch,
    held_on_both,
    nodes_at_seams,
    pair_of,
    pair_surface,
    planes_of_symmetry,
    shares,
    slave_side,
    within,
)
from .pair_evidence import Claims, Deviations, PairSamples, Surfaces
from .passages import Ways, inside_of, into_foundation, through_each_other
from .sections import Pretension
from .sectors import refuse_uneven_sectors, refuse_uneven_supports
from .self_contact import two_sides
from .slid_pairs import slid_surface
from .slip import FaceMotion, foot_points
from .surface import (
    NOISE,
    ContactSurface,
    FullyHeld,
    Normals,
    contact_surface,
    distance_along,
    faces_away,
    interpolated_forces,
    joined,
    own_plane,
    plane_of_face,
    with_unknowns,
    without_noise,
)
from .ties import CyclicSymmetry, Tied, with_slaves
