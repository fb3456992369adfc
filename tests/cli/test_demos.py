"""The demos run, and their printed numbers agree with formulas and references.

Numbers are read from the output of a demo, so that a reader finds the asserted numbers there.
"""

import csv
import functools
import json
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, reference, run_coulomb, run_python, run_script

DEMOS = sorted((ROOT / "demos").glob("*.py"))
CASES = sorted((ROOT / "demos").glob("*.toml"))
NUMBER = r"([-+]?\d+\.?\d*(?:e[-+]?\d+)?)"


FEWER = {
    "ball_joint.toml": ["history.times=[1.0, 2.0]"],
    "bolted_flange.toml": ["history.times=[1.0, 2.0]"],
    "disc_brake.toml": ["history.times=[1.0, 1.1, 2.0]"],
    "drum_brake.toml": ["history.times=[1.0, 1.2, 2.0, 2.2, 2.6, 4.0, 5.0, 6.0, 10.0, 15.0]"],
    "hot_disc_brake.toml": ["history.times=[1.0, 1.02]"],
    "lap_joint.toml": ["history.times=[1.0, 1.2, 2.0]"],
    "o_ring.toml": ["history.times=[0.25, 1.0, 1.5]"],
    "seal.toml": ["history={times=[0.25, 0.5, 0.75, 0.875, 1.0]}"],
    "tread_block.toml": ["history.times=[1.0, 1.125, 1.5, 2.0]"],
}
"""Demos with fewer load steps than for their users; the others run unchanged."""


@functools.cache
def ran(demo):
    """A demo, a script or a case: what it prints, and its summaries by the names of their directories.

    `block.py` runs in a process of its own, as by a user, and `block.toml` draws its picture; the others without both,
    which take a second each.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = ROOT / "demos" / demo
        if demo == "block.py":
            done = run_python(file, cwd=folder)
        elif file.suffix == ".py":
            done = run_script(file, cwd=folder)
        else:
            changes = [] if demo == "block.toml" else ["output.picture=false", *FEWER.get(demo, ())]
            words = [word for one in changes for word in ("--set", one)]
            done = run_coulomb("run", file, *words, "--output", f"results/{file.stem}", cwd=folder)
        found = {path.parent.name: json.loads(path.read_text()) for path in Path(folder).glob("results/*/summary.json")}
        for path in Path(folder).glob("results/*/history.csv"):
            with path.open(newline="") as file:
                found[path.parent.name]["rows"] = list(csv.DictReader(file))
    return done.stdout, found


def columns(demo):
    """Numbers of history.csv by the names of their columns."""
    rows = ran(f"{demo}.toml")[1][demo]["rows"]
    return {
        name: np.array([float(row[name] or "nan") for row in rows])
        for name, value in rows[0].items()
        if value != "True"
    }


def said(demo):
    return ran(demo)[0]


def table(text, pattern):
    """The numbers of every line that fits, a row for each; `#` in the pattern is a number."""
    found = re.findall(pattern.replace("#", NUMBER), text, flags=re.MULTILINE)
    assert found, f"no line {pattern!r} in:\n{text}"
    return np.array([line if isinstance(line, tuple) else (line,) for line in found], dtype=float)


def line(text, pattern):
    """The numbers of the only line that fits."""
    (found,) = table(text, pattern)
    return found


@pytest.mark.parametrize("demo", [path.name for path in DEMOS])
def test_every_script_is_certified(demo):
    assert "certificate passed" in said(demo) and "FAILED" not in said(demo)


def test_every_demo_has_a_test():
    tested = {name.removeprefix("test_demo_") for name in globals()}
    assert {path.stem for path in (*DEMOS, *CASES)} <= tested


def test_demo_block():
    """Both methods give the forces of the independent solver; the residual falls by the printed contraction."""
    text, (totals, _) = said("block.py"), reference(10, "coulomb")
    expected = [*totals["tangential_force_on_body_N"], totals["total_normal_force_N"]]
    force = line(text, r"force of the foundation on the block: #, #, # N")
    assert force == pytest.approx(expected, rel=1e-5)  # six digits are printed
    problems, rate = line(text, r"^Tresca problems +- +#$")[0], line(text, r"^contraction +- +#$")[0]
    steps, products = line(text, r"^path-following steps +# +#$"), line(text, r"^products by A +# +#$")
    residuals = line(text, r"^Coulomb residual +# +#$")
    assert max(residuals) <= 1e-8 and line(text, r"two answers differ by # of the forces")[0] <= 1e-6
    assert steps[0] < steps[1] and products[0] < 0.5 * products[1]
    history = table(text, r"^ +(\d+) +(\d\.\de[-+]\d\d) +(nan|\d[\d.]*)$")
    assert list(history[:, 0]) == list(range(1, int(problems) + 1)) and history[-1, 1] == residuals[1]
    assert np.isnan(history[0, 2]) and not np.isnan(history[1:, 2]).any()  # the first has none before it
    mean = (history[-1, 1] / history[0, 1]) ** (1.0 / (problems - 1.0))
    assert 0.0 < rate < 1.0 and 0.7 < mean / rate < 1.4


def test_successive_tresca_by_the_command_of_the_docs(tmp_path):
    """The command, and the contraction it prints."""
    page = (ROOT / "docs" / "methods.md").read_text()
    (command,) = re.findall(r"`coulomb (run demos/block\.toml --set solver\.method=[\w-]+)`", page)
    small = ("--set", "mesh.cells=[12,4,4]", "--set", "output.picture=false")
    done = run_coulomb(*command.split(), *small, "--output", tmp_path, cwd=ROOT)
    problems, rate = line(done.stdout, r"^converged \(successive Tresca\): .* # Tresca problems, .* contraction #$")
    assert problems >= 3 and 0.0 < rate < 1.0


def test_demo_outer_loops():
    """Four loops, whose results over those of the formulas are printed."""
    ratios = re.findall(r"(\w+): ([\d.]+) of the formula", said("outer_loops.py"))
    assert [name for name, _ in ratios] == ["plasticity"] * 3 + ["viscoelasticity"] * 4 + ["heat", "tool"]
    assert all(abs(float(ratio) - 1.0) < 1e-6 for _, ratio in ratios)


def test_demo_hertz():
    """Radius and pressure beside the formulas of the same force; (h/a)^2/6 with six cells to the radius."""
    text = said("hertz.py")
    force, radius, formula = line(text, r"P = # N: a = # mm, by the formula # mm")
    pressure, known = line(text, r"largest pressure # MPa, by the formula # MPa")
    expected = (0.75 * force * 0.1 * (1.0 - 0.3**2) / 2.1e11) ** (1.0 / 3.0)
    assert formula == pytest.approx(1e3 * expected, abs=1e-4)  # digits printed, here and of P
    assert radius == pytest.approx(formula, rel=1.0 / 216.0)
    assert pressure == pytest.approx(known, rel=1.0 / 216.0)


def test_demo_cattaneo_mindlin():
    """Mindlin's curve for loading: to (h/a)^2/6 of F P with three cells to the radius."""
    text, allowed = said("cattaneo_mindlin.py"), 1.0 / 9.0 / 6.0
    force, reach = line(text, r"pressed: P = # N; all slips from d = # m on")
    radius = (0.75 * force * 0.1 * (1.0 - 0.3**2) / 2.1e11) ** (1.0 / 3.0)
    assert reach == pytest.approx(0.3 * force / (8.0 * radius) * 1.3 * 1.7 / 2.1e11, rel=1e-4)
    way, pull, stick, slip = table(text, r"displacement # d, Q = # F P, # nodes stick, # slip").T
    assert len(way) == 20 and np.all(stick + slip == stick[0] + slip[0])

    assert pull[:4] == pytest.approx(1.0 - (1.0 - way[:4]) ** 1.5, abs=allowed)
    assert pull[12:] == pytest.approx(-pull[4:12], abs=1e-3)  # there and back alike; Masing's branches: in verification
    # a loop encloses 8 (integral of the first branch less its triangle), loading a quarter of that
    curve = 0.85 - 0.4 * (1.0 - 0.15**2.5) - 0.5 * 0.85 * (1.0 - 0.15**1.5)
    dissipated = line(text, r"dissipated from the first move on: # J")[0] / (0.1 * force * reach)
    assert dissipated == pytest.approx(10.0 * curve, rel=0.25)  # four steps to a branch, a difference of two areas


def test_demo_patch():
    """A uniform state of stress is exact for linear elements: to the residual, 1e-10, times what A amplifies."""
    text = said("patch.py")
    for name, known in (("pressure", 4e7), ("friction", -1.2e7)):
        least, most, expected = line(text, rf"{name} # to # Pa, known #")
        assert expected == known and [least, most] == pytest.approx([known, known], rel=1e-8)
    assert line(text, r"displacement to # of the slip")[0] <= 1e-8


def test_demo_press_fit():
    """Linear elements are of second order: the pressure is too high by about (h/a)^2/6, and the force as much."""
    text = said("press_fit.py")
    for pattern in (r"pressure # Pa, Lame # Pa", r"pull-out force # N, F p A = # N"):
        found, known = line(text, pattern)
        assert found == pytest.approx(known, rel=(1.0 / 6.0) ** 2 / 6.0)


def test_demo_sliding_block():
    """|T| is at most F N, and equal to it after enough slip in either direction; energies balance."""
    text = said("sliding_block.py")
    way, ratio, stick, slip = table(text, r"# mm: T = # F N, # nodes stick, # slip").T
    assert len(way) == 41 and np.all(stick + slip == 36) and np.all(np.abs(ratio) <= 1.0 + 2e-9)
    assert way == pytest.approx([*np.arange(0, 2.05, 0.1), *np.arange(1.9, -0.05, -0.1)], abs=1e-9)
    assert ratio[[20, 40]] == pytest.approx([-1.0, 1.0], abs=2e-9)
    assert np.all(ratio[:21] <= 1e-9) and np.all(np.diff(ratio[:21]) <= 1e-9) and np.all(np.diff(ratio[20:]) >= -1e-9)
    assert stick[20] == stick[40] == 0 and stick[21] > 30  # after the reversal it sticks again
    work, elastic, dissipated = line(text, r"work # J: # J elastic, # J dissipated by friction,")
    missing = line(text, r"and # J time-stepping error")[0]
    assert work - elastic - dissipated == pytest.approx(missing, abs=2.0)  # printed to a joule
    assert abs(missing) < 0.01 * dissipated


def test_demo_identify_friction():
    """The truth is inside the bars of a fit that starts from half of one and a third of the other; they are narrow."""
    text = said("identify_friction.py")
    friction, modulus = (line(text, rf"{name} # \+- # \(95 %\), true #") for name in ("friction", "modulus"))
    for value, bar, true in (friction, modulus):
        assert abs(value - true) < bar < 0.05 * true
    assert line(text, r"# load histories of 10 steps")[0] <= 15


def test_demo_bolt_preload():
    """At the least preload more force takes off the same slip at bolts above their least force, and less at others; it
    is half of what the same force on every bolt would be."""
    text = said("bolt_preload.py")
    forces, rates = (
        line(text, rf"{begin} #, #, #, # {end}")
        for begin, end in (("least preloads", r"kN, slip [\d.]+ um"), ("less slip of that corner:", "nm per kN"))
    )
    above = forces > 5.001
    assert np.ptp(rates[above]) < 0.1 * rates.max() and np.all(rates[~above] < 0.5 * rates[above].min())
    assert line(text, r"least preloads .* kN, slip # um")[0] == pytest.approx(4.0, rel=1e-3)
    together, even = line(text, r"in all # kN; four that are the same # kN")
    assert together == pytest.approx(forces.sum(), abs=0.03) and even > 1.8 * together
    assert line(text, r"# load histories")[0] <= 40


def test_demo_even_pressure():
    """The profile found by the adjoint is the shape of the punch under an even pressure, to 1 % of its depth."""
    text = said("even_pressure.py")
    low, high = line(text, r"flat punch: pressure # to # kPa, valid: True")
    assert high > 1.3 * low
    low, high = line(text, r"its profile found: pressure # to # kPa, valid: True")
    assert high < 1.003 * low
    depth, apart = line(text, r"profile # um deep; the shape under an even pressure is within # um")
    assert apart < 0.01 * depth
    assert line(text, r"# steps of L-BFGS")[0] <= 30


def test_demo_paper():
    """Sizes of Table 1's first line, a path that falls to the tolerance, few products, and Theorem 1's bound."""
    text = said("paper.py")
    assert list(line(text, r"^#/# unknowns$")) == [3 * 30 * 11 * 11, 3 * 30 * 11]  # the clamped face is not free
    step, theta, alpha, krylov, residual = table(text, r"^ +(\d+) +# +# +(\d+) +#$").T
    assert list(step) == list(range(1, len(step) + 1)) and len(step) < 25
    assert np.all(np.diff(theta) < 0.0) and np.all((alpha > 0.0) & (alpha <= 1.0)) and np.all(krylov >= 1)
    assert residual[-1] <= 1e-8 < residual[-2] and np.all(alpha[-3:] >= 0.95)  # full steps at the end
    augmented, other = (line(text, rf"{name}System: # steps, # products") for name in ("Augmented", "SchurComplement"))
    assert abs(augmented[0] - other[0]) <= 3 and max(augmented[1], other[1]) < 300
    path, active = line(text, r"to a residual of 1e-6: PF # products, KPRGP #$")
    assert active > 10 * path
    plain, preconditioned = line(text, r"cond\(J_AM\) ends at #, cond\(P_AM\^-1 J_AM\) at #$")
    assert plain > 1e9 and preconditioned < 1e4


def steps_of(demo):
    """Of a history, per step: number, time, normal force, force along x, y, z."""
    return [columns(demo)[name] for name in ("step", "time", "normal_force", "force_x", "force_y", "force_z")]


def test_demo_history():
    """Friction is at most F N, opposite to the plate's motion, and F N when all nodes slide."""
    number, time, normal, along, _, up = steps_of("history")
    assert list(number) == list(range(1, 25)) and time == pytest.approx(0.25 * number)
    assert up == pytest.approx(normal) and np.all(np.abs(along) <= 0.5 * normal * (1.0 + 1e-5))
    assert along[[15, 23]] == pytest.approx([0.5, -0.5] * normal[[15, 23]], rel=1e-3)  # after 4 mm there, 4 mm back
    energies = ("loads", "prescribed", "foundation", "elastic", "dissipated", "imbalance")
    loads, clamps, foundation, elastic, friction, error = (
        columns("history")[f"energy_{name}"][-1] for name in energies
    )
    assert loads == foundation == 0.0 and clamps - elastic - friction == pytest.approx(error, rel=0.1)
    words = [line(said("history.toml"), rf"{name} # m?J")[0] for name in ("displacements", "elastic", "friction")]
    assert words == pytest.approx([clamps, 1e3 * elastic, friction], rel=1e-3)
    path = 4e-3 * 0.5 * normal[15]  # two displacements of 4 mm under F N, less the deformation of the rubber
    assert 0.5 * path < friction < 2.5 * path


def test_demo_foot():
    """The floor carries the machine, and by friction the push, 0.4 of its weight, until the release."""
    _, time, normal, along, across, _ = steps_of("foot")
    assert time == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.5, 3.0])
    weight = normal[1]
    assert normal == pytest.approx(weight * np.array([0.5, 1.0, 1.0, 1.0, 1.0, 1.0]), rel=1e-5)  # digits printed
    assert along == pytest.approx(-weight * np.array([0.0, 0.0, 0.2, 0.4, 0.2, 0.0]), abs=1e-5 * weight)
    assert across == pytest.approx(np.zeros(6), abs=1e-8 * weight)


def test_demo_pulled_block():
    """Once the whole face slips, the grip pulls with F N; the printed digits, and a little slip sideways."""
    text = said("pulled_block.toml")
    _, _, normal, along, across, _ = steps_of("pulled_block")
    assert normal == pytest.approx(np.full(9, 1e6 * 0.2 * 0.1), rel=1e-5)
    assert across == pytest.approx(np.zeros(9), abs=1e-6 * normal[0])
    assert text.count("open 0, stick 0, slip 153") >= 3
    assert along[-1] == pytest.approx(-0.3 * normal[-1], rel=1e-5)
    friction = columns("pulled_block")["friction_force"]
    assert friction == pytest.approx(np.hypot(along, across), rel=1e-9) and friction[-1] < 0.3 * normal[-1] * (1 + 1e-9)


def test_demo_drum_brake():
    """The normal force of a short shoe, P b/(b -+ F c), in both directions; ten turns under the friction F N."""
    _, time, normal, *_ = steps_of("drum_brake")
    force, b, c, F, r = 2e6 * 0.03 * 0.2 * np.sin(np.radians(5.0)), 0.1, 0.05, 0.35, 0.1
    forwards, back = normal[list(time).index(2.0)], normal[list(time).index(4.0)]
    assert forwards == pytest.approx(force * b / (b - F * c), rel=0.03)  # the short shoe has no elastic lining
    assert back == pytest.approx(force * b / (b + F * c), rel=0.01)
    assert normal[-4:] == pytest.approx(np.full(4, forwards), rel=1e-3)
    friction = columns("drum_brake")["energy_dissipated"][-1]
    assert friction == pytest.approx(F * normal[-1] * r * 20.0 * np.pi, rel=1e-3)


def test_readme_example(tmp_path):
    """The code of the README runs; here on fewer cells."""
    code = (ROOT / "README.md").read_text().split("```python\n")[1].split("```")[0]
    (tmp_path / "example.py").write_text(code.replace("(30, 10, 10)", "(6, 2, 2)"))
    done = run_python(tmp_path / "example.py", cwd=tmp_path)
    assert "certificate passed" in done.stdout
    assert (tmp_path / "results" / "block" / "picture.png").exists()


def test_script_and_case_give_the_reference_answer():
    """The README's main job: p = 10 against the independent solver, from the files it leaves."""
    totals, _ = reference(10, "coulomb")
    for demo in ("block.py", "block.toml"):
        contents = ran(demo)[1]["block"]
        force = contents["force_on_body"]
        expected = totals["tangential_force_on_body_N"]
        assert force["normal"] == pytest.approx(totals["total_normal_force_N"], rel=1e-6)
        assert force["tangential"] == pytest.approx(expected, rel=1e-6)
        counts = {name: contents["nodes"][name] for name in ("open", "stick", "slip")}
        assert counts == {name: totals[name] for name in counts}
        assert contents["certificate"]["natural_residual"]["value"] <= 1e-6


def test_demo_heated_slider():
    """Friction heats by its force times 20 mm/s, and all of that heat flows out."""
    contents = ran("heated_slider.toml")[1]["heated_slider"]
    last, heat = contents["last"], contents["last"]["heat"]
    powers = {flow["name"]: flow["power"] for flow in heat["flows"]}
    assert contents["valid"] and heat["balanced"]
    friction = powers.pop("heat_friction_bottom")
    assert friction == pytest.approx(0.3 * last["totals"]["normal_force"] * 0.02, rel=1e-6)
    assert sum(powers.values()) == pytest.approx(-friction, rel=1e-8) and max(powers.values()) < 0.0


def test_demo_hot_disc_brake():
    """Friction heats by its force times the speed of the disc at the radius of the pad, 76 to 114 mm; piston, air, hub
    and carrier take that heat."""
    contents = ran("hot_disc_brake.toml")[1]["hot_disc_brake"]
    last, heat = contents["last"], contents["last"]["heat"]
    powers = {flow["name"]: flow["power"] for flow in heat["flows"]}
    assert contents["valid"] and heat["balanced"] and heat["temperature"]["min"] == pytest.approx(20.0)
    friction = powers.pop("heat_friction_pad:rub"), powers.pop("heat_friction_pad:end")
    force = 0.4 * last["faces"][0]["normal_force"] * 0.2
    assert 0.076 * force < friction[0] < 0.114 * force
    assert sum(powers.values()) == pytest.approx(-sum(friction), rel=1e-8) and max(powers.values()) < 0.0
    assert 30.0 < heat["temperature"]["max"] < 60.0 and heat["through_contacts"][0] > 0.0  # more into the disc


def test_demo_bonded_pad():
    """The bond carries what the contact presses, and the roller is beneath the middle."""
    contents = ran("bonded_pad.toml")[1]["bonded_pad"]
    (tie,), contact = contents["ties"], contents["totals"]
    assert contents["valid"] and tie["face"] == "pad:top"
    assert tie["force"] == pytest.approx([-part for part in contact["force"]], abs=1e-6)
    assert contact["centre_of_pressure"][:2] == pytest.approx([0.03, 0.015], abs=1e-3)


def test_demo_two_blocks():
    """The joint carries the load on the upper block: 0.8 m x 0.4 m at 60 MPa and 15 MPa; part of it sticks."""
    contents = ran("two_blocks.toml")[1]["two_blocks"]
    assert contents["force_on_body"]["normal"] == pytest.approx(0.32 * 6e7, rel=1e-9)
    assert contents["force_on_body"]["tangential"][0] == pytest.approx(-0.32 * 1.5e7, rel=1e-9)
    assert contents["nodes"]["open"] == 0 < min(contents["nodes"]["stick"], contents["nodes"]["slip"])


def test_demo_forms():
    """The floor carries what the body is pressed with, less what the clamp takes."""
    *force, balance = line(said("forms.py"), r"^force on the floor: \[#, #, #\] N, balance #$")
    assert balance < 1e-10 and np.hypot(force[0], force[1]) < 0.3 * -force[2] < 0.3 * 4e6 * 3.0
    assert len((ROOT / "demos" / "forms.py").read_text().splitlines()) <= 40


def test_demo_rubber_block():
    """The block sticks first, then friction over normal force is 0.3 but for the slope where it is."""
    rows = table(said("rubber_block.py"), r"^#0* s: # linear problems, T # N, N # N$")
    assert len(rows) == 10 and np.max(rows[:, 1]) <= 12
    drawn = -rows[2:, 2] / rows[2:, 3]
    assert np.all(np.diff(drawn[:4]) > 0.0) and drawn[0] < 0.15
    assert np.all(np.abs(drawn[4:] - 0.3) < 0.05)


def test_demo_belt():
    """T2/T1 grows until the belt slides, to exp(friction angle) but for its thickness."""
    rows = table(said("belt.py"), r"^#0* s: # linear problems, T2/T1 #$")
    (known,) = line(said("belt.py"), r"^exp\(friction angle\) #$")
    assert known == pytest.approx(np.exp(0.3 * np.pi), abs=1e-4) and np.max(rows[:, 1]) <= 8
    assert np.all(np.diff(rows[:, 2]) > -1e-4) and rows[0, 2] < 1.0
    assert rows[-1, 2] == pytest.approx(known, rel=0.01)


def test_demo_lap_joint():
    """The joint slips at twice F times the normal force of each side, that of the bolt but for bent plates."""
    found = columns("lap_joint")
    pull, (stick, slip) = -found["prescribed_displacement_middle:end_force_x"], (found["stick"], found["slip"])
    normal = [np.abs(found[f"middle:{face}_force_z"]) for face in ("upper", "lower")]
    for side in normal:
        assert side == pytest.approx(np.full(3, 2e4), rel=2e-3)
    assert pull[2] == pytest.approx(0.2 * (normal[0] + normal[1])[2], rel=1e-3) and pull[1] < 0.7 * pull[2]
    assert stick[1] > 50 and slip[1] > 50 and stick[2] == 0
    assert found["middle:upper_opposite_force_z"] == pytest.approx(normal[0], rel=1e-9)


def test_demo_ball_joint():
    """The torque of sliding under p ~ cos(angle) - cos(edge), that of an elastic foundation, with the computed edge."""
    found = columns("ball_joint")
    assert found["socket:cup_force_z"] == pytest.approx([-3000.0, -3000.0], rel=1e-6)
    torque, R, F = -found["socket:cup_opposite_moment_z"][1], 0.015, 0.2
    edge = np.arccos(1.0 - found["socket:cup_contact_area"][1] / (2.0 * np.pi * R**2))
    c, s = np.cos(edge), np.sin(edge)
    lever = (s**3 / 3.0 - c * (edge - s * c) / 2.0) / ((1.0 - c**3) / 3.0 - c * s**2 / 2.0)
    assert torque == pytest.approx(found["prescribed_rotation_ball:stem_moment_z"][1], rel=1e-3)
    assert torque == pytest.approx(F * 3000.0 * R * lever, rel=0.05)


def test_demo_disc_brake():
    """Torque F N r at the radius of the centre of pressure; the carrier takes the pull of the disc; forces balance."""
    found = {name: value[-1] for name, value in columns("disc_brake").items()}
    normal, torque = found["pad:rub_force_z"], found["prescribed_rotation_disc:hub_moment_z"]
    radius = np.hypot(found["pad:rub_centre_of_pressure_x"], found["pad:rub_centre_of_pressure_y"])
    assert normal == pytest.approx(3632.0 - found["pad:end_force_z"], rel=1e-6)
    assert torque == pytest.approx(0.4 * normal * radius, rel=0.02)  # the mean radius is a little larger
    assert torque == pytest.approx(-found["clamp_carrier:bolted_moment_z"], rel=1e-6)


def test_demo_tread_block():
    """It sticks at first, and slides in the end."""
    force = table(said("tread_block.toml"), r"step +# .* force \(#, #, #\) N")[:, 1:]
    assert force[-1, 0] == pytest.approx(0.8 * force[-1, 2], rel=0.02) and force[1, 0] < 0.3 * force[1, 2]


def test_demo_bolted_flange():
    """Four bolts tightened to 20 kN and locked: equal parts of the pull of 10 kN each, as the stiffer flanges let."""
    text = said("bolted_flange.toml")
    assert "all 2 load steps certified" in text
    forces = np.column_stack([columns("bolted_flange")[f"bolt_section_{k}_force"] for k in (1, 2, 3, 4)])
    assert forces[0] == pytest.approx(2e4, rel=1e-5)
    more = forces[1] - forces[0]
    assert np.ptp(more) <= 0.03 * more.mean() and 1e3 <= more.mean() <= 4e3


def test_demo_pin_joint():
    """The pairs of an assembly without named faces, with the clearances of its geometry; the pin passes the pull on."""
    text, found = ran("pin_joint.toml")
    gaps = dict(re.findall(r"^found +'(\w+)' against .*, gap (.+)$", text, flags=re.MULTILINE))
    assert "certificate passed" in text and gaps["clevis_facing_lug"] == "50 um" and len(gaps) == 3
    for name in ("clevis_facing_pin", "lug_facing_pin"):
        assert line(gaps[name], r"^# um to # um$") == pytest.approx([20.0, 20.0], abs=1.0)
    faces = {one["faces"][0]: one for one in found["pin_joint"]["faces"]}
    assert list(faces) == ["lug_facing_clevis", "clevis_facing_pin", "lug_facing_pin"]
    for name, pull in (("lug_facing_pin", -1.5e4), ("clevis_facing_pin", 1.5e4), ("lug_facing_clevis", 0.0)):
        assert faces[name]["force"][0] == pytest.approx(pull, abs=1e-3)


def test_demo_o_ring():
    """At a twentieth of its height as a long cylinder between two plates: with b^2 = 4 P R/(pi E*), P the force per
    length, they approach by (4 P/(pi E*)) (ln(4 R/b) - 1/2) (K. L. Johnson, Contact Mechanics, 5.37).  At
    the end the fluid has pushed it along lid and floor, against the wall."""
    found, radius = columns("o_ring"), 2e-3
    modulus = 6.0 * (0.6e6 + 0.15e6) / (1.0 - 0.5**2)
    force = found["above_normal_force"][0] / (2.0 * np.pi * 20e-3)
    b = np.sqrt(4.0 * force * radius / (np.pi * modulus))
    assert 4.0 * force / (np.pi * modulus) * (np.log(4.0 * radius / b) - 0.5) == pytest.approx(2e-4, rel=0.03)
    assert np.all(found["outside_normal_force"][:2] == 0.0) and found["outside_normal_force"][-1] > 50.0
    assert found["above_friction_force"][-1] == pytest.approx(0.1 * found["above_normal_force"][-1], rel=1e-4)
    assert np.abs(found["force_z"]).max() < 1e-9  # nodes at the middle, on two planes, do not slip around the axis


def test_demo_seal():
    """It meets the wall late, and all forces grow; judged contact by contact, linear problems take 184 steps."""
    text = said("seal.toml")
    assert line(text, r"; # path-following steps") <= 170
    beside = np.column_stack([columns("seal")[f"{name}_normal_force"] for name in ("beside", "above")])
    assert np.all(beside[:3, 0] == 0.0) and np.all(np.diff(beside[2:, 0]) > 0.0) and np.all(np.diff(beside[:, 1]) > 0.0)
