"""Supports on sets of nodes, on edges and at points, by uniform stresses and by faces with the same nodes.

On any number of ranks: run alone, or as `mpirun -n 3 python -m pytest ...`.
"""

import numpy as np
import pytest
from conftest import STEEL
from mpi4py import MPI
from ranks import same_error

import coulomb
from coulomb import Clamp, Elasticity, Plane, PrescribedDisplacement, PrescribedRotation, SymmetryPlane, Traction
from coulomb.case.case import Case
from coulomb.fem.meshes import refined
from coulomb.solvers import DirectSolver, IterativeSolver

comm = MPI.COMM_WORLD
SIZE = (1.0, 0.8, 0.6)
TURN = np.linalg.qr(np.random.default_rng(7).standard_normal((3, 3)))[0]


def solved(elasticity, solver=DirectSolver):
    """Displacement (k, 3), and the resultant (3,) of every support over all ranks."""
    loading = elasticity.at(0.0)
    f, u = elasticity.f(loading), elasticity.K.createVecRight()
    solver(elasticity.K).solve(f, u)
    values = u.array.reshape(-1, 3).copy()
    residual = elasticity.internal_force(values) - loading.load
    shares = elasticity.shares(elasticity.held.held_part(residual))
    return values, [comm.allreduce(share.forces.sum(axis=0)) for share in shares]


def largest(values):
    return max(comm.allgather(float(np.max(np.abs(values), initial=0.0))))


@pytest.mark.parametrize("solver", [DirectSolver, IterativeSolver])
@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 1), ("tetrahedron", 2)])
def test_three_points_hold_a_bar_in_tension_without_a_force(cell, degree, solver):
    mesh = coulomb.box(SIZE, (3, 2, 2), cell, degree=degree)
    mesh = mesh.with_nodes("origin", at=(0.0, 0.0, 0.0)).with_nodes("on x", at=(1.0, 0.0, 0.0))
    mesh = mesh.with_nodes("on y", at=[(0.0, 0.8, 0.0)])
    supports = [Clamp("origin"), Clamp("on x", "yz"), Clamp("on y", "z")]
    s, (E, nu) = 1e7, (STEEL.young, STEEL.poisson)
    pull = [Traction("right", (s, 0.0, 0.0)), Traction("left", (-s, 0.0, 0.0))]
    body = Elasticity(mesh, STEEL, supports, pull)
    u, shares = solved(body, solver)
    exact = body.x * np.array([s / E, -nu * s / E, -nu * s / E])
    assert largest(u - exact) <= 1e-8 * s / E
    assert np.max(np.abs(shares)) <= 1e-6 * s * 0.48


@pytest.mark.parametrize("degree", [1, 2])
def test_a_set_with_the_nodes_of_a_face_holds_as_the_face_does(degree):
    mesh = coulomb.box(SIZE, (3, 2, 2), "hexahedron", degree=degree)
    mesh = mesh.with_nodes("start", at=lambda x: x[0] < 1e-9).with_nodes("end", at=lambda x: x[0] > 1.0 - 1e-9)
    value = (1e-3, 0.0, 2e-3)
    answers = []
    for one, other in (("left", "right"), ("start", "end")):
        body = Elasticity(mesh, STEEL, [Clamp(one), PrescribedDisplacement(other, value, "xz")])
        answers.append(solved(body))
    (u, shares), (of_sets, shares_of_sets) = answers
    assert largest(u) > 1e-3 and largest(u - of_sets) <= 1e-12 * largest(u)
    assert np.allclose(shares, shares_of_sets, rtol=1e-9, atol=1e-9 * np.max(np.abs(shares)))
    assert [one["face"] for one in body.support_entries()] == ["start", "end"]


def test_nodes_in_a_plane_and_on_an_axis():
    """Symmetry of nodes in an oblique plane; a rotation of edges and a guide along a plane, of nodes that all move as a
    rigid body."""
    turned = coulomb.box(SIZE, (3, 2, 2), place=lambda x: TURN @ x).with_nodes(
        "start", at=lambda x: (TURN.T @ x)[0] < 1e-9
    )
    held, expected = (Elasticity(turned, STEEL, [SymmetryPlane(face)]).held for face in ("start", "left"))
    assert np.array_equal(held.nodes, expected.nodes) and largest(held.projector - expected.projector) <= 1e-12
    guided = Elasticity(
        turned, STEEL, [Clamp("start", "normal", surface=Plane((0.0, 0.0, 0.0), tuple(TURN[:, 0])))]
    ).held
    assert largest(guided.projector - expected.projector) <= 1e-12
    edges = coulomb.box(SIZE, (3, 2, 2)).with_nodes("edges", at=lambda x: np.abs(x[1] - 0.4) > 0.4 - 1e-9)
    body = Elasticity(edges, STEEL, [PrescribedRotation("edges", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1e-3)])
    u, _ = solved(body)
    assert largest(u - 1e-3 * np.cross((0.0, 0.0, 1.0), body.x)) <= 1e-10


def test_numbers_are_those_of_the_file(tmp_path):
    mesh = coulomb.box(SIZE, (3, 2, 2))
    number = np.asarray(mesh.domain.geometry.input_global_indices)
    wanted = np.unique(np.concatenate(comm.allgather(number[mesh.domain.geometry.x[:, 0] < 1e-9])))
    body = Elasticity(mesh.with_nodes("start", numbers=wanted), STEEL, [Clamp("start")])
    assert np.array_equal(body.held.nodes, Elasticity(mesh, STEEL, [Clamp("left")]).held.nodes)


@pytest.mark.parametrize("degree", [1, 2])
def test_every_node_has_the_force_of_its_number(degree):
    """In the order in which they are given; and nodes with the same first four numbers are not the same ones."""
    mesh = coulomb.box(SIZE, (3, 2, 2), degree=degree)
    number = np.asarray(mesh.domain.geometry.input_global_indices)
    pairs = np.concatenate(comm.allgather(np.column_stack([number, mesh.domain.geometry.x])))
    chosen = pairs[np.unique(pairs[:, 0], return_index=True)[1]][::-2]
    numbers, x = chosen[:, 0].astype(int).tolist(), chosen[:, 1:]
    each = {"nodes": numbers, "force": (x @ np.diag([1.0, -2.0, 3.0])).tolist()}
    box = {"box": SIZE, "cells": (3, 2, 2), "degree": degree}
    same = [{"nodes": numbers[:4] + numbers[4 + k : 24 : 2], "force": [0.0, 0.0, 1.0 + k]} for k in (0, 1)]
    case = Case.model_validate(
        {
            **{"mesh": box, "material": {"young": 1e9, "poisson": 0.3}, "contact": {"face": "bottom", "friction": 0.1}},
            "nodal_force": [each, *same],
        }
    )
    body = case.problem(comm).body.elasticity
    all_of_them = np.isin(np.round(body.x, 9), np.round(x, 9)).all(axis=1)
    forces, *others = (applied.nodal_force for applied in body.loads)
    here = np.linalg.norm(forces, axis=1) > 0.0
    assert np.allclose(forces[here], body.x[here] * [1.0, -2.0, 3.0]) and not np.any(here & ~all_of_them)
    assert np.allclose(comm.allreduce(forces.sum(axis=0)), x.sum(axis=0) * [1.0, -2.0, 3.0])
    for given, other in zip(same, others, strict=True):
        places = x[[numbers.index(node) for node in given["nodes"]]]
        moment = comm.allreduce(np.cross(body.x, other).sum(axis=0))
        assert np.allclose(moment, np.cross(places.sum(axis=0), given["force"]))


def test_a_node_set_of_a_file_that_is_no_face(tmp_path):
    path = comm.bcast(str(tmp_path / "tetrahedron.inp"))
    if comm.rank == 0:
        (tmp_path / "tetrahedron.inp").write_text(
            "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n9,5,5,5\n*ELEMENT,TYPE=C3D4\n1,1,2,3,4\n"
            "*NSET,NSET=base\n1,2,3\n*NSET,NSET=edge\n1,4\n*NSET,NSET=stray\n1,9\n*NSET,NSET=tip\n4\n"
        )
    comm.barrier()
    mesh = coulomb.read_mesh(path)
    assert sorted(mesh.node_sets) == ["edge", "stray", "tip"] and list(mesh.faces) == ["base"]
    assert np.allclose(mesh.domain.geometry.x[mesh.node_sets["stray"]], 0.0)  # node 9 is of no cell
    body = Elasticity(mesh, STEEL, [Clamp("edge", "xy"), PrescribedDisplacement("tip", (0.0, 0.0, 1e-3), "z")])
    held = np.column_stack([body.x[body.held.nodes], np.einsum("kii->ki", body.held.projector)])
    found = sorted((tuple(one[:3]), tuple(one[3:])) for one in np.concatenate(comm.allgather(held)).tolist())
    assert found == [((0.0, 0.0, 0.0), (1.0, 1.0, 0.0)), ((0.0, 0.0, 1.0), (1.0, 1.0, 1.0))]


def test_of_several_bodies_each_has_its_sets():
    upper = coulomb.moved(coulomb.box(SIZE, (3, 2, 2)), (0.0, 0.0, 0.6)).with_nodes("corner", at=(0.0, 0.0, 1.2))
    problem = coulomb.ContactProblem(
        coulomb.join(lower=coulomb.box(SIZE, (3, 2, 2)), upper=upper),
        STEEL,
        [
            Clamp("lower:bottom"),
            PrescribedDisplacement("upper:top", (0.0, 0.0, -1e-3), "z"),
            Clamp("upper:corner", "xy"),
        ]
        + [Clamp("upper:right", "y")],
        contact=coulomb.Contact("upper:bottom", against="lower:top", friction=0.3),
    )
    solution = problem.solve()
    assert solution.certificate.passed
    assert [one.face for one in solution.reactions if one.kind == "clamp"][1] == "upper:corner"


def test_wrong_sets_of_nodes():
    box = coulomb.box(SIZE, (3, 2, 2))
    line = box.with_nodes("edge", at=lambda x: x[0] + x[1] < 1e-9)
    assert "no node at x = 0.5, 0.1, 0" in same_error(lambda: box.with_nodes("a", at=(0.5, 0.1, 0.0)))
    assert "1 of its 2 nodes belong to no cell" in same_error(lambda: box.with_nodes("a", numbers=[0, 99]))
    assert "has no nodes" in same_error(lambda: box.with_nodes("a", at=lambda x: x[0] > 9.0))
    assert "not that of a face" in same_error(lambda: box.with_nodes("left", at=(0.0, 0.0, 0.0)))
    assert "either" in same_error(lambda: box.with_nodes("a"))
    assert "on a line" in same_error(lambda: Elasticity(line, STEEL, [SymmetryPlane("edge")]))
    assert "no normals" in same_error(lambda: Elasticity(line, STEEL, [Clamp("edge", "normal")]))
    two = box.with_nodes("a", at=[(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.8, 0.0), (0.0, 0.0, 0.6)])
    assert "must be in a plane" in same_error(lambda: Elasticity(two, STEEL, [SymmetryPlane("a")]))
    assert "set of nodes" in same_error(lambda: Elasticity(line, STEEL, [], [Traction("edge", (1.0, 0.0, 0.0))]))
    for other in (coulomb.second_order(line), refined(line)):
        assert "name the nodes of this one" in same_error(lambda other=other: Elasticity(other, STEEL, [Clamp("edge")]))
