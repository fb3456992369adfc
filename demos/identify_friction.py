"""Friction and Young's modulus of a pad from a noisy loop of force and displacement, with confidence intervals.

A pad of plastics is pressed on a plate, and its holder moved to and fro.  The force follows the modulus while the pad
sticks, and friction while it slips.  Each evaluation of the fit is a load history and its exact derivatives along both:
the Jacobian of SciPy's least squares.  Intervals are those of the linearised fit, with the covariance s^2 (J^T J)^-1
and quantiles of Student's t (G. A. F. Seber, C. J. Wild, Nonlinear Regression, 1989, section 2.1).

python demos/identify_friction.py
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares
from scipy.stats import t

import coulomb

TIMES = [1.0, *np.linspace(1.0, 4.0, 10)[1:]]
MOVED = [(1.0, 0.0), (2.0, 3e-4), (4.0, -3e-4)]


certificates = []


def loop(friction, young):
    """Tangential forces after every step in newtons, and their derivatives along the logarithms of both."""
    problem = coulomb.ContactProblem(
        coulomb.box((0.1, 0.1, 0.05), (4, 4, 2)),
        coulomb.Material(young, 0.4),
        [coulomb.PrescribedDisplacement("top", (1.0, 0.0, 0.0), "xy", amplitude=MOVED)],
        coulomb.Contact("bottom", friction=friction),
        [coulomb.Pressure("top", 2e5, amplitude=[(0.0, 0.0), (1.0, 1.0)])],
    )
    forces, derivatives, found = [], [], []
    for step in coulomb.LoadHistory(TIMES).steps(problem):
        found = step.solution.sensitivities(found)
        by = {one.name: one.totals["bottom"]["force"][0] for one in found}
        forces.append(step.solution.forces["force"][0])
        derivatives.append([by["friction of 'bottom'"], by["young"]])
    certificates.append(step.solution.certificate)
    return np.array(forces), np.array(derivatives)


truth = np.array([0.6, 1e8])
exact, _ = loop(*truth)
noise = 0.02 * np.abs(exact).max()
measured = exact + noise * np.random.default_rng(2).normal(size=len(exact))

known: dict[bytes, tuple] = {}


def at(logarithms):
    """Forces and derivatives, computed once for each point."""
    key = logarithms.tobytes()
    if key not in known:
        known[key] = loop(*np.exp(logarithms))
        friction, young = np.exp(logarithms)
        print(f"friction {friction:.4f}, modulus {young / 1e6:.2f} MPa")
    return known[key]


fit = least_squares(
    lambda q: at(q)[0] - measured, np.log([0.3, 3e7]), jac=lambda q: at(q)[1], x_scale=[0.3, 0.3], xtol=1e-6, ftol=1e-8
)
print(certificates[-1])
left = len(measured) - 2
covariance = np.linalg.inv(fit.jac.T @ fit.jac) * (fit.fun @ fit.fun) / left
bars = t.ppf(0.975, left) * np.sqrt(np.diag(covariance))
for name, value, bar, true in zip(("friction", "modulus"), np.exp(fit.x), bars, truth, strict=True):
    print(f"{name} {value:.5g} +- {value * bar:.2g} (95 %), true {true:.5g}")
print(f"{len(known)} load histories of {len(TIMES)} steps with their derivatives")

figure = Figure(figsize=(6, 4), layout="constrained")
axis = figure.subplots()
place = 1e3 * np.interp(TIMES, *np.transpose(MOVED))
axis.plot(place, measured, "o", label="measured")
axis.plot(place, at(fit.x)[0], "-", label="fitted")
axis.set_xlabel("displacement of the holder, mm")
axis.set_ylabel("tangential force, N")
axis.legend()
Path("results").mkdir(exist_ok=True)
figure.savefig("results/identify_friction.png", dpi=110)
