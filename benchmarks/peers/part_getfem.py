"""GetFEM on the deck of a part: `python -m benchmarks.peers.part_getfem DECK AUGMENTATION OUT`.

Integral contact between meshes that do not match, augmented Lagrangian of Alart and Curnier, Newton's method, MUMPS.
Forces and moduli are over the largest Young's modulus.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from coulomb.arrays import FloatArray, IntArray
from coulomb.decks.cards import Card
from coulomb.decks.geometry import Geometry

from .answer import Unsolved
from .pair_getfem import ALART_CURNIER, MOST_STEPS

TOLERANCE = 1e-9
"""Tolerance of GetFEM's relative residual."""

_LEXICOGRAPHIC = {4: [0, 1, 2, 3], 10: [0, 4, 1, 6, 5, 2, 7, 8, 9, 3]}
"""Nodes of tetrahedra, x fastest."""


def solve(path: str, augmentation: float) -> tuple[IntArray, FloatArray, FloatArray]:
    """Numbers of the nodes, their displacements, and the sum of the contact forces on the first slave's body.

    All pairs have the friction of the first.

    Args:
        path: The deck.
        augmentation: Its parameter over the smallest Young's modulus, per millimetre.

    Raises:
        Unsolved: If Newton's method does not converge.
    """
    gf: Any = importlib.import_module("getfem")
    gf.util_trace_level(0)
    deck = Geometry(path)
    cards = {kind: [card for card in deck.others if card.kind == kind] for kind in _KINDS}
    young = max(card.floats([0])[0] for card in cards["ELASTIC"])
    model = gf.Model("real")
    softest = min(card.floats([0])[0] for card in cards["ELASTIC"])
    model.add_initialized_data("r", augmentation * softest / young)
    model.add_initialized_data("friction", cards["FRICTION"][0].floats([0])[0])
    kept, spaces, slaves = [], [], []
    (cells,) = deck.solids.values()
    degree, order = 1 if cells.shape[1] == 5 else 2, 1 + np.array(_LEXICOGRAPHIC[cells.shape[1] - 1])
    numbers = [np.unique(body[:, 1:]) for body in _bodies(cells)]
    for k, body in enumerate(_bodies(cells)):
        mesh, u = gf.Mesh("empty", 3), f"u{k}"
        for nodes in deck.points[deck.places(body[:, order].ravel())].reshape(-1, len(order), 3):
            mesh.add_convex(gf.GeoTrans(f"GT_PK(3,{degree})"), nodes.T)
        space = gf.MeshFem(mesh, 3)
        space.set_fem(gf.Fem(f"FEM_PK(3,{degree})"))
        points = gf.MeshIm(mesh, gf.Integ(f"IM_TETRAHEDRON({3 * degree - 1})"))
        model.add_fem_variable(u, space)
        for j, card in enumerate(cards["SOLIDSECTION"]):
            of = np.flatnonzero(np.isin(body[:, 0], deck.element_sets.members(card.get("ELSET"))))
            if len(of):
                e, nu = _elastic(deck, card.key("MATERIAL"))
                mesh.set_region(100 + j, np.array([of, np.full(len(of), -1)]))
                model.add_initialized_data(f"l{k}{j}", e / young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)))
                model.add_initialized_data(f"m{k}{j}", 0.5 * e / young / (1.0 + nu))
                model.add_isotropic_linearized_elasticity_brick(points, u, f"l{k}{j}", f"m{k}{j}", 100 + j)
        own = numbers[k]
        distance, place = cKDTree(deck.points[deck.places(own)]).query(space.basic_dof_nodes()[:, ::3].T)
        if distance.max() > 1e-6 or len(np.unique(place)) < len(own):
            raise Unsolved("its mesh has other nodes")
        numbers[k] = own[place]
        dofs = {int(node): 3 * dof for dof, node in enumerate(numbers[k])}
        rhs = np.zeros(space.nbdof())
        for node, axis, value in _on_nodes(deck, cards["CLOAD"]):
            if node in dofs:
                rhs[dofs[node] + axis] += value / young
        model.add_explicit_rhs(u, rhs)
        held = {dofs[n] + axis: value for n, axis, value in _on_nodes(deck, cards["BOUNDARY"]) if n in dofs}
        if held:
            B = gf.Spmat("empty", len(held), space.nbdof())
            for row, dof in enumerate(held):
                B.add(row, dof, 1.0)
            model.add_variable(f"reaction{k}", len(held))
            model.add_constraint_with_multipliers(u, f"reaction{k}", B, np.array(list(held.values())))
        spaces.append((mesh, space, points, rhs, held))
        kept += [mesh, space, points]
    for j, card in enumerate(cards["CONTACTPAIR"]):
        faces = 2 * j + 1, 2 * j + 2
        slave, master = map(partial(_region, deck, spaces, numbers), card.words(0)[:2], faces)
        slaves.append(slave)
        stress = gf.MeshFem(spaces[slave][0], 3)
        stress.set_fem(gf.Fem("FEM_PK(3,1)"))
        model.add_filtered_fem_variable(f"stress{j}", stress, faces[0])
        names = f"u{slave}", f"u{master}", f"stress{j}", "r", "friction"
        model.add_integral_contact_between_nonmatching_meshes_brick(spaces[slave][2], *names, *faces, ALART_CURNIER)
        kept.append(stress)
    steps, converged = model.solve(
        "max_res", TOLERANCE, "max_iter", MOST_STEPS, "lsolver", "mumps", "lsearch", "simplest"
    )
    if not converged:
        raise Unsolved(f"not converged in {steps} steps")
    *_, rhs, held = spaces[slaves[0]]
    force = -rhs.reshape(-1, 3).sum(axis=0)
    if held:
        np.add.at(force, np.array(list(held)) % 3, model.variable(f"reaction{slaves[0]}"))
    u = np.concatenate([model.variable(f"u{k}").reshape(-1, 3) for k in range(len(spaces))])
    return np.concatenate(numbers), u, force * young


_KINDS = ("ELASTIC", "SOLIDSECTION", "CLOAD", "BOUNDARY", "CONTACTPAIR", "FRICTION")


def _bodies(cells: IntArray) -> list[IntArray]:
    """The cells of every body that shares no node with others."""
    count = int(cells[:, 1:].max()) + 1
    rows = np.repeat(cells[:, 1], cells.shape[1] - 1)
    graph = scipy.sparse.coo_matrix((np.ones(len(rows)), (rows, cells[:, 1:].ravel())), (count, count))
    label = connected_components(graph, directed=False)[1][cells[:, 1]]
    return [cells[label == one] for one in np.unique(label)]


def _elastic(deck: Geometry, material: str) -> tuple[float, float]:
    here = ""
    for card in deck.others:
        here = card.key("NAME") if card.kind == "MATERIAL" else here
        if card.kind == "ELASTIC" and here == material:
            young, poisson = card.floats([0])[:2]
            return float(young), float(poisson)
    raise Unsolved(f"no material {material}")


def _on_nodes(deck: Geometry, cards: list[Card]) -> Iterator[tuple[int, int, float]]:
    """Node, axis from 0 and value of each line; of *BOUNDARY a later one counts."""
    for card in cards:
        for _, words in card.rows():
            nodes = [int(words[0])] if words[0].isdigit() else deck.node_sets.members(words[0])
            first = int(words[1]) - 1
            if card.kind == "CLOAD":
                last, value = first + 1, float(words[2])
            else:
                last = int(words[2]) if len(words) > 2 and words[2] else first + 1
                value = float(words[3]) if len(words) > 3 else 0.0
            axes = range(first, last)
            yield from ((int(node), axis, value) for node in nodes for axis in axes)


def _region(deck: Geometry, spaces: list[Any], numbers: list[IntArray], name: str, region: int) -> int:
    """The body of a surface, whose facets become a region of its mesh."""
    nodes = deck.node_sets.members(name)
    (k,) = [k for k, own in enumerate(numbers) if np.all(np.isin(nodes, own))]
    mesh = spaces[k][0]
    points = mesh.pts().T
    near, _ = cKDTree(deck.points[deck.places(nodes)]).query(points)
    chosen = {tuple(face) for face in mesh.faces_from_pid(mesh.pid()[np.flatnonzero(near < 1e-6)]).T}
    outer = mesh.outer_faces()
    mesh.set_region(region, outer[:, [tuple(face) in chosen for face in outer.T]])
    return k


if __name__ == "__main__":
    try:
        _numbers, _u, _force = solve(sys.argv[1], float(sys.argv[2]))
    except Unsolved as error:
        sys.exit(str(error))
    np.savez(sys.argv[3], numbers=_numbers, u=_u, force=_force)
