"""Permitted imports between the packages ("rooms") of coulomb."""

import ast
import functools

import pytest
from conftest import ROOT

PACKAGE = ROOT / "coulomb"
FILES = sorted(PACKAGE.rglob("*.py"))


def own(path):
    """A file's name within the package."""
    return path.relative_to(PACKAGE).as_posix()


@functools.cache
def nodes(path):
    """Everything in a file's syntax tree."""
    return list(ast.walk(ast.parse(path.read_text())))


def is_module(name):
    """Whether an absolute name is that of a file or folder of the package."""
    path = PACKAGE.parent.joinpath(*name.split("."))
    return path.with_suffix(".py").exists() or path.is_dir()


@functools.cache
def imports(path):
    """Absolute names of everything a file imports, inside functions too."""
    package = ("coulomb", *path.relative_to(PACKAGE).parts[:-1])
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(filter(None, (base, node.module)))
            names = {f"{module}.{alias.name}" for alias in node.names}
            found |= names | ({module} if any(not is_module(name) for name in names) else set())
    return found


def uses(path, *names):
    return sorted(name for name in imports(path) if any(name == n or name.startswith(n + ".") for n in names))


ROOMS = {
    "cli": {"recheck", "case", "io", "pictures", "model", "solvers", "linalg", "fem"},
    "recheck": {"case", "io", "model", "solvers", "linalg", "fem"},
    "case": {"io", "decks", "kinematics", "model", "solvers", "linalg", "fem"},
    "io": {"model", "solvers", "linalg", "fem"},
    "pictures": {"io", "model"},
    "kinematics": set(),
    "model": {"solvers", "linalg", "fem"},
    "solvers": {"linalg"},
    "linalg": set(),
    "fem": {"decks"},
    "decks": set(),
}
"""What a package may import.  The files beside the packages (arrays, ranks, version, ...) and
`native` import no package."""


def room(name):
    """The room of a module by its absolute name, or of a name in it; "" for the files beside the rooms."""
    parts = name.split(".")
    return parts[1] if parts[0] == "coulomb" and len(parts) > 1 and parts[1] in ROOMS else ""


def test_every_folder_is_listed():
    assert {p.name for p in PACKAGE.iterdir() if p.is_dir() and any(p.glob("*.py"))} == {*ROOMS, "native"}


def test_imports_between_rooms():
    wrong = set()
    for path in FILES:
        if own(path) in ("__init__.py", "__main__.py"):  # the public names, loaded lazily; the program
            continue
        here = own(path).partition("/")[0] if "/" in own(path) else ""
        allowed = ROOMS.get(here, set()) | {here, ""}
        wrong |= {(own(path), room(name)) for name in imports(path) if room(name) not in allowed}
    assert not wrong


def test_the_package_does_not_import_benchmarks_and_verification():
    """They are not in the wheel."""
    assert not [own(path) for path in FILES if uses(path, "benchmarks", "verification")]


def refuse_circles(arrows):
    while arrows:
        ground = {name for name, targets in arrows.items() if not targets & arrows.keys()}
        assert ground, f"a circle among {sorted(arrows)}"
        for name in ground:
            del arrows[name]


def test_no_import_cycle_of_rooms():
    """Rooms can be put in an order in which each imports only those behind it."""
    refuse_circles({name: set(targets) for name, targets in ROOMS.items()})


def test_no_import_cycle_of_files():
    """The same for files, including imports in functions and for types; the package itself loads lazily."""
    names = {
        ".".join(("coulomb", *p.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): p for p in FILES
    }
    del names["coulomb"]
    refuse_circles({name: imports(path) & names.keys() - {name} for name, path in names.items()})


INNER_ROOMS = {
    "fem.geometry": set(),
    "fem.meshes": {"fem.geometry"},
    "fem.bodies": {"fem.geometry", "fem.meshes"},
    "fem.contact": {"fem.geometry", "fem.meshes", "fem.bodies"},
    "linalg.factors": set(),
    "linalg.multigrid": set(),
    "linalg.compliance": {"linalg.factors", "linalg.multigrid"},
    "solvers.rigid": set(),
}
"""Rooms within rooms, and which beside them they may import; files beside them import none.  All import what their
`__init__` gives."""


def test_imports_of_inner_rooms():
    wrong = set()
    for path in FILES:
        here = own(path).rpartition("/")[0].replace("/", ".")
        if path.name == "__init__.py" and here in ROOMS:
            continue  # it gives names of its inner rooms, too
        for name in imports(path):
            outer = name.removeprefix("coulomb.").rpartition(".")[0]
            target = next((room for room in INNER_ROOMS if f"{outer}.".startswith(f"{room}.")), here)
            beside = here.partition(".")[0] == target.partition(".")[0]
            allowed = INNER_ROOMS.get(here, set()) if beside else INNER_ROOMS
            if target != here and (outer != target or target not in allowed):
                wrong.add((own(path), name))
    assert not wrong


def test_only_compat_imports_dolfinx():
    found = {own(path): uses(path, "dolfinx", "ufl", "basix") for path in FILES if path.name != "compat.py"}
    assert not {name: names for name, names in found.items() if names}


def test_only_compat_asks_for_the_version():
    texts = {path: path.read_text() for path in FILES if path.name != "compat.py"}
    assert not [own(path) for path, text in texts.items() if "dolfinx.__version__" in text]
    asking = {own(path) for path, text in texts.items() if "compat.VERSION" in text}
    assert {name.rpartition("/")[2] for name in asking} <= {"environment.py"}, asking  # it prints the version


def test_package_imports_neither_plotting_nor_command_line():
    assert not uses(PACKAGE / "__init__.py", "coulomb.cli", "pyvista", "typer")
    for path in FILES:
        if path.name != "figures.py" and path.parent.name != "report":
            assert not uses(path, "pyvista", "vtk", "vtkmodules", "matplotlib"), path


LAUNCH = {PACKAGE / "pictures" / name for name in ("drawing_process.py", "picture_of_run.py")}
"""They run in the process that requests a picture."""


READERS = ("coulomb.io.run_directory", "coulomb.io.field_files", "coulomb.io.accuracy", "coulomb.arrays")
"""The one reader of the run directory, for all rooms, and what numbers in it mean."""


@pytest.mark.parametrize("name", READERS)
def test_the_reader_of_the_run_directory_imports_nothing(name):
    path = PACKAGE.parent / f"{name.replace('.', '/')}.py"
    assert not uses(path, "dolfinx", "petsc4py", "mpi4py")
    assert not [used for used in uses(path, "coulomb") if used != "coulomb" and not used.startswith(READERS)]


NAMES_OF_FILES = (
    "summary.json",
    "history.csv",
    "iterations.csv",
    "case.json",
    "solution.xdmf",
    "contact.xdmf",
    "picture.png",
    "run.lock",
)


def test_file_names_of_a_run_are_in_one_module():
    """No other module has such a name in code, except in docstrings and in longer messages."""
    named = {}
    for path in FILES:
        constants = {node.value for node in nodes(path) if isinstance(node, ast.Constant)}
        if path.name != "run_directory.py":
            named[own(path)] = constants.intersection((*NAMES_OF_FILES, "steps/", "report.html"))
    assert not {name: names for name, names in named.items() if names}


def test_pictures_import_only_the_file_format():
    """They run in a process of their own and import only the format of the files."""
    allowed = (
        "coulomb.pictures.report",
        "coulomb.pictures.drawing_process",
        "coulomb.load_curve",
        "coulomb.nearest",
        "coulomb.contact_fields",
        "coulomb.regular_file",
        "coulomb.units",
        *READERS,
    )
    wrong = {}
    for path in {*(PACKAGE / "pictures").rglob("*.py")} - LAUNCH:
        others = [name for name in uses(path, "coulomb") if name != "coulomb" and not name.startswith(allowed)]
        wrong[own(path)] = uses(path, "dolfinx", "petsc4py", "mpi4py") + others
    assert not {name: names for name, names in wrong.items() if names}


def test_nothing_prints_outside_the_command_line():
    printing = {
        own(path)
        for path in FILES
        for node in nodes(path)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
    }
    assert printing <= {"cli/app.py"}


def test_converged_is_assigned_in_one_place():
    """Only `verdict` may assign CONVERGED; all other code compares with it."""
    places = []
    for path in FILES:
        compared = {id(node) for found in nodes(path) if isinstance(found, ast.Compare) for node in ast.walk(found)}
        for node in nodes(path):
            if isinstance(node, ast.Attribute) and node.attr == "CONVERGED" and id(node) not in compared:
                places.append(path.name)
    assert places == ["results.py"]


def test_length_of_compat():
    assert len((PACKAGE / "fem" / "compat.py").read_text().splitlines()) < 245


def test_length_of_files():
    assert max(len(path.read_text().splitlines()) for path in FILES) <= 500


def constants(path):
    """Names in capitals that a file binds at its top, and whether each binding is a plain number without Final."""
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            parts = list(ast.walk(node.value)) if node.value is not None else []
            number = all(
                isinstance(part, ast.Constant | ast.UnaryOp | ast.BinOp | ast.unaryop | ast.operator) for part in parts
            )
            number &= not any(isinstance(part, ast.Constant) and type(part.value) not in (int, float) for part in parts)
            for name in (one for target in targets for one in getattr(target, "elts", [target])):
                if isinstance(name, ast.Name) and name.id.isupper():
                    yield name.id, number and isinstance(node, ast.Assign)


@pytest.mark.parametrize("path", FILES, ids=own)
def test_constants_are_final_and_bound_once(path):
    """Files that were joined have bound a constant twice: the second value counted for both."""
    bound = [name for name, _ in constants(path)]
    assert not [name for name in set(bound) if bound.count(name) > 1]
    assert not [name for name, plain in constants(path) if plain]


def test_names_of_test_files_are_unique():
    """pytest takes two files of one name in different folders for one module, and collects neither."""
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))
