"""Gradients of load histories, backwards along their steps, on any number of ranks: against derivatives forward along
them, and differences of histories."""

import numpy as np
import pytest
from mpi4py import MPI

import coulomb
from coulomb.fem import compat
from coulomb.linalg.reductions import Reductions

OVER = Reductions(MPI.COMM_WORLD)
CYCLE = [(0.0, 0.0), (1.0, 0.3), (2.0, 1.0), (3.0, 0.2)]


def drawn(poisson=0.3, rough=0.0, stiff=0.0):
    """A block, pressed, pulled until most of it slips, and pushed back; friction and modulus differ by place."""
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 0.5), (3, 2, 2)),
        coulomb.Material(lambda x: 1e9 * np.exp(stiff * np.sin(5.0 * x[0] + x[2])), poisson),
        [coulomb.PrescribedDisplacement("right", (2.5e-3, 0.0, 0.0), "x", amplitude=[(1.0, 0.0), *CYCLE[2:]])],
        coulomb.Contact("bottom", friction=lambda x: 0.4 * np.exp(rough * np.cos(3.0 * x[0] + 2.0 * x[1]))),
        [coulomb.Pressure("top", 2e6, amplitude=[(0.0, 0.0), (1.0, 1.0), (3.0, 0.8)])],
    )


def glued():
    """A plate that is tied to a block, where both have come to, when the block is let go."""
    block = coulomb.box((1.0, 1.0, 0.5), (2, 2, 1))
    plate = coulomb.moved(coulomb.box((1.0, 1.0, 0.4), (3, 3, 1)), translate=(0.0, 0.0, 0.5))
    return coulomb.ContactProblem(
        coulomb.join(block=block, plate=plate),
        coulomb.Material(1e9, 0.3),
        [
            coulomb.PrescribedDisplacement("plate:top", (4e-3, 1e-3, -2e-3), amplitude=CYCLE),
            coulomb.PrescribedDisplacement("block:top", (-1e-3, 0.0, -1.5e-3), amplitude=[(0, 0), (1, 1)], end=1.0),
            coulomb.Clamp("block:right", "y", begin=2.0),
        ],
        coulomb.Contact("block:bottom", friction=0.3),
        [coulomb.Pressure("block:right", 1e5), coulomb.Pressure("plate:right", 3e5)],
        ties=[coulomb.Tied("plate:bottom", "block:top", begin=1.0)],
        small_strain="warn",
    )


def bolted():
    """A bolt that is tightened, locked and loaded, in two parts, and two sleeves under its head."""
    side = 0.02

    def part(size, cells, at):
        return coulomb.moved(coulomb.box(size, cells), at)

    bodies = coulomb.join(
        low=part((side, side, 0.04), (1, 1, 1), (side, 0.0, 0.0)),
        up=part((side, side, 0.06), (1, 1, 2), (side, 0.0, 0.04)),
        head=part((3 * side, side, side), (3, 1, 1), (0.0, 0.0, 0.1)),
        one=part((side, side, 0.1), (1, 1, 2), (0.0, 0.0, 0.0)),
        two=part((side, side, 0.1), (1, 1, 2), (2 * side, 0.0, 0.0)),
    )
    bolt = coulomb.Pretension("up:bottom", "low:top", force=1e4, amplitude=[(0, 0), (1, 1)], lock=1.0)
    return coulomb.ContactProblem(
        bodies,
        coulomb.Material(2e11, 0.3),
        [coulomb.Clamp(f"{name}:bottom") for name in ("low", "one", "two")],
        [coulomb.Contact(f"{name}:top", 0.1, against="head:bottom") for name in ("one", "two")],
        [coulomb.TotalForce("head:right", (1.5e3, 0.0, 1e3), amplitude=[(1, 0), (2, 1), (3, -0.5)])],
        ties=[coulomb.Tied("up:top", "head:bottom"), bolt],
        small_strain="warn",
    )


TIMES = [1.0, 2.0, 3.0]


def weights(answer):
    """Of a function of an answer, along its forces and displacements, which are of the same size."""
    sizes = OVER.max(np.abs(answer.contact_force)) / OVER.max(np.abs(answer.displacement).ravel())
    surface, body = answer.problem.surface, answer.problem.elasticity
    return np.sin(surface.x * [31.0, 17.0, 23.0]).ravel(), sizes * np.cos(body.x * [13.0, 29.0, 19.0])


def backwards(answers, every=True):
    """Gradients from the last step to the first, of a function of the last or of the sum over all."""
    found, later = [], None
    for answer in reversed(answers):
        at = weights(answer) if every or later is None else ()
        later = answer.gradient(*at, later=later)
        found.append((answer, later))
    return found


def owed(answer, gradient, kind, of):
    """This rank's part of what the function owes to an input by a step."""
    surface, body, loading = answer.problem.surface, answer.problem.elasticity, answer.problem.loading
    if kind == "friction":
        here = surface.part == surface.faces.index(of)
        return np.sum((gradient.bound * answer.slip_bound)[here])
    if kind == "young":
        return gradient.young[of].sum()
    if kind == "pretension":
        return gradient.pretension["up:bottom"] * 1e4 / MPI.COMM_WORLD.size
    if kind == "prescribed displacements":
        given = body.at(answer.time).prescribed if not body.constraints.ties else answer.problem.loading.prescribed
        return np.sum(gradient.prescribed * body.held.held_part(given))
    (forces,) = (
        one.forces for one in body.loads_in(loading) if f"{one.kind.replace('_', ' ')} on {one.face!r}" == kind
    )
    return np.sum(gradient.load * forces)


@pytest.mark.parametrize("make", [drawn, glued, bolted])
def test_backwards_they_agree_with_derivatives_forward(make):
    """Of functions of the last step, and of the sum over all."""
    problem, answers, forward, earlier = make(), [], {}, []
    for step in coulomb.LoadHistory(TIMES, tolerance=1e-12).steps(problem):
        answers.append(step.solution)
        earlier, (of_x, of_u) = step.solution.sensitivities(earlier), weights(step.solution)
        for one in earlier:
            assert not one.border
            value = OVER.sum(of_x * one.contact_force) + OVER.sum((of_u * one.displacement).ravel())
            size = OVER.norm(of_x) * OVER.norm(one.contact_force) + OVER.norm(of_u) * OVER.norm(one.displacement)
            forward.setdefault(one.name, []).append((value, size))
    for every in (False, True):
        found = backwards(answers, every)
        for name, values in forward.items():
            kind, _, of = name.partition(" of ")
            if kind == "prescribed displacements" and make is not drawn:
                continue  # of supports that have begun the increment is the input
            value, size = np.sum(values, axis=0) if every else values[-1]
            sums = [owed(answer, gradient, kind, of.strip("'")) for answer, gradient in found]
            assert OVER.comm.allreduce(sum(sums)) == pytest.approx(value, abs=1e-10 * size), (name, every)


@pytest.mark.parametrize("field", ["rough", "stiff"])
def test_along_a_field_the_remainder_is_of_second_order(field):
    """Of friction, or of Young's modulus, at each point or cell: against central differences of whole histories."""

    def answers(**given):
        return [step.solution for step in coulomb.LoadHistory(TIMES, tolerance=1e-12).steps(drawn(**given))]

    present = answers()
    at = [weights(one) for one in present]

    def total(found):
        each = zip(at, found, strict=True)
        return sum(OVER.sum(x * one.contact_force) + OVER.sum((u * one.displacement).ravel()) for (x, u), one in each)

    along = 0.0
    for one, gradient in backwards(present):
        if field == "rough":
            x = one.problem.surface.x
            along += np.sum(gradient.friction * one.problem.law.friction * np.cos(3.0 * x[:, 0] + 2.0 * x[:, 1]))
        else:
            body = one.problem.elasticity.members[0].body
            x = body.domain.geometry.x[compat.cell_geometry(body.domain)[: len(gradient.young[""])]].mean(axis=1)
            along += np.sum(gradient.young[""] * np.sin(5.0 * x[:, 0] + x[:, 2]))
    along = OVER.comm.allreduce(along)
    value = total(present)
    h = 1e-3
    more, less, half = (total(answers(**{field: change})) for change in (h, -h, 0.5 * h))
    assert (more - less) / (2.0 * h) == pytest.approx(along, rel=1e-5)
    remainders = abs(more - value - h * along), abs(half - value - 0.5 * h * along)
    assert np.log2(remainders[0] / remainders[1]) == pytest.approx(2.0, abs=0.05)
