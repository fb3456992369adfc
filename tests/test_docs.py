"""The documentation names existing commands, keys and public names only, it builds, and its notebooks run."""

import functools
import os
import re
import subprocess
import sys
import tomllib
from importlib import import_module

import pytest
from conftest import ROOT, run_coulomb

import coulomb
import coulomb.fem
import coulomb.model
import coulomb.solvers
from coulomb import kinematics
from coulomb.case.case import Case
from coulomb.contact_fields import CONTACT_FIELDS


@functools.cache
def commands():
    """What `coulomb --help` lists."""
    return re.findall(r"^[│|] ([a-z][a-z-]+)\s", run_coulomb("--help", process=True).stdout, flags=re.M)


PAGES = sorted((ROOT / "docs").glob("*.md"))


def test_every_public_name_is_in_the_api_page():
    page = (ROOT / "docs" / "api.md").read_text()
    named = {line.split(".")[-1] for line in page.splitlines() if line.startswith("::: ")}
    public = {*coulomb.__all__, *coulomb.solvers.__all__, *coulomb.model.__all__, *coulomb.fem.__all__}
    public |= {*kinematics.__all__}
    assert named == public.union({"read_xdmf"}) - {"__version__"}


@pytest.mark.parametrize("page", [*PAGES, ROOT / "README.md"], ids=lambda page: page.name)
def test_commands_exist(page):
    known = commands()
    assert {"run", "check", "resume", "info"} <= set(known)
    named = re.findall(r"(?:^    |`|bin/|-n \d+ )coulomb ([a-z][a-z-]+)", page.read_text(), flags=re.M)
    blocks = re.findall(r"```bash\n(.*?)```", page.read_text(), flags=re.S)
    named += re.findall(r"^coulomb ([a-z][a-z-]+)", "\n".join(blocks), flags=re.M)
    assert set(named) <= set(known)


def test_every_page_is_in_the_index_and_in_the_navigation():
    index, navigation = (ROOT / "docs" / "index.md").read_text(), (ROOT / "mkdocs.yml").read_text()
    pages = {page.name for page in PAGES}
    assert set(re.findall(r"\]\(([a-z-]+\.md)", index)) == pages - {"index.md"}
    assert set(re.findall(r": ([a-z-]+\.md)$", navigation, flags=re.M)) == pages


def test_documented_names_are_where_the_page_says():
    page = (ROOT / "docs" / "api.md").read_text()
    homes = re.findall(r"`(coulomb[\w.]*)`", page.partition("##")[0])
    names = [name.rpartition(".")[2] for name in re.findall(r"^::: (coulomb\.\S+)", page, flags=re.M)]
    assert len(homes) == 6 and len(names) > 80
    assert not [name for name in names if not any(hasattr(import_module(home), name) for home in homes)]


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_links_outside_the_documentation_lead_somewhere(page):
    """mkdocs checks those between its pages."""
    links = re.findall(r"\]\((?!https?:)([^)#]+)", (ROOT / page).read_text())
    assert links and not [link for link in links if not (ROOT / link).exists()]


def test_recipes_are_valid_cases():
    """With meshes from files, whose faces are not looked at."""
    blocks = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "how-to.md").read_text(), flags=re.S)
    steel = {"young": 2e11, "poisson": 0.3}
    for given in map(tomllib.loads, blocks):
        alone = "mesh" in given or "material" in given
        bodies = [{"name": name, "file": "x.msh", "material": steel} for name in ("ring", "shaft", "pad", "disc")]
        one = {"mesh": {"file": "x.msh"}, "material": steel, "contact": {"face": "a", "friction": 0.1}}
        others = one if alone else {"body": bodies, "contact": {"face": "pad:a", "against": "disc:b", "friction": 0.1}}
        if "prescribed_rotation" in given:
            others["history"] = {"times": [1.0, 2.0]}
        assert Case.model_validate({**others, **given}), given
    assert len(blocks) == 4


def test_every_contact_field_has_a_row():
    """Name, words, unit, kind, where it is shown, and how the face opposite has it, in the order of the files."""
    where = {"": "", "plot": "`plot`", "report": "`plot`, 3D view", "history": "`plot`, 3D view of histories"}
    expected = [
        f"| `{field.name}` | {field.title} | {field.unit} | {'vector' if field.vector else 'number'} | "
        f"{where[field.shown]} | {field.opposite} |"
        for field in CONTACT_FIELDS
    ]
    section = (ROOT / "docs" / "theory.md").read_text().partition("## Fields of the contact face")[2].partition("##")[0]
    assert [line for line in section.splitlines() if line.startswith("| `")] == expected


def test_tutorial_shows_the_demo():
    """The settings of the tutorial's case are those of demos/foot.toml."""

    def settings(text):
        return {re.sub(r"\s+", " ", line.split("#")[0]).strip() for line in text.splitlines()} - {""}

    blocks = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "tutorial.md").read_text(), flags=re.S)
    demo = settings((ROOT / "demos" / "foot.toml").read_text())
    assert settings("\n".join(blocks)) <= demo
    assert demo - settings("\n".join(blocks)) == {"[output]", 'directory = "results/foot"'}


def test_case_file_page_names_every_key():
    page = (ROOT / "docs" / "case-files.md").read_text()
    words = set(re.findall(r"[a-z_0-9]+", page))
    missing = []

    def walk(model):
        for name, field in model.model_fields.items():
            if name not in words:
                missing.append(f"{model.__name__}.{name}")
            for part in [field.annotation, *_arguments(field.annotation)]:
                if hasattr(part, "model_fields"):
                    walk(part)

    walk(Case)
    assert not missing


def _arguments(annotation):
    for argument in getattr(annotation, "__args__", ()):
        yield argument
        yield from _arguments(argument)


def test_it_builds(tmp_path):
    """`--quiet` would hide warnings from `--strict`, links that lead nowhere among them."""
    pytest.importorskip("mkdocs")
    pytest.importorskip("material")
    pytest.importorskip("mkdocstrings")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "NOTEBOOKS_EXECUTED": "false"}  # the test below runs them
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    api = (tmp_path / "api" / "index.html").read_text()
    assert "ContactProblem" in api and "slip_origin" in api
    page = (tmp_path / "index.html").read_text()
    assert not re.findall(r'(?:src|href)="https?://(?!squidfunk)[^"]*\.(?:js|css)', page)  # nothing fetched when read


NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
SHOWN = {
    "block": ("contact problem", "certificate passed", "<img src=", "friction use"),
    "own_forms": ("certificate passed", "pad:bottom", "held by the clamp: [-43.2"),
    "which_input": ("linear up to", "most by friction", "derivatives and differences agree: True", "image/png"),
    "hysteresis": ("21 load steps", "True that all steps are certified", "image/png"),
}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(notebook, timeout=240, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = " ".join(str(cell.get("outputs")) for cell in notebook.cells)
    for words in SHOWN[path.stem]:
        assert words in re.sub(r"\s+", " ", shown), words
