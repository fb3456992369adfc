"""Heat conduction, thermal strain and friction heat against formulas; run alone, or with mpirun."""

import numpy as np
import pytest
from conftest import ROOT
from mpi4py import MPI
from ranks import same_error
from scipy.optimize import brentq

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    CyclicSymmetry,
    Equation,
    HeatLoad,
    LoadHistory,
    Material,
    Plane,
    PrescribedDisplacement,
    Pressure,
    SymmetryPlane,
    ThermalContact,
    Tied,
    box,
    join,
    moved,
)
from coulomb.case.case import read_case
from coulomb.linalg.reductions import Reductions
from coulomb.model.heated import HeatNotConverged

comm = MPI.COMM_WORLD
over = Reductions(comm)
HOT, COLD = 120.0, 20.0
SIDES = ("left", "right", "front", "back")


def steel(expansion=0.0, poisson=0.3):
    return Material(2e11, poisson, expansion=expansion, conductivity=50.0)


def two_bars(thermal, below=("hexahedron", 1), above=("tetrahedron", 1), heat=None, pressure=1e6):
    """A steel bar of 50 mm under one of aluminium of 30 mm, with meshes that do not match."""
    lower = box((0.02, 0.02, 0.05), (2, 1, 2), below[0], degree=below[1])
    upper = moved(box((0.02, 0.02, 0.03), (3, 2, 3), above[0], degree=above[1]), (0.0, 0.0, 0.05))
    materials = {"lower": steel(), "upper": Material(7e10, 0.3, expansion=0.0, conductivity=200.0)}
    held = [SymmetryPlane(f"{body}:{side}") for body in ("lower", "upper") for side in ("left", "front")]
    given = [HeatLoad("lower:bottom", temperature=COLD), HeatLoad("upper:top", temperature=HOT)]
    return ContactProblem(
        join(lower=lower, upper=upper),
        materials,
        [Clamp("lower:bottom", "z"), *held],
        Contact("upper:bottom", 0.0, against="lower:top", thermal=thermal),
        [Pressure("upper:top", pressure)],
        heat=given if heat is None else heat,
        reference_temperature=COLD,
    )


def flows(heat):
    return {flow.name: flow.power for flow in heat.flows}


@pytest.mark.parametrize(
    ("below", "above"),
    [
        (("hexahedron", 1), ("tetrahedron", 1)),
        (("tetrahedron", 2), ("hexahedron", 2)),
        (("hexahedron", 1), ("tetrahedron", 2)),
    ],
)
def test_two_bars_in_series_with_a_contact_resistance(below, above):
    problem = two_bars(ThermalContact(conductance=2e3), below, above)
    solution = problem.solve()
    flux = (HOT - COLD) / (0.05 / 50.0 + 1.0 / 2e3 + 0.03 / 200.0)
    for member in problem.elasticity.members:
        z = member.body.x[:, 2]
        expected = COLD + flux * z / 50.0 if member.name == "lower" else HOT - flux * (0.08 - z) / 200.0
        assert np.abs(solution.heat.temperature[member.nodes] - expected).max(initial=0.0) <= 1e-10 * (HOT - COLD)
    power = flux * 4e-4
    assert flows(solution.heat)["heat_temperature_upper:top"] == pytest.approx(power, rel=1e-10)
    assert flows(solution.heat)["heat_temperature_lower:bottom"] == pytest.approx(-power, rel=1e-10)
    out_of_slave = {"upper:bottom": power, "lower:top": -power}[problem.contacts[0].face]
    assert solution.heat.through[0] == pytest.approx(out_of_slave, rel=1e-10)
    assert solution.heat.balanced and abs(solution.heat.imbalance) <= 1e-10 * power and solution.valid


@pytest.mark.parametrize(("below", "above"), [(1, 1), (2, 1), (1, 2)])
def test_two_bars_that_are_tied_conduct_in_series(below, above):
    """With meshes that do not match; an equation between displacements conducts nothing."""
    lower = box((0.02, 0.02, 0.05), (2, 1, 2), degree=below)
    upper = moved(box((0.02, 0.02, 0.03), (3, 2, 3), "tetrahedron", degree=above), (0.0, 0.0, 0.05))
    materials = {"lower": steel(), "upper": Material(7e10, 0.3, expansion=0.0, conductivity=200.0)}
    held = [SymmetryPlane(f"{body}:{side}") for body in ("lower", "upper") for side in ("left", "front")]

    law, loads = Contact("lower:bottom", 0.0), [Pressure("upper:top", 1e6)]
    heat = [HeatLoad("lower:bottom", temperature=COLD), HeatLoad("upper:top", temperature=HOT)]
    given, flux = {"heat": heat, "reference_temperature": COLD}, (HOT - COLD) / (0.05 / 50.0 + 0.03 / 200.0)
    for faces in (("upper:bottom", "lower:top"), ("lower:top", "upper:bottom")):
        ties = [Tied(*faces, slave=True), Equation([((0.02, 0.02, 0.08), "x", 1.0), ((0.02, 0.0, 0.08), "x", -1.0)])]
        bodies = join(lower=lower, upper=upper)
        solution = ContactProblem(bodies, materials, held, law, loads, ties=ties, **given).solve()
        for member in solution.problem.elasticity.members:
            z = member.body.x[:, 2]
            expected = COLD + flux * z / 50.0 if member.name == "lower" else HOT - flux * (0.08 - z) / 200.0
            assert np.abs(solution.heat.temperature[member.nodes] - expected).max(initial=0.0) <= 1e-10 * (HOT - COLD)
        assert flows(solution.heat)["heat_temperature_upper:top"] == pytest.approx(flux * 4e-4, rel=1e-10)
        assert solution.valid and abs(solution.heat.imbalance) <= 1e-10 * flux * 4e-4


def test_a_sector_conducts_as_the_whole():
    """A quarter of a block with the axis at an edge, under a flux with the symmetry of the axis and of no plane."""

    def temperature(whole):
        n, corner = (4, 0.5) if whole else (2, 0.0)
        size = (1.0, 1.0, 0.5) if whole else (0.5, 0.5, 0.5)
        mesh = box(size, (n, n, 2), place=lambda x: np.stack([x[0] - corner, x[1] - corner, x[2]]))
        flux = HeatLoad("top", flux=lambda x: 1e5 * x[0] * x[1] * (x[0] ** 2 - x[1] ** 2) + 1e3)
        ties = [] if whole else [CyclicSymmetry("left", "front", sectors=4)]
        contact, heat = Contact("bottom", 0.0), [flux, HeatLoad("bottom", temperature=COLD)]
        given = {"heat": heat, "reference_temperature": COLD, "ties": ties}
        answer = ContactProblem(mesh, steel(1e-6), [Clamp("top")], contact, **given).solve()
        assert answer.valid
        x = np.concatenate(comm.allgather(answer.problem.elasticity.x))
        return x, np.concatenate(comm.allgather(answer.heat.temperature))

    (x, one), (y, part) = temperature(True), temperature(False)
    there = np.linalg.norm(y[:, None] - x, axis=2).argmin(axis=1)
    assert np.ptp(one[np.abs(x[:, 2] - 0.5) < 1e-9]) > 1.0
    assert np.abs(part - one[there]).max() <= 1e-9 * np.abs(one - COLD).max()


@pytest.mark.parametrize(("constant", "exponent"), [(0.0, 0.95), (300.0, 1.0)])
def test_conductance_by_pressure(constant, exponent):
    """h = constant + factor (p/H)^n at the pressure of the load."""
    solution = two_bars(ThermalContact(constant, 5e4, 1e9, exponent), pressure=3e6).solve()
    h = constant + 5e4 * (3e6 / 1e9) ** exponent
    flux = (HOT - COLD) / (0.05 / 50.0 + 1.0 / h + 0.03 / 200.0)
    assert flows(solution.heat)["heat_temperature_upper:top"] == pytest.approx(4e-4 * flux, rel=1e-8)


def test_flux_film_source_and_foundation():
    """A bar with a source on a cold foundation, heated by a flux or a film on the other end: a parabola, by 1 m^2 of
    second-order elements."""
    k, source, length, h, below, film, ambient = 50.0, 2e5, 0.05, 800.0, 5.0, 300.0, 400.0
    mesh = box((0.02, 0.02, length), (2, 2, 3), "tetrahedron", degree=2)
    # k T'(0) = h (T(0) - below); T = T0 + g z - s z^2/(2 k); k T'(L) = flux, or film (ambient - T(L))
    for load, slope, right in (
        (HeatLoad("top", flux=1e4), (0.0, k), 1e4 + source * length),
        (
            HeatLoad("top", film=film, ambient=ambient),
            (film, k + film * length),
            film * ambient + source * length + film * source * length**2 / (2.0 * k),
        ),
    ):
        T0, g = np.linalg.solve([[h, -k], slope], [h * below, right])
        problem = ContactProblem(
            mesh,
            steel(),
            [SymmetryPlane("left"), SymmetryPlane("front")],
            Contact("bottom", 0.0, thermal=ThermalContact(conductance=h, temperature=below)),
            [Pressure("top", 1e6)],
            heat=[load, HeatLoad(source=source)],
            reference_temperature=20.0,
        )
        heat = problem.solve().heat
        z = problem.elasticity.x[:, 2]
        expected = T0 + g * z - source * z**2 / (2.0 * k)
        assert np.abs(heat.temperature - expected).max(initial=0.0) <= 1e-10 * over.max(np.abs(expected))
        found = flows(heat)
        assert found["heat_heat_source"] == pytest.approx(source * length * 4e-4)
        assert found["heat_foundation_bottom"] == pytest.approx(-k * g * 4e-4, rel=1e-9)
        assert heat.balanced and heat.power_in == pytest.approx(k * g * 4e-4, rel=1e-9)


YOUNG, EXPANSION, LENGTH, WARM, PLATE, FACTOR = 2e11, 1.2e-5, 0.05, 80.0, 20.0, 4e4


def bar_on_a_plate(cell="hexahedron", degree=1, **load):
    """A bar whose lower end is held and warm, its upper end on a cold plate: more pressure lets more heat through."""
    return ContactProblem(
        box((0.02, 0.02, LENGTH), (2, 3, 4), cell, degree=degree),
        steel(EXPANSION, poisson=0.0),
        [Clamp("bottom", "z"), *(SymmetryPlane(side) for side in SIDES)],
        Contact(
            "top",
            0.0,
            foundation=Plane((0.0, 0.0, LENGTH), (0.0, 0.0, -1.0)),
            thermal=ThermalContact(factor=FACTOR, hardness=1e9, exponent=1.0, temperature=PLATE),
            **load,
        ),
        heat=[HeatLoad("bottom", temperature=WARM)],
        reference_temperature=20.0,
        small_strain="warn",
    )


def of_pressure(p):
    """The heat flux through the bar under a pressure, W/m^2, and the strain that it would cause."""
    flux = (WARM - PLATE) / (LENGTH / 50.0 + 1e9 / (FACTOR * p))
    return flux, EXPANSION * (WARM - flux * LENGTH / 100.0 - 20.0)


@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_thermal_strain_and_conductance_agree(cell, degree):
    """The heat of the bar presses it on the plate."""
    solution = bar_on_a_plate(cell, degree).solve()
    p = brentq(lambda p: YOUNG * of_pressure(p)[1] - p, 1e6, 1e9, xtol=1.0, rtol=1e-14)
    assert solution.valid and solution.heat.balanced
    pressure = solution.at_nodes.pressure
    assert np.abs(pressure - p).max(initial=0.0) <= 1e-7 * p
    mean = solution.at_nodes.totals()["normal_force"] / 4e-4
    assert mean == pytest.approx(p, rel=1e-8)
    assert solution.heat.rounds > 2  # one is not enough


def test_a_plate_under_a_force_follows_the_expansion():
    """The force gives the pressure, this the heat that flows, and both how far the plate moves."""
    solution, p = bar_on_a_plate(force=(None, None, -4e3)).solve(), 1e7
    flux, strain = of_pressure(p)
    assert solution.valid and solution.heat.balanced
    assert flows(solution.heat)["heat_foundation_top"] == pytest.approx(-flux * 4e-4, rel=1e-8)
    moved = solution.loaded_foundations[0].translation
    assert moved == pytest.approx((0.0, 0.0, (strain - p / YOUNG) * LENGTH), rel=1e-8)


def slider(share=0.3, expansion=0.0, factor=2e4):
    """A block that is pressed on a cold floor, then pushed along x at 2 mm/s, faster than it sticks."""
    return ContactProblem(
        box((0.04, 0.02, 0.02), (4, 2, 3)),
        steel(expansion),
        [
            PrescribedDisplacement("top", (0.0, 0.0, -2e-6), "yz", amplitude=[(0.0, 0.0), (1.0, 1.0)]),
            PrescribedDisplacement("top", (2e-3, 0.0, 0.0), "x", amplitude=[(1.0, 0.0), (2.0, 1.0)]),
        ],
        Contact("bottom", 0.3, thermal=ThermalContact(factor=factor, hardness=1e8, temperature=25.0, share=share)),
        heat=[HeatLoad("top", temperature=30.0), HeatLoad("front", film=100.0, ambient=30.0)],
        reference_temperature=25.0,
    )


@pytest.mark.parametrize("expansion", [0.0, 1e-5])
def test_friction_power_in_is_heat_flux_out(expansion):
    """Power of friction is its coefficient times normal force times speed; all of it flows out, most of what the floor
    does not take at once through the top."""
    share, steps = 0.3, []
    problem = slider(share, expansion)
    history = LoadHistory([1.0, 1.5, 1.75, 1.8], tolerance=1e-10)
    for step in history.steps(problem):
        totals = step.solution.at_nodes.totals()
        steps.append((step.solution.heat, totals["normal_force"], totals["dissipated_energy"]))
        assert step.solution.certificate.passed
    assert flows(steps[0][0])["heat_friction_bottom"] <= 1e-3 * flows(steps[1][0])["heat_friction_bottom"]
    for (heat, normal, work), duration in zip(steps[2:], (0.25, 0.05), strict=True):
        found = flows(heat)
        power = 0.3 * normal * 2e-3
        tolerance = 1e-7 if expansion == 0.0 else 1e-2  # heat changes the shape, and so the slip
        assert found["heat_friction_bottom"] == pytest.approx(power, rel=tolerance)
        assert found["heat_friction_bottom"] == pytest.approx(work / duration, rel=1e-9)
        out = -sum(value for name, value in found.items() if name != "heat_friction_bottom")
        assert out == pytest.approx(found["heat_friction_bottom"], rel=1e-8)
        conducted = heat.through[0]
        assert found["heat_foundation_bottom"] == pytest.approx(
            -(1.0 - share) * found["heat_friction_bottom"] - conducted
        )
        assert heat.balanced


def test_a_loose_tolerance_leaves_certified_heat():
    """A solve that starts from the forces of the round before would end at once with the certificate that it has."""
    changes = ["solver.tolerance=1e-6", "history.times=[1.0]"]
    case = read_case(ROOT / "demos" / "hot_disc_brake.toml", changes)
    for step in case.load_history().steps(case.problem()):
        assert step.solution.certificate.passed and step.solution.heat.balanced and step.halvings == 0


def test_heat_of_friction_is_shared_by_a_pair():
    """Without conduction through the contact each body gets its share, whichever is the slave."""
    slaves = set()
    for cells in ((4, 1, 1), (12, 4, 1)):
        lower = box((0.06, 0.02, 0.02), cells)
        upper = moved(box((0.03, 0.02, 0.02), (4, 2, 1)), (0.01, 0.0, 0.02))
        top = [
            PrescribedDisplacement("upper:top", (0.0, 0.0, -2e-6), "yz", amplitude=[(0.0, 0.0), (1.0, 1.0)]),
            PrescribedDisplacement("upper:top", (1e-4, 0.0, 0.0), "x", amplitude=[(1.0, 0.0), (2.0, 1.0)]),
        ]
        problem = ContactProblem(
            join(lower=lower, upper=upper),
            steel(),
            [Clamp("lower:bottom"), *top],
            Contact("upper:bottom", 0.3, against="lower:top", thermal=ThermalContact(share=0.8)),
            heat=[HeatLoad("upper:top", temperature=20.0), HeatLoad("lower:bottom", temperature=20.0)],
            reference_temperature=20.0,
        )
        slaves.add(problem.contacts[0].face)
        *_, last = LoadHistory([1.0, 1.5, 2.0]).steps(problem)
        found = flows(last.solution.heat)
        power = next(value for name, value in found.items() if "friction" in name)
        assert power > 0.0 and last.solution.heat.balanced
        assert found["heat_temperature_upper:top"] == pytest.approx(-0.8 * power, rel=1e-7)
        assert found["heat_temperature_lower:bottom"] == pytest.approx(-0.2 * power, rel=1e-7)
    assert slaves == {"upper:bottom", "lower:top"}


def test_a_body_without_a_fixed_temperature_is_refused():
    problem = two_bars(ThermalContact(), heat=[HeatLoad("lower:bottom", temperature=COLD)])
    with pytest.raises(
        HeatNotConverged, match="nothing fixes the temperature of upper: give one of its faces"
    ) as error:
        problem.solve()
    last = problem.solution(error.value.result)  # as it is written
    assert not last.valid and [check.name for check in last.certificate.checks if not check.passed] == ["heat"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "give one of temperature, flux, film, source, but none is given"),
        ({"flux": 1.0}, "temperature, flux and film are on a face"),
        ({"face": "top", "source": 1.0}, "a source is in the volume"),
        ({"face": "top", "film": -1.0, "ambient": 20.0}, "film must be a positive number"),
        ({"face": "top", "flux": float("nan")}, "flux must be a finite number"),
        ({"face": "top", "flux": 1.0, "body": "lower"}, "body goes with source"),
    ],
)
def test_wrong_heat_loads(arguments, message):
    with pytest.raises(ValueError, match=message):
        HeatLoad(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"conductance": -1.0}, "conductance must be a number >= 0"),
        ({"hardness": 0.0}, "hardness must be a number > 0"),
        ({"share": 1.5}, "share must be a number from 0 to 1"),
        ({"temperature": float("inf")}, "temperature must be a finite number"),
    ],
)
def test_wrong_thermal_contacts(arguments, message):
    with pytest.raises(ValueError, match=message):
        ThermalContact(**arguments)


def test_wrong_problems_with_heat():
    """Every rank says the same."""
    mesh, top = box((1.0, 1.0, 1.0), (2, 2, 2)), [HeatLoad("top", temperature=20.0)]

    def posed(material=None, heat=top, thermal=None, **others):
        contact = Contact("bottom", 0.0, thermal=thermal or ThermalContact())
        return ContactProblem(mesh, material or steel(), [Clamp("top")], contact, heat=heat, **others)

    assert "needs the conductivity" in same_error(lambda: posed(Material(1e9, 0.3, expansion=0.0)))
    assert "needs the thermal expansion" in same_error(lambda: posed(Material(1e9, 0.3, conductivity=1.0)))
    assert "give heat or temperature" in same_error(lambda: posed(temperature=30.0))
    assert "'roof'" in same_error(lambda: posed(heat=[HeatLoad("roof", temperature=20.0)]))
    assert "there is no body 'lower'" in same_error(lambda: posed(heat=[HeatLoad(source=1.0, body="lower")]))
    assert "must be a list of HeatLoad" in same_error(lambda: posed(heat=["top"]))
    assert "into the foundation: give its temperature" in same_error(
        lambda: posed(thermal=ThermalContact(conductance=1.0))
    )
    with pytest.raises(ValueError, match="temperature is for rigid foundations"):
        Contact("bottom", 0.0, against="top", thermal=ThermalContact(temperature=20.0))
    two = join(a=mesh, b=moved(box((1.0, 1.0, 1.0), (2, 2, 2)), (0.0, 0.0, 1.0)))
    arguments = (two, steel(), [Clamp("b:top")], Contact("a:bottom", 0.0))
    tied = {"ties": [Tied("a:top", "b:bottom", slave=True)], "heat": [HeatLoad("a:top", temperature=20.0)]}
    assert "'a:top' follows 'b:bottom'" in same_error(lambda: ContactProblem(*arguments, **tied))
