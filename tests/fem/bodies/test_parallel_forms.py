"""Bodies from the user's forms on any number of ranks: run alone, or as `mpirun -n 3 python -m pytest ...`."""

import re

import numpy as np
import pytest
import ufl
from conftest import ROOT, run_script
from mpi4py import MPI
from ranks import by_place, everywhere, same_error
from test_forms import both
from user_forms import Script

import coulomb
from coulomb import Contact, ContactProblem, LoadHistory
from coulomb.fem.compat import mesh
from coulomb.io.output import write
from coulomb.recheck import check

comm = MPI.COMM_WORLD


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
@pytest.mark.ranks
def test_a_history_from_forms(cell, degree):
    history = LoadHistory([1.0, 2.0], tolerance=1e-10)
    alone = history.steps(both(cell, degree, comm=MPI.COMM_SELF)[1])
    together = history.steps(both(cell, degree)[1])
    for one, other in zip(alone, together, strict=True):
        expected = by_place(one.solution.problem.elasticity.x, one.solution.displacement)
        x = everywhere(other.solution.problem.elasticity.x)
        found = by_place(x, everywhere(other.solution.displacement))
        assert other.solution.certificate.passed and other.solution.force_balance.balance < 1e-10
        assert np.abs(found - expected).max() <= 1e-8 * np.abs(expected).max()
        for mine, theirs in zip(one.solution.reactions, other.solution.reactions, strict=True):
            assert np.abs(mine.force - theirs.force).max() <= 1e-8 * np.abs(mine.force).max()


def test_robin_terms_and_own_fields(tmp_path):
    """The balance with Robin terms, a load on a part of the boundary, and files with functions of the user."""
    folder = comm.bcast(tmp_path)
    script = Script(coulomb.box((1.0, 1.0, 1.0), (3, 3, 3), "tetrahedron"), 2)
    robin = 1e9 * ufl.inner(script.u, script.v) * script.ds("top")
    L = ufl.inner(script.constant((3e5, 0.0, -1e6)), script.v) * script.ds("right")
    faces = {"sole": script.mesh.faces["bottom"]}
    body = coulomb.Body(script.elasticity(1e10, 0.3) + robin, L, faces=faces)
    solution = ContactProblem(body, Contact("sole", 0.2)).solve()
    assert solution.certificate.passed and solution.force_balance.balance < 1e-10
    contents = write(solution, folder / str(comm.size), fields={"z": script.on_cells(lambda x: x[2])})
    assert contents["fields"] == ["z"] and contents["reactions"][0]["name"] == "form"


def test_the_code_of_the_page_runs(tmp_path):
    """docs/forms.md is one script, and runs under mpirun as it is."""
    folder = comm.bcast(tmp_path)
    code = "\n".join(re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "forms.md").read_text(), flags=re.S))
    (tmp_path / "page.py").write_text(code)
    done = run_script(tmp_path / "page.py", folder)
    assert done.stdout.count("certificate passed") == 1 and "form: [" in done.stdout
    assert re.search(r"held by \[-5\.0, -?0\.0, 25\.0\] N", done.stdout)
    faults = [check(folder / "results" / name).faults for name in ("forms", "heated")] if comm.rank == 0 else []
    assert not any(comm.bcast(faults))


def test_wrong_facets_on_one_rank_are_errors_on_all():
    script = Script(coulomb.box((1.0, 1.0, 1.0), (3, 3, 3)), 1)
    held = [script.bc((0.0, 0.0, 0.0), "top")]
    a, bottom = script.elasticity(1e9, 0.3), script.mesh.faces["bottom"]
    wrong = [10**6] if comm.rank == comm.size - 1 else bottom
    assert "1000000 is no facet" in same_error(lambda: coulomb.Body(a, None, held, {"sole": wrong}))
    topology = script.domain.topology
    others = np.setdiff1d(np.arange(topology.index_map(2).size_local), mesh.exterior_facet_indices(topology))
    inside = np.concatenate([bottom, others[: int(comm.rank == 0)]]).astype(np.int32)
    assert "not on the boundary" in same_error(lambda: coulomb.Body(a, None, held, {"sole": inside}))
    fails = (lambda t: 1 / 0) if comm.rank == 0 else (lambda t: None)
    assert "division by zero" in same_error(lambda: coulomb.Body(a, None, held, {"s": bottom}, update=fails).at(0.0))
    skew = a + 1e8 * ufl.inner(script.u.dx(0), script.v) * ufl.dx
    assert "not symmetric" in same_error(lambda: coulomb.Body(skew, None, held, {"sole": bottom}))


def test_a_form_that_cannot_be_compiled_ends_on_every_rank():
    """UFL's ArityMismatch is no `Exception` in recent versions: the other ranks, and later runs, waited."""
    script = Script(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2), "tetrahedron"), 1)
    down = script.constant((0.0, 0.0, -1.0))
    mixed = script.elasticity(1e9, 0.3) + ufl.inner(script.u + down, script.v) * ufl.dx
    for _ in range(2):
        text = same_error(lambda: coulomb.Body(mixed, None, [], faces={}))
        assert text.startswith("a cannot be compiled: ")
