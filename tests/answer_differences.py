"""Derivatives of the last answer of a history against central differences, all inputs at once."""

import numpy as np

import coulomb


def derived(make, times=(1.0,), tolerance=1e-11):
    """The load steps of a history, each with its derivatives."""
    found, steps = [], []
    for step in coulomb.LoadHistory(list(times), tolerance=tolerance).steps(make()):
        found = step.solution.sensitivities(found)
        steps.append((step, found))
    return steps


def differs(make, inputs, times=(1.0,), h=1e-4, present=None):
    """The largest differences of the derivatives of an answer from central differences, over these: of contact forces,
    displacements, and each of the other totals; `present` are the steps of `derived`, if they are known."""
    weights = dict(zip(inputs.values(), np.linspace(1.0, -0.6, len(inputs)), strict=True))

    def last(change):
        made = make(**{name: 1.0 + change * weight for name, weight in weights.items()})
        return [step.solution for step in coulomb.LoadHistory(list(times), tolerance=1e-11).steps(made)][-1]

    step, found = (present or derived(make, times))[-1]
    assert {one.name for one in found} == set(inputs) and min(one.step for one in found) > h
    more, less = map(last, (h, -h))

    def off(derivatives, of, least=1e-12, smallest=0.0):
        derivative = sum(weights[inputs[one.name]] * np.asarray(derivatives(one)) for one in found)
        difference = (np.asarray(of(more)) - np.asarray(of(less))) / (2.0 * h)
        size = np.abs(difference).max() + least * np.abs(of(more)).max()
        return np.abs(derivative - difference).max() / max(size, smallest)

    face = next(iter(found[0].totals))
    worst = {
        "x": off(lambda one: one.contact_force, lambda answer: answer.contact_force),
        "u": off(lambda one: one.displacement, lambda answer: answer.displacement),
    }
    totals = "force", "moment", "normal_force", "friction_force", "dissipated_energy", "contact_area"
    for name in (*totals, "centre_of_pressure"):
        of_face = lambda one, name=name: one.totals[face][name], lambda answer, name=name: answer.forces[name]
        worst[name] = off(*of_face, smallest=1e-2)  # newtons, newton metres, joules: all may stick
    motion = "translation", "rotation", "force", "moment"
    kinds = {"reactions": motion[2:], "ties": motion[2:], "loaded_foundations": motion[:2], "rigid_faces": motion}
    for kind, names in (*kinds.items(), ("bolts", ("force", "shear", "bending", "torsion", "shortening"))):
        for number, one in enumerate(getattr(step.solution, kind)):
            called = getattr(one, "name", None) or one.face
            for of in names:
                worst[called, of] = off(
                    lambda one, kind=kind, called=called, of=of: one.others[kind][called][of],
                    lambda answer, kind=kind, number=number, of=of: getattr(getattr(answer, kind)[number], of),
                    1e-6,
                    10.0 if of in ("force", "moment", "shear", "bending", "torsion") else 1e-3,  # of some it is 0
                )
    worst["mean pressure"] = off(
        lambda one: one.totals[face]["mean_pressure"],
        lambda answer: answer.forces["normal_force"] / answer.forces["contact_area"],
    )
    for member in step.solution.problem.elasticity.members:
        worst["energy", member.name] = off(
            lambda one, name=member.name: one.others["bodies"][name]["strain_energy"],
            lambda answer, name=member.name: next(
                one.body.strain_energy(answer.displacement[one.nodes])
                for one in answer.problem.elasticity.members
                if one.name == name
            ),
        )
    for number, one in enumerate(step.solution.probes):
        for of in ("displacement", "slip", "pressure"):
            worst[one.name, of] = off(
                lambda found, name=one.name, of=of: found.others["probes"][name][of],
                lambda answer, number=number, of=of: getattr(answer.probes[number], of),
            )
    return worst
