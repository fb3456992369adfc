"""A block drawn over a plane until it slides, and back: friction is F times the normal force, not about that.

A cube of 1 m of steel stands on a rigid plane.  Its top, held flat, is pressed down by 0.2 mm, then drawn to the right
by s(t), and back.  Friction grows while the block shears, node after node slips, and from then on, by Coulomb's law
summed over the nodes, all of which slip the same way,

    T = -F N sign(ds/dt)

whatever the mesh.  Sliding by ds dissipates F N ds; after the reversal the block sticks at first, and the force falls
as steeply as if its base were bonded to the plane; sliding back, all is the mirror image of sliding forth.

The slip of a step is taken with the friction of its end (backward Euler).  Where the force changes along the step by dT,
this errs by dT ds/2: summed over the n steps of a history, energy errs in proportion to 1/n.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ... import output
from ...arrays import FloatArray
from ...fem.body import Material
from ...fem.elasticity import Clamp, Elasticity
from ...fem.meshes import box
from ...load_history import LoadHistory, LoadStep
from ...problem import Contact, ContactProblem
from ...solvers.stiffness import DirectSolver
from .table import Curve, Panel, Verified, absolute, order, relative

STEEL = Material(young=2.1e11, poisson=0.3)
FRICTION, DOWN = 0.3, 2e-4
CELLS = (6, 6, 6)
RESIDUAL = 1e-10

WAY = ((0.0, 0.0), (1.0, 0.0), (2.0, 4e-4), (3.0, 4e-2), (4.0, 8e-2), (5.0, 7.96e-2), (6.0, 4e-2), (7.0, 0.0))
"""Way of the top along x in metres: pressed down until t = 1, drawn right until 4, then left."""
