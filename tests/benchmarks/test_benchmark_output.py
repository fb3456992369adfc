"""What the benchmarks have in common: rows that are kept when a run fails, tables of other packages, --output."""

import csv

import pytest
from conftest import run_coulomb

from coulomb.benchmarks import peers
from coulomb.benchmarks.peers import OURS, Row, Skipped
from coulomb.benchmarks.peers.answer import Figures


def table(file):
    with file.open() as opened:
        return list(csv.DictReader(opened))


@pytest.fixture
def measured(monkeypatch):
    """Replace the measurement by given rows; an exception among them is raised."""

    def rows(*given):
        def measure(*_):
            for one in given:
                if isinstance(one, BaseException):
                    raise one
                yield one

        monkeypatch.setattr(peers, "measure", measure)

    return rows


def test_rows_until_a_failure_are_written(tmp_path, measured):
    figures = Figures(1.0, 2.0, 3.0, 4.0)
    ours = Row(OURS, 4, 2.0, 2**30, 5, 0.0, figures)
    other = ours._replace(peer="GetFEM", seconds=6.0)
    measured(ours, Skipped("CalculiX", 4, "not installed"), other, RuntimeError("p = 8: no memory"))
    done = run_coulomb("benchmark", "peers", "--problem", "two-blocks", "--output", tmp_path)
    assert done.returncode == 1 and done.stderr == "error: p = 8: no memory\n"
    assert "(  3.0)" in done.stdout and "CalculiX         skipped: not installed" in done.stdout
    rows = table(tmp_path / "peers.csv")
    assert [row["peer"] for row in rows] == [OURS, "GetFEM"]
    assert list(rows[0])[-5:] == ["force_error", *Figures._fields] and rows[0]["displacement"] == "4.0"


def test_the_history_has_columns_of_its_own(tmp_path, measured):
    measured(Row(OURS, 4, 2.0, 2**30, 48, 0.0, None, 1.0, 240), KeyboardInterrupt())
    done = run_coulomb("benchmark", "histories", "--output", tmp_path)
    assert done.returncode == 130 and "all  2.00 times that" in done.stdout and "per step  10.0" in done.stdout
    (row,) = table(tmp_path / "histories.csv")  # also if the benchmark is interrupted
    assert list(row)[-2:] == ["first_seconds", "products"] and row["products"] == "240"


def test_the_directory_is_checked_before_anything_is_measured(tmp_path, measured):
    measured(RuntimeError("measured"))
    (tmp_path / "file").touch()
    done = run_coulomb("benchmark", "peers", "--output", tmp_path / "file" / "out")
    assert done.returncode == 2 and "cannot be written" in done.stderr and "measured" not in done.stderr
