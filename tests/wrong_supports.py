"""Wrong supports: clamps along directions, planes of symmetry, rotations."""

import numpy as np
from wrong_input import Wrong, part, run


def corner(file):
    """Two sides at right angles as one face."""
    file.faces["corner"] = np.concatenate([file.faces["left"], file.faces["front"]])


SUPPORTS = (
    Wrong(
        "a clamp along components and a direction",
        run("clamp=[{face='left', components='x', direction=[1,1,0]}]"),
        r"clamp\.0 = .*: give components or direction, one of the two",
    ),
    Wrong(
        "a clamp along no direction",
        run("clamp=[{face='left', direction=[0,0,0]}]"),
        r"clamp\.0\.direction = \[0, 0, 0\]: must not be zero",
    ),
    Wrong(
        "a clamp along no component",
        run("clamp=[{face='left', components='normals'}]"),
        r"clamp\.0\.components = 'normals': should be .* 'normal' or 'tangential'",
    ),
    Wrong(
        "a plane of symmetry that is curved",
        run("clamp=[]", "symmetry=[{face='corner'}]"),
        r"symmetry plane on 'corner': the face must be plane, but its nodes are up to",
        part(corner),
    ),
    Wrong(
        "a guide around a corner",
        run("clamp=[{face='corner', components='normal'}]"),
        r"clamp on 'corner': the face has an edge at x = .*, and no normal there",
        part(corner),
    ),
    Wrong(
        "a contact face that is nearly held",
        run(
            "clamp=[{face='left'},{face='right',components='x'}]",
            "contact.foundation={point=[0,0,0], normal=[1,0,0.005]}",
        ),
        r"is held at less than 0\.6 degrees to the foundation's normal: hold it along the normal, or not",
    ),
    Wrong(
        "a rotation about no axis",
        run("prescribed_rotation=[{face='right', point=[0,0,0], axis=[0,0,0], angle=0.1}]"),
        r"prescribed_rotation\.0\.axis = \[0, 0, 0\]: must not be zero",
    ),
    Wrong(
        "a rotation in time without a history",
        run("prescribed_rotation=[{face='right', point=[0,0,0], axis=[0,0,1], angle=0.1, amplitude=[[0,0],[1,1]]}]"),
        r"prescribed_rotation\.0\.amplitude depends on time: it needs a \[history\]",
    ),
)
