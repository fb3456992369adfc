"""Gradients of load histories, backwards along their steps, on any number of ranks: against derivatives forward."""

import numpy as np
import pytest
from drawn_block import CYCLE, OVER, TIMES, backwards, drawn, weights
from mpi4py import MPI

import coulomb


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


def bolted(force=1.0, friction=1.0, young=1.0, pulled=1.0):
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
    bolt = coulomb.Pretension("up:bottom", "low:top", force=1e4 * force, amplitude=[(0, 0), (1, 1)], lock=1.0)
    return coulomb.ContactProblem(
        bodies,
        coulomb.Material(2e11 * young, 0.3),
        [coulomb.Clamp(f"{name}:bottom") for name in ("low", "one", "two")],
        [coulomb.Contact(f"{name}:top", 0.1 * friction, against="head:bottom") for name in ("one", "two")],
        [coulomb.TotalForce("head:right", (1.5e3 * pulled, 0.0, 1e3 * pulled), amplitude=[(1, 0), (2, 1), (3, -0.5)])],
        ties=[coulomb.Tied("up:top", "head:bottom"), bolt],
        small_strain="warn",
    )


def owed_by_name(answer, gradient):
    """This rank's part of what the function owes to inputs of a step, as they are called there."""
    problem, body, size = answer.problem, answer.problem.elasticity, MPI.COMM_WORLD.size
    constraints, time, before = body.constraints, problem.time, problem.before
    rates = body.at(time).prescribed
    if problem.body.undeformed is not None:
        rates = np.concatenate([one.body.prescribed_rate(before and before.time) for one in body.members])
    owed = {"prescribed displacements": np.sum(gradient.prescribed * rates)}
    for one in constraints.motions:
        owed["prescribed displacements"] += gradient.motions[one.given.face] @ one.values(time, problem.comm) / size
    for one in constraints.bolts:
        name = "prescribed displacements" if one.given.force is None else f"pretension of {one.face!r}"
        owed[name] = owed.get(name, 0.0) + gradient.pretension[one.face] * one.given.value(time, problem.comm) / size
    for number, face in enumerate(problem.surface.faces):
        here = problem.surface.part == number
        owed[f"friction of {face!r}"] = np.sum((gradient.friction * problem.law.friction)[here])
        owed[f"cohesion of {face!r}"] = np.sum((gradient.cohesion * answer.at_nodes.cohesion)[here])
        if (limit := problem.law.parts(answer.contact_force[0::3]).get("friction limit")) is not None:
            owed[f"friction limit of {face!r}"] = np.sum((gradient.bound * limit)[here])
        owed[f"gap of {face!r}"] = np.sum((gradient.gap * answer.at_nodes.given_gap)[here])
    for name, along in gradient.young.items():
        owed[f"young of {name!r}" if name else "young"] = along.sum()
    for one in body.members if gradient.temperature is not None else ():
        heat = gradient.temperature[one.nodes] @ problem.loading.temperature.change[one.nodes]
        owed[f"temperature change of {one.name!r}" if one.name else "temperature change"] = heat
    for one in body.loads_in(problem.loading):
        where = f" on {one.face!r}" if one.face else ""
        owed[f"{one.kind.replace('_', ' ')}{where}"] = np.sum(gradient.load * one.forces)
    for one in body.spring_forces(answer.displacement):
        owed[f"stiffness of the spring on {one.face!r}"] = np.sum(gradient.load * one.forces)
    return owed


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
            if name == "prescribed displacements" and make is not drawn:
                continue  # of supports that have begun the increment is the input
            value, size = np.sum(values, axis=0) if every else values[-1]
            sums = [owed_by_name(answer, gradient)[name] for answer, gradient in found]
            assert OVER.comm.allreduce(sum(sums)) == pytest.approx(value, abs=1e-10 * size), (name, every)
            if name.startswith("pretension"):
                more, less = bolted(1.01), bolted(0.99)
                between = sum(gradient.between(more, less) for _, gradient in found)
                assert between == pytest.approx(0.02 * value, rel=1e-6)
