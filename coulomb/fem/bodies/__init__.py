"""An elastic body: its space, materials, loads, supports and temperature, or the user's own forms; the stiffness
matrix K, the load f, and the nodal forces of a displacement.  Several bodies are joined into one.
"""

from .body import STRESSES, ElasticBody, cell_measure, varying_signs
from .compiled_form import compiled
from .conduction import Conduction, HeatLoad
from .constraint_transposes import owed_before, owed_to_motions
from .constraints import (
    HELD_OBLIQUE,
    HeldDirections,
    HeldNodes,
    Nodes,
    Numbering,
    at_nodes_of,
    block_diagonal,
    diagonal_of,
    distributed_rows,
    local_rows,
    matrix_product,
    rows_of,
)
from .deformable import Deformable, Member, SingleBody
from .displacement_space import DisplacementSpace, free_earlier_bodies
from .elasticity import Elasticity, LoadedBody, largest_poisson, locking_by_volume
from .elimination import AddedSprings
from .equations import Equation, Equations
from .finite_motions import FiniteMotion
from .form_body import BilinearForm, FormBody, FormValues
from .free_motions import (
    FreeMotion,
    FreeMotions,
    OpenedPart,
    free_motions,
    least_energy,
    motions_in_words,
    names_of_components,
    together,
)
from .hyperelastic import HyperelasticBody
from .joined_bodies import JoinedBodies, build_bodies, distributed_bodies, join
from .lasting_supports import End, LastingConstraint, act_together
from .linear_constraints import TIE_STRESSES, Constraints
from .loads import (
    TEMPERATURE,
    AppliedLoad,
    Load,
    Loading,
    NodalForce,
    NodalForces,
    NodeTemperatures,
    PointLoad,
    Pressure,
    Temperature,
    Temperatures,
    ThermalLoad,
    TotalForce,
    Traction,
    VolumeForce,
    load_title,
    range_of,
    shown_range,
    vanishes,
)
from .located_points import LocatedPoints, locate
from .materials import (
    COORDINATE_AXES,
    EXPANSION,
    FIELDS,
    ISOTROPIC,
    ORTHOTROPIC,
    ORTHOTROPIC_EXPANSION,
    VECTORS,
    AnyMaterial,
    CellMaterials,
    Material,
    Materials,
    OrthotropicMaterial,
    by_group,
    material_of_cells,
    midpoints,
)
from .mean_dilatation import LOCKING_ABOVE
from .mesh_components import mesh_components, unjoined_parts
from .nonlinear_body import Body, NonlinearBody, nonlinear
from .recovery import StressedCells, StressError, relative_error, stress_error, stress_errors
from .rigid_faces import RigidFace
from .rigid_modes import (
    RigidPart,
    component_modes,
    direction_in_words,
    displacements_of,
    null_space,
    of_components,
    of_part,
    rigid_modes,
    turn_of,
)
from .slice_supports import rigid_faces_of_slices, supports_of_slices
from .stress_difference import StressDifference, stress_difference
from .supports import Clamp, PrescribedDisplacement, PrescribedRotation, Spring, Support, SymmetryPlane
from .ties import Bolt, Follower, GivenBolt, Section, Tie
