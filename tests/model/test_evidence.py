"""The certificate uses the input data: a lost node, motion or slip is detected."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import make_block
from shared_problems import lose
from synthetic_evidence import failed

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, NotConverged, PrescribedDisplacement, Sphere
from coulomb.fem.geometry.obstacles import Moved, RigidMotion
from coulomb.model.contact_body import ContactBody
from coulomb.model.linear_problem import ContactState
from coulomb.model.load_history import StepFailed

RUBBER = Material(1e7, 0.3)


def answer(problem):
    """The answer of the solver, converged or not."""
    try:
        return problem.solve()
    except NotConverged as failure:
        assert "failing conditions" in str(failure)
        return problem.solution(failure.result)


@pytest.mark.parametrize("slip_stress", [None, 1e7], ids=["coulomb", "tresca"])
def test_nodes_that_the_surface_has_lost_are_judged(monkeypatch, slip_stress):
    lose(monkeypatch, lambda x: (x[:, 0] > 1.0 + 1e-9) & (x[:, 0] < 2.0 - 1e-9))
    solution = answer(make_block(4, slip_stress=slip_stress))
    assert "penetration" in failed(solution.certificate)
    assert solution.certificate.penetration > 1e-4
    assert solution.certificate["equilibrium"].passed


def test_one_lost_node_is_enough(monkeypatch):
    lose(monkeypatch, lambda x: np.abs(x - (3.0, 0.5, 0.0)).max(axis=1) < 1e-9)
    assert "penetration" in failed(answer(make_block(4)).certificate)


@pytest.mark.parametrize("clamped", [False, True])
def test_forces_off_the_contact_faces_fail(monkeypatch, clamped):
    """A contact force at a wrong node: inside the body, or at a clamp, whose reaction would balance it."""
    problem = make_block(3)
    solution = problem.solve()
    fixed = problem.elasticity.held.components.all(axis=1)
    other = np.setdiff1d(np.flatnonzero(fixed if clamped else ~fixed), problem.elasticity.nodes("bottom", "test"))[0]
    nodes = problem.surface.nodes.copy()
    nodes[np.argmax(solution.contact_force[0::3])] = other
    points = replace(problem.surface.points, nodes=nodes)
    elsewhere = problem.in_state(replace(problem.state, surface=replace(problem.surface, points=points)))
    certificate = coulomb.certify(elsewhere, solution.contact_force, solution.displacement)
    assert "adhesion" in failed(certificate)


def test_prescribed_nodes_are_not_checked():
    """The nodes of the clamped edge are the only ones of the face that are not checked."""
    problem = make_block(3)
    x = np.zeros(3 * len(problem.surface.nodes))
    judged = problem.evidence(x, problem.displacement(x))
    on_face = problem.elasticity.nodes("bottom", "test")
    assert len(judged.gap) == len(on_face) - 4 == len(problem.surface.nodes)


@pytest.mark.parametrize("components", ["x", "y"])
def test_nodes_held_along_a_tangent_are_checked(monkeypatch, components):
    """A node whose normal component is free is a contact node."""
    lose(monkeypatch, lambda x: x[:, 0] < 1e-9)
    problem = ContactProblem(
        coulomb.box((0.1, 0.1, 0.05), (3, 3, 3)),
        RUBBER,
        [PrescribedDisplacement("top", (0.0, 0.0, -1e-3)), Clamp("left", components)],
        Contact("bottom", 0.3),
    )
    assert "penetration" in failed(answer(problem).certificate)


PATH = [(0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1e-3), (2.0, 2e-3, 1e-3, 1e-3), (3.0, -1e-3, 0.0, 1e-3)]


def moving(normals="foundation", foundation=None):
    """A block of rubber on a foundation that presses it and then rubs to and fro."""
    contact = Contact("bottom", 0.4, foundation=foundation, normals=normals, motion=PATH)
    return ContactProblem(coulomb.box((0.1, 0.1, 0.05), (3, 3, 2)), RUBBER, [Clamp("top")], contact)


def dragged():
    """The same block on a foundation at rest, its top pressed and rubbed."""
    press = PrescribedDisplacement("top", (0.0, 0.0, -1e-3), amplitude=[(0.0, 0.0), (1.0, 1.0)])
    rub = PrescribedDisplacement("top", (2e-3, 0.0, 0.0), "x", amplitude=[(1.0, 0.0), (2.0, 1.0), (3.0, -0.5)])
    return ContactProblem(coulomb.box((0.1, 0.1, 0.05), (3, 3, 2)), RUBBER, [press, rub], Contact("bottom", 0.4))


def certificates(problem, times=(1.0, 2.0, 3.0)):
    """Of the completed steps, and of the one at which the history ended."""
    found = []
    try:
        for step in LoadHistory(times, halvings=0).steps(problem):
            found.append(step.solution.certificate)
    except StepFailed as failure:
        found.append(failure.problem.solution(failure.result).certificate)
    return found


BALL = Sphere((0.05, 0.05, -0.5), 0.5)


@pytest.mark.parametrize(
    "problem",
    [dragged, moving, lambda: moving("foundation", BALL), lambda: moving("body", BALL)],
    ids=["dragged", "moving plane", "moving ball", "moving ball, the body's normals"],
)
def test_right_steps_pass(problem):
    found = certificates(problem())
    assert len(found) == 3
    for certificate in found:
        assert certificate.passed, certificate


def without_origin(monkeypatch):
    """Every step takes the slip origin 0."""
    at = ContactProblem.at
    monkeypatch.setattr(ContactProblem, "at", lambda self, time, before=None: at(self, time))


def without_origin_in_b(monkeypatch):
    def relative_displacement(self, u, alpha=None):
        return self.surface.rows(u)

    monkeypatch.setattr(ContactState, "relative_displacement", relative_displacement)


def wrong_sign_of_origin(monkeypatch):
    at = ContactProblem.at

    def wrong(self, time, before):
        return at(self, time, replace(before, displacement=-before.displacement))

    monkeypatch.setattr(ContactProblem, "at", wrong)


@pytest.mark.parametrize("forget", [without_origin, without_origin_in_b, wrong_sign_of_origin])
def test_a_missing_slip_origin_fails(monkeypatch, forget):
    forget(monkeypatch)
    first, *later = certificates(dragged())
    assert first.passed  # the first step has no slip origin
    assert later and not any(certificate.passed for certificate in later)
    assert failed(later[-1]) & {"slip inside the cone", "slip angle"}


def test_an_origin_that_does_not_move_with_the_foundation_fails(monkeypatch):
    stays = lambda self, problem, state, time: problem.at(time, replace(state, time=time))  # noqa: E731
    monkeypatch.setattr(LoadHistory, "_posed", stays)
    later = certificates(moving())[1:]
    assert later and not any(certificate.passed for certificate in later)


@pytest.mark.parametrize(
    ("method", "wrong"),
    [
        ("surface", lambda self, *_: self._references[self.elasticity.constraints.locked]),
        ("foundation_motions", lambda self, time, poses=None: (RigidMotion(np.zeros(3)),)),
    ],
)
def test_a_foundation_that_does_not_move_fails(monkeypatch, method, wrong):
    problem = moving()
    monkeypatch.setattr(ContactBody, method, wrong)
    (pressed,) = certificates(problem, [1.0])
    assert "penetration" in failed(pressed)


def test_normals_of_a_moved_ball_that_stay_fail(monkeypatch):
    problem = moving("foundation", BALL)
    monkeypatch.setattr(Moved, "normal", lambda self, x: self.foundation.normal(x))
    assert not certificates(problem)[-1].passed


def test_the_coefficient_is_the_one_that_was_given():
    problem = make_block(3)
    state = replace(problem.state, law=replace(problem.law, friction=0.99 * problem.law.friction))
    assert "slip inside the cone" in failed(answer(problem.in_state(state)).certificate)
