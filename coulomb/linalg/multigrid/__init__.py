"""Smoothed aggregation for block matrices, and conjugate gradients with recycled directions on top of it."""

from .block_matrix import padded, symmetric_blocks
from .multigrid_cycle import SECOND_ORDER_STEPS, MultigridCycle, Stiffness, multigrid, stiffness_in_blocks
from .recycled_cg import RecycledCG
