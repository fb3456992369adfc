"""Skipped tests are reported, and in CI only those of skips_allowed.txt are accepted.

pytest --no-unexpected-skips      fails when a test is skipped that the list does not name for this platform
pytest --list-skips=FILE          writes which were skipped: a line per reason, with how many tests
"""

import fnmatch
import platform
import re
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import pytest

ALLOWED = Path(__file__).with_name("skips_allowed.txt")


def pytest_addoption(parser):
    group = parser.getgroup("skips")
    group.addoption(
        "--no-unexpected-skips", action="store_true", help=f"fail on skips that {ALLOWED.name} does not name"
    )
    group.addoption("--list-skips", metavar="FILE", type=Path, help="write there which tests were skipped, and why")


def here():
    """This platform as skips_allowed.txt names it: debian-12, say, or pypi with PyPI's DOLFINx."""
    if find_spec("dolfinx_solver") is not None:
        return "pypi"
    try:
        release = platform.freedesktop_os_release()
    except OSError:
        return platform.system().lower()
    return f"{release.get('ID', '')}-{release.get('VERSION_ID', '')}".rstrip("-")


def allowed(text, place):
    """Prefixes of the names of tests that may be skipped on this platform.

    Raises:
        ValueError: If a line has no platform, test and reason.
    """
    begins = []
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        columns = re.split(r"\s{2,}", line.strip(), maxsplit=2)
        if len(columns) != 3:
            raise ValueError(
                f"{ALLOWED.name}, line {number}: needs a platform, a test and a reason, two spaces between"
            )
        if columns[0] == "any" or fnmatch.fnmatch(place, columns[0]):
            begins.append(columns[1])
    return tuple(begins)


def unexpected(skipped, begins):
    """The skipped tests (name, reason) whose name begins with none of these prefixes."""
    return [(name, reason) for name, reason in skipped if not name.startswith(begins)]


def skipped_in(config):
    """(name, reason) of the tests, and files, that were skipped."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    reports = reporter.stats.get("skipped", []) if reporter else []
    return [(report.nodeid, report.longrepr[2].removeprefix("Skipped: ")) for report in reports]


def pytest_sessionfinish(session, exitstatus):
    config = session.config
    skipped = skipped_in(config)
    if path := config.getoption("--list-skips"):
        counts = Counter(reason for _, reason in skipped)
        path.write_text("".join(f"{n} test{'s' * (n > 1)}: {reason}\n" for reason, n in counts.items()))
    if config.getoption("--no-unexpected-skips") and exitstatus in (
        pytest.ExitCode.OK,
        pytest.ExitCode.NO_TESTS_COLLECTED,
    ):
        if unexpected(skipped, allowed(ALLOWED.read_text(), here())):
            session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter, config):
    if not config.getoption("--no-unexpected-skips"):
        return
    wrong = unexpected(skipped_in(config), allowed(ALLOWED.read_text(), here()))
    if wrong:
        terminalreporter.section(f"skipped, and not in {ALLOWED.name} for {here()}", red=True, bold=True)
        for name, reason in wrong:
            terminalreporter.line(f"{name}: {reason}")
