"""A block that is pressed, pulled and pushed back, and functions of answers, for tests of gradients."""

import numpy as np
from mpi4py import MPI

import coulomb
from coulomb.linalg.reductions import Reductions

OVER = Reductions(MPI.COMM_WORLD)
CYCLE = [(0.0, 0.0), (1.0, 0.3), (2.0, 1.0), (3.0, 0.2)]


def shifted(size):
    """A displacement of nodes, which bends faces and stretches cells."""
    return lambda x: size * np.array([np.sin(3.0 * x[1] + x[2]), np.cos(2.0 * x[0] - x[2]), 0.5 * np.sin(2.0 * x[0])])


def drawn(poisson=0.3, rough=0.0, stiff=0.0, shape=0.0, friction=1.0, pressed=1.0, pulled=1.0, young=1.0):
    """A block, pressed, pulled until most of it slips, and pushed back; friction and modulus differ by place."""
    return coulomb.ContactProblem(
        coulomb.moved(coulomb.box((1.0, 1.0, 0.5), (3, 2, 2)), shifted(shape)),
        coulomb.Material(lambda x: 1e9 * young * np.exp(stiff * np.sin(5.0 * x[0] + x[2])), poisson),
        [coulomb.PrescribedDisplacement("right", (2.5e-3 * pulled, 0.0, 0.0), "x", amplitude=[(1.0, 0.0), *CYCLE[2:]])],
        coulomb.Contact(
            "bottom",
            friction=lambda x: 0.4 * friction * np.exp(rough * np.cos(3.0 * x[0] + 2.0 * x[1])),
            foundation=coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ),
        [coulomb.Pressure("top", 2e6 * pressed, amplitude=[(0.0, 0.0), (1.0, 1.0), (3.0, 0.8)])],
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


def summed(at, answers):
    """The sum of the functions with these weights of answers."""
    each = zip(at, answers, strict=True)
    return sum(OVER.sum(x * one.contact_force) + OVER.sum((u * one.displacement).ravel()) for (x, u), one in each)
