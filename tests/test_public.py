"""Public names and their documentation, one version, types, imports without warnings."""

import inspect
import re
import tomllib
from pathlib import Path
from types import FunctionType

import pytest
from conftest import ROOT, run_python

import coulomb
from coulomb.fem.bodies import Deformable, Load, SingleBody, Support
from coulomb.fem.geometry.obstacles import Revolved, RigidFoundation
from coulomb.linalg.compliance.stiffness import StiffnessSolver
from coulomb.solvers.newton_systems import NewtonChoice, NewtonSystem

PROTOCOLS = (
    Deformable,
    Load,
    NewtonChoice,
    NewtonSystem,
    Revolved,
    RigidFoundation,
    SingleBody,
    StiffnessSolver,
    Support,
)  # documented by their methods
NAMES = [name for name in coulomb.__all__ if name != "__version__"]
PLATFORM = ("dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py", "numpy", "scipy", "h5py", "cffi", "pyvista", "vtk")


def test_public_names():
    assert sorted(coulomb.__all__) == sorted(set(coulomb.__all__))
    assert len(coulomb.__all__) <= 60
    assert all(hasattr(coulomb, name) for name in coulomb.__all__)


def members(value):
    """Methods and properties of a public class with public names."""
    for base in inspect.getmro(value):
        if base.__module__.startswith("coulomb"):
            for name, member in vars(base).items():
                if not name.startswith("_") and isinstance(member, FunctionType | property | classmethod):
                    yield name


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_is_documented(name):
    value = getattr(coulomb, name)
    text = value.__doc__ or ""
    assert text.strip() and not text.startswith(f"{name}("), "no docstring, or the one that dataclass makes up"
    if inspect.isclass(value):
        places = (value, *PROTOCOLS)
        for member in members(value):
            assert any(inspect.getdoc(getattr(place, member, None)) for place in places if hasattr(place, member)), (
                member
            )


def test_versions_agree():
    version = coulomb.__version__
    assert re.fullmatch(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)(\.dev\d+)?", version)
    citation = (ROOT / "CITATION.cff").read_text()
    assert re.search(r'^version: "?([^"\n]+)"?$', citation, re.M)[1] == version
    newest = re.search(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)[1]
    assert newest == "Unreleased" if ".dev" in version else newest.split()[0] == version
    assert "version" in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dynamic"]


def test_the_package_is_marked_as_typed():
    assert Path(coulomb.__file__).with_name("py.typed").exists()


def test_no_import_is_deprecated():
    """Every module, with deprecations as errors; those between packages of the platform are ignored."""
    run_python(
        "-c",
        f"""
import importlib, pkgutil, warnings
for category in (DeprecationWarning, PendingDeprecationWarning, FutureWarning):
    warnings.filterwarnings("error", category=category)
    for name in {PLATFORM!r}:
        warnings.filterwarnings("ignore", category=category, module=name + r"(\\.|$)")
import coulomb
for module in pkgutil.walk_packages(coulomb.__path__, "coulomb."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
""",
    )


@pytest.mark.parametrize(
    ("name", "some"),
    [
        ("ContactProblem", {"mesh", "contact", "kinematics", "rigid_faces"}),
        ("Body", {"a", "L", "energy", "displacement"}),
    ],
)
def test_signatures_show_the_arguments(name, some):
    """As in a notebook: they were *arguments and **others."""
    assert some <= inspect.signature(getattr(coulomb, name)).parameters.keys()


def test_signatures_name_their_arguments():
    """Jupyter shows them: no *arguments of any kind."""
    for name in NAMES:
        made = getattr(coulomb, name)
        given = inspect.signature(made).parameters.values() if callable(made) else ()
        assert not [
            one for one in given if one.kind in (one.VAR_POSITIONAL, one.VAR_KEYWORD) and one.annotation == "Any"
        ]
