"""Permitted imports between the packages ("rooms") of coulomb."""

import ast

import pytest
from conftest import ROOT

PACKAGE = ROOT / "coulomb"
FILES = sorted(PACKAGE.rglob("*.py"))


def imports(path):
    """Absolute names of everything a file imports, inside functions too."""
    package = ("coulomb", *path.relative_to(PACKAGE).parts[:-1])
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(filter(None, (base, node.module)))
            found |= {module} | {f"{module}.{alias.name}" for alias in node.names}
    return found


def uses(path, *names):
    return sorted(name for name in imports(path) if any(name == n or name.startswith(n + ".") for n in names))


ROOMS = {
    "cli": {"benchmarks", "case", "io", "pictures", "model", "solvers", "linalg", "fem"},
    "benchmarks": {"io", "model", "solvers", "linalg", "fem"},
    "io": {"case", "model", "solvers", "linalg", "fem"},
    "case": {"model", "solvers", "linalg", "fem"},
    "pictures": {"io", "model"},
    "model": {"solvers", "linalg", "fem"},
    "solvers": {"linalg"},
    "linalg": set(),
    "fem": set(),
}
"""What a package may import.  The files beside the packages (arrays, ranks, version, ...) import no package."""


def room(name):
    """The room of a module by its absolute name, or of a name in it; "" for the files beside the rooms."""
    parts = name.split(".")
    return parts[1] if parts[0] == "coulomb" and len(parts) > 1 and parts[1] in ROOMS else ""


def test_every_folder_is_listed():
    assert {p.name for p in PACKAGE.iterdir() if p.is_dir() and any(p.glob("*.py"))} == set(ROOMS)


def test_imports_between_rooms():
    wrong = set()
    for path in FILES:
        own = path.relative_to(PACKAGE)
        here = own.parts[0] if len(own.parts) > 1 else ""
        if str(own) in ("__init__.py", "__main__.py"):  # the public names, loaded lazily; the program
            continue
        allowed = ROOMS.get(here, set()) | {here, ""}
        wrong |= {(str(own), room(name)) for name in imports(path) if room(name) not in allowed}
    assert not wrong


def test_no_import_cycle_of_rooms():
    """Rooms can be put in an order in which each imports only those behind it."""
    arrows = {name: set(targets) for name, targets in ROOMS.items()}
    while arrows:
        ground = {name for name, targets in arrows.items() if not targets & set(arrows)}
        assert ground, f"a circle among {sorted(arrows)}"
        for name in ground:
            del arrows[name]


def test_no_import_cycle_of_files():
    """The same for files, including imports in functions and for types; the package itself loads lazily."""
    names = {
        ".".join(("coulomb", *p.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): p for p in FILES
    }
    del names["coulomb"]
    arrows = {name: imports(path) & names.keys() - {name} for name, path in names.items()}
    while arrows:
        ground = {name for name, targets in arrows.items() if not targets & arrows.keys()}
        assert ground, f"a circle among {sorted(arrows)}"
        for name in ground:
            del arrows[name]


@pytest.mark.parametrize("path", [p for p in FILES if p.name != "compat.py"], ids=lambda p: str(p.relative_to(PACKAGE)))
def test_only_compat_imports_dolfinx(path):
    assert not uses(path, "dolfinx", "ufl", "basix")


@pytest.mark.parametrize("path", [p for p in FILES if p.name != "compat.py"], ids=lambda p: str(p.relative_to(PACKAGE)))
def test_only_compat_asks_for_the_version(path):
    text = path.read_text()
    assert "dolfinx.__version__" not in text
    assert path.name == "environment.py" or "compat.VERSION" not in text  # it prints the version


def test_package_imports_neither_plotting_nor_command_line():
    assert not uses(PACKAGE / "__init__.py", "coulomb.pictures.plotting", "coulomb.cli", "pyvista", "typer")
    for path in FILES:
        if path.name not in ("plotting.py", "figures.py") and path.parent.name != "report":
            assert not uses(path, "pyvista", "vtk", "vtkmodules", "matplotlib"), path


LAUNCH = {PACKAGE / "pictures" / name for name in ("overview_process.py", "picture_of_run.py")}
"""They run in the process that requests a picture."""


READERS = ("coulomb.io.run_directory", "coulomb.io.field_files", "coulomb.arrays")
"""The one reader of the run directory, for all rooms."""


@pytest.mark.parametrize("name", READERS)
def test_the_reader_of_the_run_directory_imports_nothing(name):
    path = PACKAGE.parent / f"{name.replace('.', '/')}.py"
    assert not uses(path, "dolfinx", "petsc4py", "mpi4py")
    assert not [used for used in uses(path, "coulomb") if used != "coulomb" and not used.startswith(READERS)]


NAMES_OF_FILES = (
    "summary.json",
    "history.csv",
    "case.json",
    "solution.xdmf",
    "contact.xdmf",
    "picture.png",
    "run.lock",
)


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_file_names_of_a_run_are_in_one_module(path):
    """No other module has such a name in code, except in docstrings and in longer messages."""
    constants = {n.value for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Constant)}
    assert path.name == "run_directory.py" or not constants.intersection((*NAMES_OF_FILES, "steps/", "report.html"))


@pytest.mark.parametrize("path", sorted({*(PACKAGE / "pictures").rglob("*.py")} - LAUNCH), ids=lambda p: p.name)
def test_pictures_import_only_the_file_format(path):
    """It runs without the package's `__init__` (coulomb.pictures.apart) and imports only the format of the files."""
    own = ("coulomb.pictures.plotting", "coulomb.pictures.report", "coulomb.load_curve", *READERS)
    assert not uses(path, "dolfinx", "petsc4py", "mpi4py")
    assert not [name for name in uses(path, "coulomb") if name != "coulomb" and not name.startswith(own)]


def test_nothing_prints_outside_the_command_line():
    for path in FILES:
        calls = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Call)]
        printing = [n for n in calls if isinstance(n.func, ast.Name) and n.func.id == "print"]
        assert not printing or path.parts[-2:] == ("cli", "app.py"), path


def test_converged_is_assigned_in_one_place():
    """Only `verdict` may assign CONVERGED; all other code compares with it."""
    places = []
    for path in FILES:
        tree = ast.parse(path.read_text())
        compared = [
            node for compare in ast.walk(tree) if isinstance(compare, ast.Compare) for node in ast.walk(compare)
        ]
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and node.attr == "CONVERGED" and node not in compared:
                places.append(path.name)
    assert places == ["results.py"]


def test_length_of_compat():
    assert len((PACKAGE / "fem" / "compat.py").read_text().splitlines()) < 145


def test_length_of_files():
    assert max(len(path.read_text().splitlines()) for path in FILES) <= 350
