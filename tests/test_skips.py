"""The lists of tests that may be skipped in CI, and of those that are slow."""

import os
import subprocess
import sys

import pytest
from conftest import ROOT, SLOW
from skips import ALLOWED, allowed, unexpected

SKIPPING = """
import pytest
from skips import pytest_addoption, pytest_sessionfinish, pytest_terminal_summary
"""
TESTS = """
import pytest

def test_runs(): pass

@pytest.mark.parametrize("n", [1, 2])
def test_misses(n): pytest.importorskip("no_such_package", reason="no such package")
"""


def session(directory, *options, tests=TESTS):
    """A pytest session of its own with these tests."""
    (directory / "conftest.py").write_text(SKIPPING)
    (directory / "test_some.py").write_text(tests)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", directory, *options]
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests")}
    return subprocess.run([*command, directory], capture_output=True, text=True, check=False, env=environment)


def test_a_skip_that_is_not_listed_fails_the_session(tmp_path):
    done = session(tmp_path, "--no-unexpected-skips")
    assert done.returncode == 1
    assert "test_misses[2]: no such package" in done.stdout and "1 passed, 2 skipped" in done.stdout


def test_without_the_option_it_does_not(tmp_path):
    done = session(tmp_path, f"--list-skips={tmp_path / 'skips.txt'}")
    assert done.returncode == 0
    assert (tmp_path / "skips.txt").read_text() == "2 tests: no such package\n"


def test_nothing_skipped_passes(tmp_path):
    done = session(tmp_path, "--no-unexpected-skips", tests="def test_runs(): pass")
    assert done.returncode == 0


def test_a_file_that_is_skipped_as_a_whole_counts(tmp_path):
    done = session(tmp_path, "--no-unexpected-skips", tests="import pytest; pytest.importorskip('no_such_package')")
    assert done.returncode == 1 and "test_some.py: could not import" in done.stdout


def test_a_line_counts_on_its_platform():
    text = "# a comment\n\nany  test_a.py  why\ndebian-13  test_b.py::test_x[10-2]  why\n"
    skipped = [("test_a.py::test_1", ""), ("test_b.py::test_x[10-2]", ""), ("test_b.py::test_x[10-1]", "")]
    assert unexpected(skipped, allowed(text, "debian-12")) == skipped[1:]
    assert unexpected(skipped, allowed(text, "debian-13")) == skipped[2:]
    assert unexpected(skipped, allowed("", "debian-13")) == skipped


def test_a_line_without_a_reason_is_refused():
    with pytest.raises(ValueError, match="line 1: needs a platform, a test and a reason"):
        allowed("any  test_a.py", "debian-12")


def test_every_listed_test_exists():
    for begin in allowed(ALLOWED.read_text(), "debian-13"):
        file, _, name = begin.partition("::")
        assert name.partition("[")[0] in (ROOT / file).read_text()


def test_every_slow_test_exists():
    for test in SLOW:
        file, _, name = test.partition("::")
        assert f"def {name.partition('[')[0]}(" in (ROOT / file).read_text()
