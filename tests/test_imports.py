"""Immediate messages do not load slow libraries; only the renderer loads libraries for drawing."""

import ast
import json
from pathlib import Path

import pytest
from conftest import ROOT, run_coulomb, run_python

import coulomb

PICTURES = {"pyvista", "vtk", "vtkmodules", "matplotlib", "PIL", "jinja2"}
SLOW = PICTURES | {"mpi4py", "petsc4py", "dolfinx", "ufl", "basix", "scipy", "h5py", "threadpoolctl"}

UNUSED = {"scipy.optimize", "scipy.spatial", "meshio", "coulomb.fem.meshes.gmsh_format", "coulomb.recheck"}
"""What the run of a box that supports hold does not need, and takes 75 ms to load."""

AND_TELL = """
import atexit, json, sys
atexit.register(lambda: sys.stderr.write("\\n" + json.dumps(sorted(sys.modules))))
"""


def loaded(code, *arguments, ranks=None):
    """Exit code and output of Python code in a process of its own, and the modules it has loaded by its end."""
    done = run_python("-c", AND_TELL + code, *arguments, ranks=ranks, code=None)
    return done, set(json.loads(done.stderr.splitlines()[-1]))


def command(*words):
    return loaded("from coulomb.cli.app import main\nmain()", *words)


def test_the_package_loads_nothing_until_it_is_used():
    _, packages = loaded("import coulomb; coulomb.__version__; dir(coulomb)")
    assert "coulomb" in packages and not packages & (SLOW | {"numpy", "typer", "pydantic"})


def test_public_names_load_no_drawing_libraries():
    done, packages = loaded("from coulomb import ContactProblem, solve_coulomb; print(ContactProblem.__name__)")
    assert done.stdout.strip() == "ContactProblem" and {"dolfinx", "petsc4py"} <= packages
    assert not packages & (PICTURES | {"typer", "pydantic", "pkg_resources"})


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--help"], 0, "Exit codes:"),
        (["--version"], 0, f"coulomb {coulomb.__version__}"),
        (["run", "--help"], 0, "CASE.toml"),
        (["check-case", "none.toml"], 2, "error: none.toml: cannot be read: No such file"),
        (["check-case", "WRONG"], 2, "wrong.toml: material.yuong = 1: there is no such key; did you mean young?"),
        (["new", "sphere"], 2, "'sphere' is not one of"),
        (["plot", "--help"], 0, "--field"),
    ],
)
def test_messages_load_no_numerical_libraries(tmp_path, words, code, said):
    text = (ROOT / "demos" / "block.toml").read_text().replace("young = ", "yuong = 1 # ")
    (tmp_path / "wrong.toml").write_text(text)
    done, packages = command(*(str(tmp_path / "wrong.toml") if word == "WRONG" else word for word in words))
    assert done.returncode == code and said in done.stdout + done.stderr
    assert "typer" in packages and not packages & (
        SLOW | (set() if words[0] == "check-case" else {"numpy", "coulomb.case"})
    )


def test_a_run_draws_in_another_process(tmp_path):
    done, packages = command(
        "run", str(ROOT / "demos" / "block.toml"), "--set", "mesh.cells=[3,1,1]", "--output", str(tmp_path)
    )
    assert done.returncode == 0 and (tmp_path / "picture.png").exists()
    assert "dolfinx" in packages and not packages & (PICTURES | UNUSED)


def test_only_rank_0_prints():
    for words, said in ((["--version"], "coulomb "), (["check-case", "none.toml"], "error: none.toml: cannot be read")):
        done = run_coulomb(*words, ranks=2, code=None)
        assert (done.stdout + done.stderr).count(said) == 1


@pytest.mark.parametrize("package", [coulomb, coulomb.fem, coulomb.model, coulomb.solvers])
def test_lazy_names_are_those_of_the_stub(package):
    """What `*` imports is what type checkers see, and no other name is there."""
    stub = Path(package.__file__).with_suffix(".pyi").read_text()
    seen = [alias.asname for node in ast.parse(stub).body[1:] for alias in node.names]
    assert package.__all__ == sorted(seen) and seen
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'Block'"):
        package.Block  # noqa: B018


def test_classes_of_arrays_have_no_comparison():
    """Arrays have no truth value of ==, and no hash; to make both for all these classes takes 0.04 s of every start."""
    with_arrays = {
        (path.name, node.name): "eq=False" in " ".join(map(ast.unparse, node.decorator_list))
        for path in (ROOT / "coulomb").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ClassDef) and "dataclass" in " ".join(map(ast.unparse, node.decorator_list))
        if any(
            isinstance(field, ast.AnnAssign) and ast.unparse(field.annotation).startswith(("FloatArray", "npt.NDArray"))
            for field in node.body
        )
    }
    assert len(with_arrays) > 100 and [name for name, right in with_arrays.items() if not right] == []
