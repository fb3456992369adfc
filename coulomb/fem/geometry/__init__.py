"""Points, motions and surfaces without a mesh: rigid surfaces by their signed distance, rigid motions, frames of
contact points, and values that a user gives as numbers or functions.  Uses numpy alone; `fem.ufl_values` is loaded
where a value is an object of DOLFINx or UFL.
"""

from .contact_frames import (
    HELD_BELOW,
    HELD_BEYOND,
    LEAST_RATIO,
    FrictionAxes,
    friction_frames,
    held_length,
    inverse_frames,
    tangent_frames,
    tangent_lengths,
)
from .obstacles import (
    LEAST_LENGTH,
    Cylinder,
    Plane,
    Point,
    Revolved,
    RigidFoundation,
    RigidMotion,
    Rotation,
    SignedDistance,
    Sphere,
    Spin,
    Turn,
    check_angle,
    check_direction,
    check_point,
    moved,
    rigid_motion,
    same_place,
    since_at,
    spin,
)
from .rotations import rotation_matrix, rotation_vector, turn_by_change
from .triangles import nearest_points
from .user_values import (
    Amplitude,
    Coefficient,
    Field,
    Motion,
    Refused,
    amplitude_entry,
    evaluate_amplitude,
    evaluate_numbers,
    evaluate_signed_numbers,
    evaluate_vectors,
    first_place,
    of_place,
    on_all_ranks,
    on_every_rank,
    same_on_all_ranks,
)
