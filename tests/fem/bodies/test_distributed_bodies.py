"""Materials, supports and loads of several bodies, distributed to them."""

from types import SimpleNamespace

import numpy as np
import pytest

import coulomb
from coulomb import Clamp, Elasticity, Material, Pressure, Spring, SymmetryPlane, TotalForce, Traction
from coulomb.fem.bodies.elasticity import LoadedBody
from coulomb.fem.bodies.joined_bodies import build_bodies, distributed_bodies
from coulomb.fem.bodies.loads import ThermalLoad

STEEL, RUBBER = Material(2e11, 0.3, 7800.0, 1e-5), Material(1e7, 0.4, 1000.0, 1e-4)
HELD = [Clamp("lower:left", "xy"), SymmetryPlane("upper:right"), Clamp("lower:bottom"), Clamp("upper:left")]


@pytest.fixture(scope="module")
def mesh():
    lower = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1))
    own = lower.domain.topology.index_map(3).size_local
    lower = coulomb.NamedMesh(lower.domain, lower.faces, {"core": np.arange(own, dtype=np.int32)})
    return coulomb.join(lower=lower, upper=coulomb.moved(coulomb.box((2.0, 1.0, 1.0), (1, 1, 1)), (0.0, 0.0, 1.0)))


def test_everything_reaches_its_body(mesh):
    loads = [Traction("upper:top", (1.0, 0.0, 0.0)), Pressure("lower:right", 2.0), TotalForce("upper:top", (3.0, 0, 0))]
    springs = [Spring("lower:top", 5.0)]
    given = distributed_bodies(
        mesh,
        {"lower:core": RUBBER, "upper": STEEL},
        HELD,
        loads,
        {"upper": (0.0, 7.0, 0.0)},
        springs,
        body_force_amplitude=0.5,
        gravity=(0.0, 0.0, -10.0),
        gravity_amplitude=3.0,
        temperature={"lower": 20.0},
        reference_temperature=5.0,
        temperature_amplitude=4.0,
    )
    lower, upper = (SimpleNamespace(**given[name]) for name in ("lower", "upper"))
    assert lower.materials == {"core": RUBBER} and upper.materials is STEEL
    assert [type(c) for c in lower.clamps] == [Clamp, Clamp] and [c.face for c in lower.clamps] == ["left", "bottom"]
    assert lower.clamps[0].components == "xy" and [c.face for c in upper.clamps] == ["right", "left"]
    assert [t.face for t in upper.tractions] == ["top", "top"] and upper.tractions[1].force == (3.0, 0, 0)
    assert lower.tractions == [Pressure("right", 2.0)] and lower.springs == [Spring("top", 5.0)]
    assert loads[0].face == "upper:top" and HELD[0].face == "lower:left", "the user's own are changed"
    assert upper.body_force == (0.0, 7.0, 0.0) and not any(lower.body_force) and lower.gravity == upper.gravity
    assert lower.thermal == ThermalLoad(20.0, 5.0, 4.0) and upper.thermal is None

    bodies = build_bodies(LoadedBody, given)
    force = {name: bodies[name].comm.allreduce(body.at(0.0).load.sum(axis=0)) for name, body in bodies.items()}
    assert force["upper"] == pytest.approx(
        [2.0 + 3.0, 0.5 * 2.0 * 7.0, -3.0 * 2.0 * 7800.0 * 10.0]
    )  # formula: area, volume 2
    assert force["lower"] == pytest.approx([-2.0, 0.0, -3.0 * 1000.0 * 10.0], abs=1e-9)


@pytest.mark.parametrize(
    "changes, said",
    [
        ({"materials": {"lower": STEEL}}, "material: body 'upper' has none; materials are given for lower"),
        ({"materials": {"lower": STEEL, "uper": STEEL}}, "no body 'uper' .did you mean 'upper'."),
        ({"materials": {"lower": STEEL, "lower:core": STEEL, "upper": STEEL}}, "for the whole body, and others"),
        ({"materials": {"lower:cor": STEEL, "upper": STEEL}}, "has no cell group 'lower:cor' "),
        ({"clamps": [Clamp("bottom")]}, r"clamp: face 'bottom' does not say of which body.*'lower:bottom'"),
        ({"clamps": "left"}, "clamps must be a list of Clamp"),
        ({"tractions": [Traction("lower:up", (0.0, 0.0, 1.0))]}, "traction: body 'lower' has no face 'lower:up'"),
        ({"springs": [Spring("middle:top", 1.0)]}, "there is no body 'middle'; the bodies are lower, upper"),
        ({"gravity": {"lowr": (0.0, 0.0, -1.0)}}, "gravity: there is no body 'lowr' .did you mean 'lower'"),
    ],
)
def test_wrong_names(mesh, changes, said):
    given = {"materials": STEEL, "clamps": HELD} | changes
    with pytest.raises(ValueError, match=said):
        distributed_bodies(mesh, **given)


def test_a_fault_of_a_body_names_it(mesh):
    held = [Clamp("lower:bottom"), Clamp("upper:top", direction=lambda x: 0.0 * x)]
    with pytest.raises(ValueError, match=r"^body 'upper': clamp on 'top': direction"):
        build_bodies(Elasticity, distributed_bodies(mesh, STEEL, held))
