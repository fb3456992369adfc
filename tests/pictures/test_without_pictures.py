"""Without the packages for pictures a run continues, and one line says what to install."""

import re
import tomllib

import pytest
from conftest import ROOT, run_coulomb

from coulomb.pictures.drawing_process import PACKAGES

SMALL = ("run", ROOT / "demos" / "block.toml", "--set", "mesh.cells=[3,1,1]")
EVERY = " ".join(dict.fromkeys(PACKAGES.values()))


@pytest.fixture
def without(monkeypatch, tmp_path):
    """Makes modules unavailable in the processes that a test starts."""

    def take(*modules):
        place = tmp_path / "missing"
        place.mkdir()
        for name in modules:
            error = f"ModuleNotFoundError(\"No module named '{name}'\", name={name!r})"
            (place / f"{name}.py").write_text(f"raise {error}\n")
        monkeypatch.setenv("PYTHONPATH", f"{place}:{ROOT}")

    return take


def test_the_extra_lists_the_packages():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert {re.match(r"[\w-]+", entry)[0] for entry in extras["pictures"]} == set(PACKAGES.values())
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    assert not {re.match(r"[\w-]+", entry)[0] for entry in needed} & set(PACKAGES.values())


def test_a_run_continues_without_picture_and_report(tmp_path, without):
    without(*PACKAGES)
    done = run_coulomb(*SMALL, "--report", "--output", tmp_path / "out", process=True)
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stderr.splitlines() if line]
    assert len(said) == 2
    for line, name in zip(said, ("picture.png", "report.html"), strict=True):
        assert re.fullmatch(
            rf"warning: {name} could not be (drawn|written): \w+ is not installed, and pictures need it: "
            rf"\./install\.sh, or pip install {EVERY}",
            line,
        )
        assert not (tmp_path / "out" / name).exists()
    assert "certificate passed" in done.stdout


@pytest.mark.parametrize("command", ["plot", "report"])
@pytest.mark.parametrize("module", ["pyvista", "PIL"])
def test_drawing_commands_say_what_to_install(tmp_path, without, command, module):
    done = run_coulomb(*SMALL, "--set", "output.picture=false", "--output", tmp_path / "out", process=True)
    assert done.returncode == 0, done.stderr
    without(module)
    save = tmp_path / ("x.png" if command == "plot" else "x.html")
    done = run_coulomb(command, tmp_path / "out", "--save", save, process=True)
    assert done.returncode == 1 and not save.exists()
    assert done.stderr == (
        f"error: {PACKAGES[module]} is not installed, and pictures need it: ./install.sh, or pip install {EVERY}\n"
    )
