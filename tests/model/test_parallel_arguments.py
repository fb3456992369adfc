"""Wrong arguments of Python calls, alone or on any number of ranks: the same error on all ranks, no hang."""

import re
from contextlib import contextmanager

import numpy as np
import pytest
from mpi4py import MPI
from ranks import same_error

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    InteriorPoint,
    LoadHistory,
    Material,
    Probe,
    Rotation,
    SuccessiveTresca,
    Traction,
)

comm = MPI.COMM_WORLD
STEEL = Material(2e11, 0.3)


def block(material=STEEL, mesh=None, friction=0.3, traction=(0.0, 1e6, -1e7), **others):
    return ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (3, 2, 2)) if mesh is None else mesh,
        material,
        [Clamp("left")],
        Contact("bottom", friction=friction),
        [Traction("top", traction)],
        **others,
    )


@pytest.fixture(scope="module")
def solid():
    return block()


def nodes(problem):
    return len(problem.surface.x)


def first_with_nodes(problem):
    counts = comm.allgather(nodes(problem))
    return comm.rank == int(np.argmax(np.array(counts) > 0))


WRONG = {
    "mesh is None": (
        lambda p: ContactProblem(None, STEEL, [], Contact("bottom", 0.3)),
        "mesh must .* None; coulomb.box",
    ),
    "mesh is a path": (lambda p: block(mesh="a.msh"), r"mesh must be .*; coulomb.read_mesh\('a.msh'\) reads a file"),
    "mesh without names": (
        lambda p: block(mesh=p.elasticity.mesh.domain),
        "mesh must be .*coulomb.NamedMesh",
    ),
    "time is nan": (lambda p: block(time=np.nan), "time must be a finite number, but is nan"),
    "time is text": (lambda p: p.at("1"), "time must be a finite number, but is '1'"),
    "explicit is text": (lambda p: block(explicit="yes"), "explicit must be True, False, or None"),
    "probe is a point": (lambda p: block(probes=[(0, 0, 0)]), "probes must be a list of Probe"),
    "gravity is complex": (lambda p: block(gravity=(0, 0, 1j)), "gravity must be three finite numbers"),
    "friction overflows": (lambda p: block(friction=1e300).solve(), "friction has entries above 1e"),
    "friction is complex": (lambda p: block(friction=lambda x: 0.3 + 1j * x[0]).solve(), "friction: .*real.*complex"),
    "traction is complex": (lambda p: block(traction=lambda x: 1j * x), "traction on 'top': .*real.*complex"),
    "solver is a class": (lambda p: p.solve(solver=InteriorPoint), r"solver must be .*, as InteriorPoint\(\)"),
    "solver is a name": (lambda p: p.solve(solver="automatic"), "solver must be .* linear_solver"),
    "solver has no solve": (lambda p: p.solve(solver=solid), "solver must be"),
    "progress is a number": (lambda p: p.solve(progress=3), "progress must be a function of a step"),
    "start is nan": (lambda p: p.solve(start=np.full(3 * nodes(p), np.nan)), "start must be .* not finite"),
    "start is nan somewhere": (
        lambda p: p.solve(start=np.full(3 * nodes(p), np.nan if first_with_nodes(p) else 0.0)),
        "start must be .* not finite",
    ),
    "start is complex": (lambda p: p.solve(start=np.zeros(3 * nodes(p), complex)), "start must be .* real numbers"),
    "start is too long": (lambda p: p.solve(start=np.zeros(3 * nodes(p) + 1), solver=SuccessiveTresca()), "start must"),
    "start by node": (lambda p: p.solve(start=np.zeros((nodes(p), 3))), r"start must be .* shape \("),
    "degrees of a foundation": (
        lambda p: Rotation((0, 0, 0), (0, 0, 1), 90),
        "rotation: angle is in radians: 90 are 14.3 turns; for 90 degrees give 1.5708",
    ),
    "degrees of a face": (
        lambda p: coulomb.PrescribedRotation("top", (0, 0, 0), (0, 0, 1), -45.0),
        "angle is in radians: -45 are 7.16 turns; for -45 degrees give -0.785398",
    ),
    "degrees of a rigid face": (
        lambda p: coulomb.RigidFace("top", rotation=(None, 0, 90)),
        "rotation is in radians",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_arguments_are_refused_in_words(solid, what):
    call, words = WRONG[what]
    assert re.search(words, same_error(lambda: call(solid)))


MATRIX = {
    "complex A": ((np.eye(3) * (1 + 0j), np.zeros(3), 0.3), "A must be made of real numbers, but is complex"),
    "complex b": ((np.eye(3), np.array([1j, 0, 0]), 0.3), "b must be made of real numbers, but is complex"),
    "complex friction": ((np.eye(3), np.zeros(3), 0.3j), "friction must be made of real numbers, but is complex"),
    "a class": ((np.eye(3), np.zeros(3), 0.3, InteriorPoint), r"solver must be .*, as InteriorPoint\(\)"),
}


@pytest.mark.parametrize("what", MATRIX)
def test_wrong_matrices_are_refused_in_words(what):
    arguments, words = MATRIX[what]
    with pytest.raises(ValueError, match=words):
        coulomb.solve_coulomb(*arguments)
    with pytest.raises(ValueError, match=words.replace("friction", "slip_bound")):
        coulomb.solve_tresca(*arguments[:3], solver=arguments[3] if len(arguments) > 3 else None)


def test_an_overflowing_slip_bound_is_named():
    with pytest.raises(ValueError, match="slip_stress, times area has entries above 1e"):
        coulomb.solve_tresca(np.eye(3), np.zeros(3), 1e300)


OF_RANK = {
    "material": (lambda k: block(Material(2e11 * (1 + k), 0.3)), r"material.young .* 200000000000 on rank 0, 4"),
    "friction": (lambda k: block(friction=0.3 + 0.1 * k), "contact.friction .* 0.3 on rank 0, 0.4 on rank 1"),
    "traction": (lambda k: block(traction=(0, 0, -1e7 - k)), r"tractions\[0\].value\[2\] .* -10000000 on rank 0"),
    "kind of traction": (
        lambda k: block(traction=(0, 0, -1e7) if k else lambda x: 0.0 * x),
        "tractions.0..value",
    ),
    "contacts": (
        lambda k: block(probes=[Probe("a", (0.5, 0.5, 0.5))] * k),
        "of probes .* 0 on rank 0, 1 on rank",
    ),
    "box": (lambda k: coulomb.box((3.0, 1.0, 1.0), (3 + k, 1, 1)), r"box: cells\[0\] .* 3 on rank 0, 4 on rank 1"),
    "file": (lambda k: coulomb.read_mesh(f"{k}.msh"), "read_mesh: path .* '0.msh' on rank 0, '1.msh' on rank 1"),
    "tolerance": (lambda k: block().solve(tolerance=1e-8 / (1 + k)), "tolerance .* 1e-08 on rank 0, 5e-09 on rank 1"),
    "solver": (lambda k: block().solve(solver=[InteriorPoint(), SuccessiveTresca()][k % 2]), "solver .* on rank 1"),
    "directory": (lambda k: block().solve().write(f"/nowhere/{k}"), "directory .* on rank 1"),
    "times": (lambda k: next(LoadHistory([1.0 + k]).steps(block())), r"history.times.* 1 on rank 0, 2 on rank 1"),
}


if comm.size > 1:

    @pytest.mark.parametrize("what", OF_RANK)
    def test_arguments_that_differ_between_ranks_are_refused(what):
        call, words = OF_RANK[what]
        said = same_error(lambda: call(comm.rank))
        assert "must be the same on all ranks" in said and re.search(words, said)

    class Forgetful:
        """A recorder."""

        @contextmanager
        def recording(self, problem, beginning):
            yield beginning

        def record(self, step):
            pass

    @pytest.mark.parametrize("what", ["progress", "on_step"])
    def test_a_callback_that_fails_on_one_rank_ends_all(what):
        def fails(step):
            if comm.rank == 1:
                raise KeyError("only here")

        def call():
            if what == "progress":
                block().solve(progress=fails if comm.rank > 0 else None)  # the other has none
            else:
                LoadHistory([1.0]).run(block(), Forgetful(), on_step=fails)

        with pytest.raises(KeyError if comm.rank == 1 else RuntimeError) as failure:
            call()
        if comm.rank != 1:
            assert str(failure.value) == f"{what} failed on rank 1: KeyError: 'only here'"

    def test_a_callback_that_stops_on_one_rank_stops_all():
        with pytest.raises(coulomb.NotConverged) as failure:
            block().solve(progress=(lambda step: True) if comm.rank == 1 else None)
        assert failure.value.result.status.name == "INTERRUPTED"
