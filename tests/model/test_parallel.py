"""Tests for any number of ranks: run alone, or as `mpirun -n 3 python -m pytest tests/model/test_parallel.py`."""

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import STEEL, indentation, make_block, reference
from mesh_files import BoxFile
from mpi4py import MPI
from ranks import everywhere, same_error
from synthetic_evidence import BODY, CASES, CONTACT, synthetic_evidence

import coulomb
from coulomb import Clamp, Contact, ContactProblem, InteriorPoint, PrescribedDisplacement
from coulomb.fem.bodies.constraints import HeldDirections
from coulomb.io import output
from coulomb.io.summary import summary
from coulomb.linalg.reductions import Reductions
from coulomb.model.certificate import judge
from coulomb.solvers import CondensedSystem, FrictionProblem, IterativeSolver

comm = MPI.COMM_WORLD


@pytest.fixture(scope="module")
def shared_directory(tmp_path_factory):
    """One directory for all ranks."""
    return comm.bcast(tmp_path_factory.mktemp("shared") if comm.rank == 0 else None)


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.parametrize("p", [6, 10])
def test_block_against_the_independent_solver(p, law):
    totals, fields = reference(p, law)
    solution = make_block(p, slip_stress=1e7 if law == "tresca" else None).solve()
    surface = solution.problem.surface
    force = everywhere(-surface.vectors(solution.contact_force.reshape(-1, 3)))
    x, area = everywhere(surface.x), everywhere(surface.area)
    order, mine = np.lexsort(fields["contact_coordinates"].round(9).T), np.lexsort(x.round(9).T)
    expected = fields["force_on_body"][order]
    assert len(x) == totals["contact_nodes"]  # every node on exactly one rank
    assert np.linalg.norm(force[mine] - expected) <= 1e-6 * np.linalg.norm(expected)
    assert np.allclose(area[mine], fields["area"][order], rtol=1e-10)
    result = summary(solution)
    assert result["certificate"]["passed"]
    assert [result["nodes"][k] for k in ("open", "stick", "slip")] == [totals[k] for k in ("open", "stick", "slip")]
    on_body, along = result["force_on_body"], totals["tangential_force_on_body_N"]
    assert on_body["normal"] == pytest.approx(totals["total_normal_force_N"], rel=1e-6)
    assert np.linalg.norm(np.subtract(on_body["tangential"], along)) <= 1e-6 * np.linalg.norm(along)
    assert result["maximum"]["contact_pressure"] == pytest.approx(totals["max_contact_pressure_Pa"], rel=1e-6)
    assert result["maximum"]["displacement"] == pytest.approx(totals["max_displacement_m"], rel=1e-6)
    assert len(set(comm.allgather(json.dumps(result["force_on_body"])))) == 1


@pytest.mark.parametrize(("name", "error", "options"), CASES)
@pytest.mark.ranks
def test_the_certificate_does_not_depend_on_the_partition(name, error, options):
    """Each rank has its nodes, the last one none."""
    evidence, turnover = synthetic_evidence(**options)
    wrong = error(evidence, 1e-6, turnover)
    part = slice(comm.rank, None, max(comm.size - 1, 1)) if comm.rank + 1 < max(comm.size, 2) else slice(0, 0)
    shared = {k: v[part] for k, v in vars(wrong).items() if np.ndim(v) and len(v) in (BODY, CONTACT)}
    shared["held"] = HeldDirections.of_fields(1.0 * wrong.held.components[part], None)
    alone, together = judge(wrong), judge(replace(wrong, comm=comm, **shared))
    for one, other in zip(alone.checks, together.checks, strict=True):
        assert other.value == pytest.approx(one.value, rel=1e-3, abs=1e-3 * one.limit), one.name


@pytest.mark.parametrize("newton", ["default", "condensed"])
@pytest.mark.parametrize("law", ["coulomb", "tresca"])
@pytest.mark.ranks
def test_same_forces_on_any_number_of_ranks(law, newton):
    """Multigrid, matrix-free: to 1e-8 of what one rank gets by factorisation (each rank solves that for itself)."""

    given = {"slip_stress": 1e7 if law == "tresca" else None}
    solver = InteriorPoint(1e-10, newton=CondensedSystem()) if newton == "condensed" else None
    alone = make_block(3, comm=MPI.COMM_SELF, **given).solve(1e-10)
    together = make_block(3, linear_solver=IterativeSolver, explicit=False, **given).solve(1e-10, solver)
    expected = alone.contact_force.reshape(-1, 3)[np.lexsort(alone.problem.surface.x.round(9).T)]
    x = everywhere(together.problem.surface.x)
    force = everywhere(together.contact_force.reshape(-1, 3))[np.lexsort(x.round(9).T)]
    assert np.linalg.norm(force - expected) <= 1e-8 * np.linalg.norm(expected)


@pytest.mark.parametrize(
    "options", [{}, {"linear_solver": IterativeSolver, "explicit": False}], ids=["default", "multigrid"]
)
@pytest.mark.ranks
def test_same_history_on_any_number_of_ranks(options):
    """A ball pressed in and dragged along: frames turn, slip counts from step to step, energies add up, to 1e-8."""
    alone, history = indentation(comm=MPI.COMM_SELF)
    together, _ = indentation(comm=comm, **options)
    for expected, step in zip(history.steps(alone), history.steps(together), strict=True):
        one, many = expected.solution, step.solution
        forces = one.problem.surface.vectors(one.contact_force.reshape(-1, 3))
        forces = forces[np.lexsort(one.problem.surface.x.round(9).T)]
        surface = many.problem.surface
        mine = everywhere(surface.vectors(many.contact_force.reshape(-1, 3)))
        mine = mine[np.lexsort(everywhere(surface.x).round(9).T)]
        assert np.linalg.norm(mine - forces) <= 1e-8 * np.linalg.norm(forces)
        row, known = step.row, expected.row
        for name in ("normal_force", "moment_x", "contact_area", "energy_foundation", "energy_elastic"):
            assert row[name] == pytest.approx(known[name], rel=1e-8)
        assert row["energy_dissipated"] == pytest.approx(known["energy_dissipated"], abs=1e-8 * known["energy_elastic"])
        assert len(set(comm.allgather(json.dumps(row)))) == 1


def test_a_function_that_fails_on_one_rank_fails_on_all():
    """Without an agreement before the next collective call this hangs."""

    def fails(x):
        if comm.rank == comm.size - 1:
            raise RuntimeError("not today")
        return 0.3 + 0.0 * x

    mesh, held = coulomb.box((3.0, 1.0, 1.0), (12, 3, 3)), [Clamp("left")]
    friction = Contact("bottom", lambda x: fails(x)[0])
    assert "friction: not today" in same_error(lambda: ContactProblem(mesh, STEEL, held, friction))
    load = [coulomb.Traction("top", fails)]
    text = same_error(lambda: ContactProblem(mesh, STEEL, held, Contact("bottom", 0.3), load))
    assert "traction on 'top': not today" in text


def test_a_rank_without_contact_nodes():
    """A tall column touches on its small end: of several ranks, one has no contact node."""
    problem = ContactProblem(
        coulomb.box((1.0, 1.0, 12.0), (2, 2, 24)),
        STEEL,
        [PrescribedDisplacement("top", (0.0, 0.0, -1e-3))],
        Contact("bottom", friction=0.3),
    )
    nodes = comm.allgather(len(problem.surface.nodes))
    assert sum(nodes) == 9
    assert comm.size == 1 or min(nodes) == 0
    solution = problem.solve()
    assert solution.certificate.passed
    condensed = ContactProblem(
        problem.mesh, STEEL, [PrescribedDisplacement("top", (0.0, 0.0, -1e-3))], problem.contacts, explicit=False
    ).solve(solver=InteriorPoint(newton=CondensedSystem()))
    assert condensed.certificate.passed
    # a column between two plates, free to bulge: a force between those of free and of hindered bulging
    force = Reductions(comm).sum(solution.contact_force[0::3])
    E, nu = STEEL.young, STEEL.poisson
    hindered = (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    assert E * 1e-3 / 12.0 < force < hindered * E * 1e-3 / 12.0


def test_ranks_without_cells(shared_directory):
    """A body of one cell: the other ranks have no cells, and still take part in writing."""
    problem = ContactProblem(coulomb.box((1, 1, 1), (1, 1, 1)), STEEL, [Clamp("top")], Contact("bottom", friction=0.3))
    output.write(problem.solve(), shared_directory)


def test_output_is_written_by_all_ranks(shared_directory):
    solution = make_block(4).solve()
    contents = output.write(solution, shared_directory / "run")
    assert len(set(comm.allgather(json.dumps(contents)))) == 1
    if comm.rank == 0:
        from check_runs import read_grid

        body, contact = (read_grid(shared_directory / "run" / f"{name}.xdmf") for name in ("solution", "contact"))
        assert len(body.points) == 13 * 5 * 5 and len(contact.points) == 13 * 5
        area = 1.0 / 16 * np.where(np.isin(contact.points[:, 1].round(9), (0.0, 1.0)), 0.5, 1.0)
        area *= np.where(np.isclose(contact.points[:, 0], 3.0), 0.5, 1.0)
        normal = float(contact.fields["pressure"] @ area)
        assert normal == pytest.approx(contents["force_on_body"]["normal"], rel=1e-6)
        assert not list(shared_directory.glob("run/.partial*"))
    comm.barrier()


def test_input_that_is_wrong_on_one_rank_is_an_error_on_all():
    last = comm.size - 1
    problem = make_block(2)
    bound = np.ones(len(problem.surface.nodes))
    b = np.zeros(3 * len(bound))
    if comm.rank == last and len(b):
        b[0] = np.nan
    if any(comm.allgather(bool(np.isnan(b).any()))):
        assert "not finite" in same_error(lambda: FrictionProblem.tresca(problem.A, b, bound))
    text = same_error(
        lambda: make_block(2, cells=(6, 2, 2), friction=0.3, explicit=True, linear_solver=IterativeSolver)
    )
    assert "explicit=True" in text
    explicit = make_block(2, explicit=True)
    assert "explicit=False" in same_error(lambda: explicit.solve(solver=InteriorPoint(newton=CondensedSystem())))


def test_wrong_bodies_are_errors_on_all_ranks():
    mesh = coulomb.box((3.0, 1.0, 1.0), (6, 2, 2))
    contact = Contact("bottom", friction=0.3)
    wrong_here = PrescribedDisplacement(
        "left", lambda x: np.full(x.shape, np.nan if comm.rank == comm.size - 1 else 0.0)
    )
    rows = comm.allgather(int((mesh.domain.geometry.x[:, 0] == 0.0).sum()))
    if rows[-1]:
        text = comm.allgather(_error(lambda: ContactProblem(mesh, STEEL, [wrong_here], contact)))
        assert len(set(text)) == 1


def _error(action):
    try:
        action()
    except ValueError as error:
        return str(error)
    return ""


def test_reductions_with_empty_ranks():
    over = Reductions(comm)
    mine = np.array([3.0, -4.0]) if comm.rank == 0 else np.zeros(0)
    assert over.norm(mine) == 5.0 and over.max(mine) == 3.0 and over.min(mine) == -4.0 and over.sum(mine) == -1.0
    assert over.max(np.zeros(0)) == -np.inf and over.norm(np.zeros(0)) == 0.0
    assert np.isnan(over.max(np.array([np.nan]) if comm.rank == comm.size - 1 else mine))
    assert over.norm(1e200 * mine) == pytest.approx(5e200) and over.norm(1e-200 * mine) == pytest.approx(5e-200)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_mesh_from_a_file_with_two_materials_on_springs(cell, shared_directory):
    """The same on all ranks together as on every rank alone; groups go with their cells and facets."""
    path = shared_directory / f"{cell}.msh"
    if comm.rank == 0:
        BoxFile(cell=cell).write(path)
    comm.barrier()
    forces = []
    for ranks in (comm, MPI.COMM_SELF):
        mesh = coulomb.read_mesh(path, comm=ranks)
        solution = ContactProblem(
            mesh,
            {"soft": coulomb.Material(1e11, 0.2), "stiff": coulomb.Material(2e11, 0.4)},
            [],
            Contact("bottom", friction=0.3),
            [coulomb.Traction("top", (1e6, 0.0, -1e7))],
            springs=[coulomb.Spring("left", 1e10), coulomb.Spring("right", (1e10, 1e10, 1e9))],
        ).solve(tolerance=1e-10)
        assert solution.certificate.passed
        surface = solution.problem.surface
        force, x = -surface.vectors(solution.contact_force.reshape(-1, 3)), surface.x
        data = summary(solution)
        assert np.allclose(
            np.array(data["force_on_body"]["vector"]) + data["spring_force_on_body"], [-2e6, 0.0, 2e7], atol=1.0
        )
        if ranks is comm:
            force, x = everywhere(force), everywhere(x)
        forces.append(force[np.lexsort(x.round(9).T)])
    assert np.linalg.norm(forces[0] - forces[1]) <= 1e-6 * np.linalg.norm(forces[1])
