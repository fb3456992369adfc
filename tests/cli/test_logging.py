"""Messages of the library: logged under `coulomb`, shown by the command line."""

import logging

import pytest
from conftest import ROOT, run_coulomb, run_python

from coulomb.cli import console

BLOCK = ROOT / "demos" / "block.toml"
OVERRIDE = 'prescribed_displacement=[{face="back", value=[1e-6,0,0], components="x"}]'
SMALL = ("--set", "mesh.cells=[3,1,1]", "--set", "output.picture=false")
MESSAGE = "clamp on 'left' is overridden at 2 nodes by prescribed displacement on 'back'"


def test_a_library_user_sees_the_messages(tmp_path):
    """With logging.basicConfig alone; without it, warnings only, by Python's handler of last resort."""
    script = tmp_path / "user.py"
    script.write_text(
        "import logging, sys\n"
        "if sys.argv[1:]:\n    logging.basicConfig(level=sys.argv[1])\n"
        "import coulomb\nfrom coulomb.case.case import read_case\n"
        f"case = read_case({str(BLOCK)!r}, ['mesh.cells=[3,1,1]', 'material.young=210', {OVERRIDE!r}])\n"
        "answer = case.problem().solve(solver=case.contact_solver())\n"
        "logging.getLogger('coulomb.model').info('information')\n"
        "sys.exit(not answer.outside)\n"
    )
    seen = run_python(script, "INFO")
    assert f"WARNING:coulomb.model.problem:{MESSAGE}" in seen.stderr
    assert "WARNING:coulomb.model.solution:outside the theory: " in seen.stderr
    assert "INFO:coulomb.model:information" in seen.stderr and not seen.stdout
    plain = run_python(script)
    assert MESSAGE in plain.stderr and "INFO" not in plain.stderr and not plain.stdout


@pytest.mark.parametrize("ranks", [None, 2])
def test_the_command_line_shows_a_warning_once(tmp_path, ranks):
    log = tmp_path / "run.log"
    options = (*SMALL, "--set", OVERRIDE, "--output", tmp_path / "out", "--log", log, "--quiet")
    done = run_coulomb("run", BLOCK, *options, ranks=ranks)
    said = [line for line in done.stderr.splitlines() if line.startswith(("warning:", "error:"))]  # MPI may add its own
    assert len(said) == 1 and said[0].startswith(f"warning: {MESSAGE}")
    assert not done.stdout and log.read_text().count(MESSAGE) == 1


def test_levels_on_the_command_line(capsys):
    """Information on standard output unless quiet, warnings and errors on standard error, debug messages not shown."""
    library = logging.getLogger("coulomb")
    before = (list(library.handlers), library.level, library.propagate)
    some = logging.getLogger("coulomb.some.module")

    def log():
        some.debug("detail")
        some.info("information, %s", "as [bold]text[/bold]")
        some.warning("caution")
        some.error("fault")
        logging.getLogger("coulomb.model.solution").warning("reported by the command itself")
        return capsys.readouterr()

    expected = "warning: caution\nerror: fault\n"
    with console.showing_messages(console.console):
        assert log() == ("information, as [bold]text[/bold]\n", expected)
        with console.showing_messages(console.Console(quiet=True)):
            assert log() == ("", expected)
        assert log() == ("information, as [bold]text[/bold]\n", expected)
    assert (list(library.handlers), library.level, library.propagate) == before
