"""The block by coulomb and its peers: the installed ones agree, the others are omitted and reported."""

import subprocess

import numpy as np
import pytest

from benchmarks import peers
from benchmarks.peers import OURS, PROBLEMS, Peer, Row, Skipped, force_error, measure, missing

BLOCK = PROBLEMS["block"]


@pytest.fixture(scope="module")
def measured():
    """The same problem by all that are installed."""
    return {row.peer: row for row in measure([2], [name for name in BLOCK if not missing(BLOCK[name])])}


def test_coulomb_is_the_first_row_and_the_reference(measured):
    first = next(iter(measured.values()))
    assert (first.peer, first.p, first.force_error) == (OURS, 2, 0.0) and first.iterations > 0 and first.seconds > 0.0
    assert 1e7 < first.peak_memory_bytes < 1e9


@pytest.mark.parametrize("name", [name for name in BLOCK if name != OURS])
def test_agrees(name, measured):
    if reason := missing(BLOCK[name]):
        pytest.skip(reason)
    row = measured[name]
    assert isinstance(row, Row), row
    assert row.force_error <= 1e-6
    assert row.seconds > 0.0 and row.iterations > 0 and row.peak_memory_bytes > 1e7


def test_siconos_agrees_in_second_order():
    if reason := missing(PROBLEMS["second-order"]["Siconos ADMM"]):
        pytest.skip(reason)
    ours, theirs = measure([2], ["Siconos ADMM"], problem="second-order")
    assert ours.force_error == 0.0 and 0.0 < theirs.force_error <= 1e-6


def test_threads_are_those_asked_for(monkeypatch):
    seen = []

    def run(command, env, **_):
        seen.append(env["OMP_NUM_THREADS"])
        return subprocess.CompletedProcess(command, 1, "", "no answer")

    monkeypatch.setattr(peers.subprocess, "run", run)
    for threads in (1, 3):
        with pytest.raises(RuntimeError, match="no answer"):
            list(measure([2], [OURS], threads=threads))
    assert seen == ["1", "3"]


def test_the_shortest_time_counts(monkeypatch):
    runs = iter([3.0, 1.0, 2.0])
    monkeypatch.setattr(peers, "_run", lambda *_: peers._Run(next(runs), 5, 10**8, np.zeros((1, 3)), np.ones((1, 3))))
    (row,) = measure([2], [OURS], repeats=3)
    assert row.seconds == 1.0


def test_missing_peers_and_limits_of_size_are_reported(monkeypatch):
    monkeypatch.setitem(BLOCK, "Absent", Peer("absent", "solve", "no_such_module", "Debian's no-such-package"))
    monkeypatch.setitem(BLOCK, "Slow", Peer("ours", "solve", "coulomb", up_to=1))
    _, absent, slow = measure([2], ["Absent", "Slow"])
    assert isinstance(absent, Skipped) and "not installed" in absent.reason and "no-such-package" in absent.reason
    assert slow == Skipped("Slow", 2, "takes too long beyond p = 1")


def test_failing_peers_are_reported():
    said = peers._run("block", "no such peer", 2, peers.Path("unused.npz"))
    assert isinstance(said, str) and "Traceback" not in said and "\n" not in said


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="Siconos"):
        measure([2], ["Simulink"])
    with pytest.raises(ValueError, match="two-blocks"):
        measure([2], problem="three-blocks")


def test_forces_are_matched_by_place():
    rng = np.random.default_rng(1)
    x, forces, order = rng.uniform(size=(20, 3)), rng.standard_normal((20, 3)), rng.permutation(20)
    assert force_error(x[order] + 1e-12, forces[order], x, forces) == 0.0
    assert force_error(x[order], 1.01 * forces[order], x, forces) == pytest.approx(0.01)
    assert force_error(x + 0.1, forces, x, forces) == np.inf
    assert force_error(x[:-1], forces[:-1], x, forces) == np.inf


def test_a_load_history_agrees():
    """All steps of the history: friction by slip increments."""
    rows = list(measure([1], problem="history"))
    assert rows[0].peer == OURS and 0.0 < rows[0].first_seconds < rows[0].seconds and rows[0].products > 0
    for row in rows[1:]:
        assert isinstance(row, Row) or "not installed" in row.reason
        if isinstance(row, Row):
            assert row.force_error <= 1e-6 and row.iterations >= 24
