"""The examples in public docstrings run, and print what they say."""

import doctest
from importlib import import_module

import pytest
from conftest import ROOT

MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "coulomb").rglob("*.py")
    if ">>>" in path.read_text()
)


@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    failed, tried = doctest.testmod(import_module(name), report=True)
    assert tried and not failed


def test_the_names_that_every_script_uses_have_examples():
    import coulomb

    for one in ("ContactProblem", "Contact", "LoadHistory", "box", "join", "solve_coulomb"):
        assert ">>>" in getattr(coulomb, one).__doc__, one
