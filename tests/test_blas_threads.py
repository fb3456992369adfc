"""Threads of OpenBLAS beside those of multigrid."""

import pytest

from coulomb.benchmarks.block import block
from coulomb.linalg import blas_threads
from coulomb.linalg.blas_threads import one_blas_thread
from coulomb.linalg.stiffness import DirectSolver, IterativeSolver
from coulomb.model import problem as of_problems


@pytest.fixture
def libraries(monkeypatch):
    """Two libraries with several threads, one after the other; the counts that were chosen."""
    counts = {"numpy's": 2, "scipy's": 3}

    def library(name):
        return blas_threads._OpenBLAS(lambda: counts[name], lambda count: counts.__setitem__(name, count))

    monkeypatch.setattr(blas_threads, "_found", lambda: tuple(map(library, list(counts))))
    return counts


def test_as_many_afterwards_as_before(libraries):
    with pytest.raises(ZeroDivisionError), one_blas_thread():
        assert set(libraries.values()) == {1}
        raise ZeroDivisionError
    assert list(libraries.values()) == [2, 3]
    with one_blas_thread(False):
        assert list(libraries.values()) == [2, 3]


def test_the_library_of_this_machine():
    for library in blas_threads._found():
        before = library.threads()
        try:
            library.choose(2)
            with one_blas_thread():
                assert library.threads() == 1
            assert library.threads() == 2
        finally:
            library.choose(before)


@pytest.mark.parametrize("solver", [DirectSolver, IterativeSolver])
@pytest.mark.parametrize("team", [1, 2])
def test_multigrid_with_threads_has_the_processors_for_itself(monkeypatch, libraries, solver, team):
    monkeypatch.setattr(of_problems, "threads", lambda: team)
    seen = []
    options = {"explicit": False} if solver is IterativeSolver else {}
    body = block(4, 0.3, linear_solver=solver, **options)
    body.solve(progress=lambda _: seen.append(list(libraries.values())) and False)
    alone = solver is IterativeSolver and team > 1
    assert seen and all(counts == ([1, 1] if alone else [2, 3]) for counts in seen)
    assert list(libraries.values()) == [2, 3]
