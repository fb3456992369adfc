"""Orthotropic and heated bodies on any number of ranks: run alone, or as `mpirun -n 3 python -m pytest ...`."""

import numpy as np
import pytest
from mpi4py import MPI
from ranks import by_place, everywhere, same_error
from shared_problems import PLATE, WOUND

import coulomb
from coulomb import Clamp, Contact, ContactProblem, NodalField
from coulomb.fem import compat
from coulomb.fem.bodies.materials import midpoints
from coulomb.io import output
from coulomb.recheck import check

comm = MPI.COMM_WORLD


def field():
    """A temperature with a mesh of its own."""
    domain = coulomb.box((1.0, 0.6, 0.5), (3, 2, 2), "tetrahedron", MPI.COMM_SELF).domain
    x = domain.geometry.x
    return NodalField(x, compat.cell_geometry(domain).astype(np.int64), 20.0 + 30.0 * x[:, 0] * x[:, 2])


def problem(cell, degree, ranks, **options):
    whole = coulomb.box((1.0, 0.6, 0.5), (3, 2, 2), cell, ranks, degree=degree)
    z = midpoints(whole.domain)[: whole.domain.topology.index_map(3).size_local, 2]
    groups = {"plate": np.flatnonzero(z > 0.25).astype(np.int32), "wound": np.flatnonzero(z < 0.25).astype(np.int32)}
    return ContactProblem(
        coulomb.NamedMesh(whole.domain, whole.faces, groups),
        {"plate": PLATE, "wound": WOUND},
        [Clamp("top")],
        Contact(
            "bottom",
            (0.3, 0.2),
            direction=(1.0, 0.5, 0.0),
            foundation=coulomb.Plane((0.0, 0.0, 1e-4), (0.0, 1e-5, 1.0)),
            cohesion=1e4,
        ),
        **{"temperature": field(), "reference_temperature": 15.0, **options},
    )


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
@pytest.mark.ranks
def test_two_materials_with_a_temperature_field(cell, degree, tmp_path_factory):
    alone, together = (problem(cell, degree, ranks).solve(1e-10) for ranks in (MPI.COMM_SELF, comm))
    expected = by_place(alone.problem.elasticity.x, alone.displacement)
    found = by_place(everywhere(together.problem.elasticity.x), everywhere(together.displacement))
    assert together.certificate.passed and np.any(alone.contact_force[0::3] > 0.0)
    assert np.abs(found - expected).max() <= 1e-8 * np.abs(expected).max()
    folder = comm.bcast(tmp_path_factory.mktemp("run") if comm.rank == 0 else None)
    output.write(together, folder)
    assert not check(folder, together.problem).faults and not check(folder, alone.problem).faults


def test_faults_are_errors_on_all_ranks():
    def hot(x):
        return np.where(x[0] > 0.9, np.nan, 20.0)

    assert "not finite" in same_error(lambda: problem("hexahedron", 1, comm, temperature=hot))
    small = NodalField(field().points * [0.7, 1.0, 1.0], field().tetrahedra, field().values)
    assert "does not cover the body" in same_error(lambda: problem("hexahedron", 1, comm, temperature=small))
