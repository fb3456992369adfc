"""An elastic body: its space, materials, loads, supports and temperature, or the user's own forms; the stiffness
matrix K, the load f, and the nodal forces of a displacement.  Several bodies are joined into one.
"""

from .body import LOCKING_ABOVE, STRESSES, ElasticBody, Material
from .constraints import HELD_OBLIQUE, HeldDirections, HeldNodes, Nodes, distributed_rows
from .deformable import Deformable, Loading, Member, SingleBody
from .displacement_space import DisplacementSpace
from .distributed_bodies import distributed_bodies, made
from .elasticity import Elasticity
from .form_body import Body
from .free_motions import FreeMotion, motions_in_words
from .joined_bodies import JoinedBodies, join
from .loaded_body import LoadedBody
from .loads import AppliedLoad, Load, NodalForces, Pressure, TotalForce, Traction, named, vanishes
from .located_points import LocatedPoints, locate
from .materials import AnyMaterial, Materials, by_group, midpoints
from .mesh_components import unjoined_parts
from .orthotropic import (
    COORDINATE_AXES,
    EXPANSION,
    FIELDS,
    ISOTROPIC,
    ORTHOTROPIC,
    ORTHOTROPIC_EXPANSION,
    VECTORS,
    CellMaterials,
    OrthotropicMaterial,
)
from .rigid_modes import component_modes, direction_in_words, in_units, null_space, of_components, of_part, rigid_modes
from .supports import Clamp, PrescribedDisplacement, PrescribedRotation, Spring, Support, SymmetryPlane
from .temperature import TEMPERATURE, Temperature, ThermalLoad, range_of

__all__ = [
    "COORDINATE_AXES",
    "EXPANSION",
    "FIELDS",
    "HELD_OBLIQUE",
    "ISOTROPIC",
    "LOCKING_ABOVE",
    "ORTHOTROPIC",
    "ORTHOTROPIC_EXPANSION",
    "STRESSES",
    "TEMPERATURE",
    "VECTORS",
    "AnyMaterial",
    "AppliedLoad",
    "Body",
    "CellMaterials",
    "Clamp",
    "Deformable",
    "DisplacementSpace",
    "ElasticBody",
    "Elasticity",
    "FreeMotion",
    "HeldDirections",
    "HeldNodes",
    "JoinedBodies",
    "Load",
    "LoadedBody",
    "Loading",
    "LocatedPoints",
    "Material",
    "Materials",
    "Member",
    "NodalForces",
    "Nodes",
    "OrthotropicMaterial",
    "PrescribedDisplacement",
    "PrescribedRotation",
    "Pressure",
    "SingleBody",
    "Spring",
    "Support",
    "SymmetryPlane",
    "Temperature",
    "ThermalLoad",
    "TotalForce",
    "Traction",
    "by_group",
    "component_modes",
    "direction_in_words",
    "distributed_bodies",
    "distributed_rows",
    "in_units",
    "join",
    "locate",
    "made",
    "midpoints",
    "motions_in_words",
    "named",
    "null_space",
    "of_components",
    "of_part",
    "range_of",
    "rigid_modes",
    "unjoined_parts",
    "vanishes",
]
