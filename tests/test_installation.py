"""DOLFINx, petsc4py or MPI that are missing or do not fit: what is said, with fakes in place of the installations."""

import os
import re
import tomllib

import pytest
from conftest import ROOT, SMALL_CASE, run_python

from coulomb.installation import loaded_libraries, why_mpi_does_not_fit, why_not_imported

OPEN_MPI, MPICH = "/usr/lib/x86_64-linux-gnu/libmpi.so.40.30.4", "/venv/lib/libmpi.so.12"
BESIDE = "/usr/lib/libmpi_cxx.so.40", "/venv/lib/libmpifort.so.12", "/lib/libc.so.6"


@pytest.mark.parametrize(
    ("error", "environment", "said"),
    [
        (ModuleNotFoundError("No module named 'dolfinx'", name="dolfinx"), {}, r"pip install \"\.\[fenicsx\]\""),
        (ModuleNotFoundError("No module named 'petsc4py'", name="petsc4py"), {}, "a DOLFINx with petsc4py"),
        (AssertionError(), {}, "a DOLFINx with petsc4py, which this one does not have [(]AssertionError[)]"),
        (ImportError("x"), {"PETSC_DIR": "/opt/petsc"}, "PETSC_DIR is set [(]/opt/petsc[)]: try without"),
        (ImportError("libmpi.so.12: cannot open shared object file"), {}, "import coulomb before dolfinx"),
        (ImportError("/lib/libm.so.6: version `GLIBC_2.34' not found"), {}, "needs glibc 2.34 or newer"),
    ],
)
def test_an_import_that_fails(error, environment, said):
    with pytest.raises(ImportError, match=said):
        raise ImportError(why_not_imported(error, environment))


def test_two_mpi_libraries():
    assert not why_mpi_does_not_fit({OPEN_MPI, *BESIDE}, 1, "Open MPI", {})
    why = why_mpi_does_not_fit({OPEN_MPI, MPICH, *BESIDE}, 1, "Open MPI", {})
    assert f"different MPI libraries ({OPEN_MPI}, {MPICH})" in why


@pytest.mark.parametrize("name", ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"])
def test_a_launcher_of_another_mpi(name):
    assert not why_mpi_does_not_fit({MPICH}, 2, "MPICH", {name: "2"})
    assert not why_mpi_does_not_fit({MPICH}, 1, "MPICH", {name: "1"})
    assert "one of 2 processes by a launcher of another MPI than MPICH" in why_mpi_does_not_fit(
        {MPICH}, 1, "MPICH", {name: "2"}
    )


def test_this_process_has_one_mpi_library():
    assert any("libmpi" in file for file in loaded_libraries())
    assert not why_mpi_does_not_fit(loaded_libraries(), 1, "", {})


@pytest.mark.parametrize(
    ("module", "code", "said"),
    [
        ("dolfinx", "raise ImportError('no DOLFINx here')", "coulomb needs DOLFINx 0.5 or newer"),
        ("petsc4py", "raise ModuleNotFoundError('none', name='petsc4py')", "petsc4py"),
    ],
)
def test_a_command_says_it_and_ends_with_2(tmp_path, monkeypatch, module, code, said):
    (tmp_path / f"{module}.py").write_text(code)
    (tmp_path / "case.toml").write_text(SMALL_CASE)
    places = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(places))
    monkeypatch.delenv("PETSC_DIR", raising=False)
    done = run_python("-m", "coulomb", "check-case", "case.toml", cwd=tmp_path, code=2)
    assert done.stderr.startswith("error: ")
    assert said in done.stderr and "Traceback" not in done.stderr


def test_complex_numbers(tmp_path, monkeypatch):
    """As if PETSc's numbers were complex."""
    script = tmp_path / "script.py"
    script.write_text(
        "import coulomb\nimport dolfinx.fem.petsc\nfrom petsc4py import PETSc\nPETSc.ScalarType = complex\n"
        "try:\n    from coulomb.fem import compat\nexcept ImportError as error:\n    print(error)\n"
    )
    done = run_python(script, cwd=tmp_path, code=None)
    assert "PETSc with real numbers, this one is complex" in done.stdout and "dolfinx-solver-real" in done.stdout


def test_the_recipe_of_conda_forge_has_what_pyproject_has():
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    recipe = (ROOT / "recipe" / "recipe.yaml").read_text()
    run = re.findall(r"^    - (.*)$", recipe.partition("  run:\n")[2].partition("\ntests:")[0], re.M)
    assert {name.replace(">=", " >=") for name in wanted["dependencies"]} < set(run)
    assert f"python {wanted['requires-python']}" in run
