"""The estimated error of the stress on any number of ranks: run alone, or as `mpirun -n 3 python -m pytest ...`."""

import numpy as np
import pytest
from mpi4py import MPI
from ranks import by_place, everywhere, same_error
from shared_problems import PLATE, WOUND

import coulomb
from coulomb import Clamp, Elasticity, NamedMesh
from coulomb.fem.bodies.loads import ThermalLoad
from coulomb.fem.bodies.materials import midpoints
from coulomb.fem.bodies.recovery import relative_error, stress_errors
from coulomb.fem.compat import ufl

comm = MPI.COMM_WORLD


def body(ranks, cell, degree, heat):
    """Of two materials, one of them at one end only, so that not every rank has cells of it."""
    mesh = coulomb.box((2.0, 0.6, 0.5), (6, 3, 2), cell, ranks, degree=degree)
    end = midpoints(mesh.domain)[: mesh.domain.topology.index_map(3).size_local, 0] < 0.5
    groups = {"plate": np.flatnonzero(~end).astype(np.int32), "wound": np.flatnonzero(end).astype(np.int32)}
    materials = {"plate": PLATE, "wound": WOUND}
    return Elasticity(NamedMesh(mesh.domain, mesh.faces, groups), materials, [Clamp("left")], thermal=heat)


def errors(ranks):
    """Of two joined bodies, with places of the cells of each."""
    heat = ThermalLoad(lambda x: 20.0 + 30.0 * x[0] * x[2], 15.0)
    both = coulomb.join(one=body(ranks, "hexahedron", 1, heat), two=body(ranks, "tetrahedron", 2, None))
    u = 1e-3 * np.sin(both.x @ [[1.0, 0.5, 0.2], [0.0, 1.0, 1.0], [0.3, 0.0, 1.0]])
    found = stress_errors(both, u, both.at(1.0).temperature.change)
    places = {member.name: midpoints(member.body.domain)[: len(found[member.name].squared)] for member in both.members}
    return found, places


@pytest.mark.ranks
def test_errors_of_cells_are_those_of_one_rank():
    (alone, at), (together, here) = errors(MPI.COMM_SELF), errors(comm)
    assert relative_error(together.values()) == pytest.approx(relative_error(alone.values()), rel=1e-10)
    for name in ("one", "two"):
        for what in ("squared", "volume", "stress"):
            expected = by_place(at[name], getattr(alone[name], what))
            found = by_place(everywhere(here[name]), everywhere(getattr(together[name], what)))
            assert found == pytest.approx(expected, rel=1e-8), (name, what)
        assert together[name].norm == pytest.approx(alone[name].norm, rel=1e-12)


def test_a_body_of_forms_is_an_error_on_all_ranks():
    V = body(comm, "hexahedron", 1, None).V
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    own = coulomb.Body(ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx + ufl.inner(u, v) * ufl.dx)
    assert "from your own forms" in same_error(lambda: stress_errors(own, np.zeros_like(own.x)))
