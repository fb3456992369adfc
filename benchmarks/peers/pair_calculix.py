"""CalculiX on the two blocks: dual mortar contact, or a penalty between faces, or between nodes and faces.

All elements are fully integrated C3D8, the solver is SPOOLES.  The integrated springs of coulomb are SPRING1 from the
nodes to the ground, each with the area of its hat function, and SPRING2 of negative stiffness between nodes.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from itertools import product

import numpy as np
import scipy.sparse

from ..two_blocks import FRICTION, LOWER, SPRING, TRACTIONS, UPPER, Grid, grid
from .answer import Answer
from .calculix import CONTROLS, numbered, row, run
from .pair import answer

RIGID = 1e20
"""Pressure over penetration and shear stress over elastic slip in Pa/m, of the mortar method: multipliers allow a slope
so large that both are negligible."""

PENALTY = 1e14
"""The same of the penalty between faces: ten times more takes twice the iterations, and changes the displacement by
less than the next finer mesh does."""

NODE_PENALTY = (1e14, 1e12)
"""The same of the penalty between nodes and faces, which does not converge on all meshes where that of the shear
stress is larger."""


def solve_mortar(p: int) -> Answer:
    """TYPE=LINMORTAR, which for linear elements is the same as MORTAR."""
    return _solve(p, "LINMORTAR", RIGID, RIGID, direct=True)


def solve_faces(p: int) -> Answer:
    """TYPE=SURFACE TO SURFACE, to CalculiX's own tolerance."""
    return _solve(p, "SURFACE TO SURFACE", PENALTY, PENALTY, direct=False)


def solve_nodes(p: int) -> Answer:
    """TYPE=NODE TO SURFACE, to CalculiX's own tolerance."""
    return _solve(p, "NODE TO SURFACE", *NODE_PENALTY, direct=False)


def _solve(p: int, kind: str, slope: float, stick: float, direct: bool) -> Answer:
    """Iterations are those of the equilibrium; reading and writing the files is counted."""
    began = time.perf_counter()
    below, above = grid(LOWER, p), grid(UPPER, p)
    job = run(_deck(below, above, kind, slope, stick, direct))
    u = np.empty((len(below.points) + len(above.points), 3))
    u[job.nodes] = job.values
    seconds = time.perf_counter() - began
    first = len(below.points)
    return answer(p, u[:first], u[first:], seconds, job.iterations, job.peak_memory_bytes)


def _deck(below: Grid, above: Grid, kind: str, slope: float, stick: float, direct: bool) -> Iterable[str]:
    nodes, cells = len(below.points), len(below.cells)
    yield from ("*NODE", *numbered(np.concatenate([below.points, above.points])))
    yield from ("*ELEMENT, TYPE=C3D8, ELSET=LOWER", *numbered(below.cells + 1))
    yield from ("*ELEMENT, TYPE=C3D8, ELSET=UPPER", *numbered(above.cells + nodes + 1, cells + 1))
    yield from ("*NSET, NSET=ALL, GENERATE", f"1,{nodes + len(above.points)},1")
    yield from ("*NSET, NSET=FIXED", *(str(node + 1) for node in np.unique(below.faces["bottom"].corners)))
    yield from ("*SURFACE, NAME=SLAVE", *(f"{cells + cell + 1},S1" for cell in above.faces["bottom"].cells))
    yield from ("*SURFACE, NAME=MASTER", *(f"{cell + 1},S2" for cell in below.faces["top"].cells))
    for name, block in (("LOWER", LOWER), ("UPPER", UPPER)):
        yield from (f"*MATERIAL, NAME={name}", "*ELASTIC", row([block.young, block.poisson]))
        yield f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"
    yield from _springs(above.products("left"), nodes + 1, cells + len(above.cells) + 1)
    yield from ("*SURFACE INTERACTION, NAME=CONTACT", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{slope:g}")
    yield from ("*FRICTION", f"{FRICTION},{stick:g}")
    yield from (f"*CONTACT PAIR, INTERACTION=CONTACT, TYPE={kind}", "SLAVE,MASTER", "*BOUNDARY", "FIXED,1,3")
    if direct:
        yield from ("*STEP", "*STATIC, DIRECT", "1.,1.", "*CONTROLS, PARAMETERS=FIELD", CONTROLS)
    else:
        yield from ("*STEP, INC=1000", "*STATIC", "1.,1.")
    load = above.loads(TRACTIONS)
    yield "*CLOAD"
    yield from (f"{nodes + node + 1},{axis + 1},{load[node, axis]:.16g}" for node, axis in np.argwhere(load != 0.0))
    yield from ("*NODE PRINT, NSET=ALL", "U", "*END STEP")


def _springs(products: scipy.sparse.coo_matrix, first_node: int, first_element: int) -> Iterable[str]:
    """A spring from each node to the ground, and one between each two nodes of a facet, in every direction.

    The sum of a row is the stiffness of the first, an entry beside the diagonal minus that of the second; of the two
    lines of data that follow *SPRING only the second has a point.
    """
    areas = np.asarray(products.sum(axis=1)).ravel()
    ground = np.flatnonzero(areas)
    pairs = products.row < products.col
    ends = np.column_stack([products.row, products.col])[pairs]
    springs = ((1, ground[:, None], areas[ground]), (2, ends, -products.data[pairs]))
    for (count, nodes, stiffness), axis in product(springs, (1, 2, 3)):
        sizes, which = np.unique(stiffness.round(12), return_inverse=True)
        for k in range(len(sizes)):
            elements, name = nodes[which == k], f"SPRING{count}{k}{axis}"
            yield f"*ELEMENT, TYPE=SPRING{count}, ELSET={name}"
            yield from numbered(first_node + elements, first_element)
            yield from (f"*SPRING, ELSET={name}", ",".join(count * [str(axis)]), f"{SPRING * sizes[k]:.12e}")
            first_element += len(elements)
