"""What other programs and people call the keys and tables of a case: a wrong word is answered with the right line.

The words are those of CalculiX, Abaqus, FEBio, MOOSE and of textbooks.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from typing import Any, Final

_EVERYWHERE: Final = {
    "face": "boundary on side sides set nset surface_set faces surfaces sideset side_set region_name",
    "amplitude": "factor time_function curve function load_curve loadcurve ramp",
}
"""Keys that many tables have, and other words for them."""

_KEYS: Final = {
    "contact": {
        "friction": "mu mu_s coefficient coefficient_of_friction friction_coefficient fric_coeff cof fc coulomb",
        "against": "master opposite target other primary secondary second_face main",
        "gap": "clearance offset initial_gap",
        "friction_limit": "taumax tau_max shear_limit shear_stress_limit max_shear",
        "slip_stress": "tresca shear_strength yield_shear",
        "adjust": "search_tolerance position_tolerance",
    },
    "material": {
        "young": "e e1 youngs young_modulus youngs_modulus modulus elastic elasticity elastic_modulus",
        "poisson": "nu v poissons poisson_ratio poissons_ratio",
        "density": "rho",
        "expansion": "cte alpha_t thermal_expansion expansion_coefficient",
        "conductivity": "k thermal_conductivity",
        "cells": "group elset elements block material_group volume",
    },
    "traction": {"value": "traction t load vector stress force"},
    "pressure": {"value": "p pressure magnitude load"},
    "total_force": {"force": "value f load vector total"},
    "clamp": {"components": "dofs dof directions axes component", "value": "displacement u"},
    "prescribed_displacement": {"components": "dofs dof directions axes", "value": "displacement u"},
    "spring": {"stiffness": "k value spring_constant"},
    "mesh": {"file": "path filename mesh name", "cells": "divisions elements", "box": "lengths dimensions"},
    "history": {"times": "steps_at time_points", "steps": "n number", "end": "period total_time"},
    "solver": {"tolerance": "tol residual eps"},
    "output": {"directory": "folder path dir name"},
}
"""Of every table, its keys and other words for them."""

_NEEDLESS: Final = (
    "penalty penalty_parameter stiffness c_normal c_tangential normal_penalty stick_slope augmented laugon "
    "two_pass stabilize stabilise formulation surface_behavior hard"
).split()
"""What contact has elsewhere, and does not need here."""

_TABLES: Final = {
    "clamp": "fixed fix boundary bc bcs support supports encastre dirichlet constraint constraints spc clamps",
    "contact": "contacts contact_pair contact_pairs contactpair interaction interactions",
    "material": "materials elastic",
    "traction": "load loads tractions neumann dload dsload surface_load",
    "total_force": "force forces cload",
    "pressure": "pressures",
    "prescribed_displacement": "displacement displacements motion motions",
    "symmetry": "symmetries xsymm ysymm zsymm symmetry_plane",
    "body": "bodies part parts instance",
    "history": "steps step time times increments executioner",
    "tie": "ties tied bonded glue",
    "solver": "solvers",
    "output": "outputs",
}
"""Tables, and other words for them."""

_EXAMPLES: Final = {
    **{"young": 2.1e11, "poisson": 0.3, "density": 7850.0, "expansion": 1.2e-5, "friction": 0.3, "slip_stress": 1e7},
    **{"face": "left", "against": "lower:top", "file": "part.msh", "box": [3.0, 1.0, 1.0], "cells": [30, 10, 10]},
    **{"times": [0.5, 1.0], "tolerance": 1e-8, "directory": "results/block", "distance": 1e-4, "c1": 3e5, "c2": 1e5},
    **{"bulk": 1e9, "mu": [4e5], "alpha": [2.0], "cohesion": 1e6, "friction_limit": 1e8, "decay_speed": 0.1},
    **{"static": 0.3, "kinetic": 0.2, "coefficient": [0.3, 0.2], "pressure": [0.0, 1e7], "shear": [4e9, 4e9, 5e9]},
}
"""Values of keys, for those that are missing or out of bounds."""


def line(key: str, value: Any) -> str:
    """Of a case file."""
    if isinstance(value, Mapping):
        return f"{key} = {{ {', '.join(line(name, one) for name, one in value.items())} }}"
    return f"{key} = {_toml(value)}"


def _toml(value: Any) -> str:
    if isinstance(value, float):
        short = f"{value:g}"
        return short if "e" in short and float(short) == value else repr(value)
    return f"[{', '.join(map(_toml, value))}]" if isinstance(value, list) else json.dumps(value, ensure_ascii=False)


def example(key: str) -> str:
    """A line with a usual value; empty for keys without one."""
    return line(key, _EXAMPLES[key]) if key in _EXAMPLES else ""


def right(table: str, word: str, value: Any, known: Collection[str]) -> str:
    """What to write in place of a word that a table ("" for the whole case) does not know among its `known` keys, in
    words that end with the line; empty if nothing is known."""
    word, last = word.lower(), table.rpartition(".")[2]
    last = "contact" if last in ("region", "pair", "auto_contact") else last  # which have keys of a contact
    if not table:
        return _table(word, value)
    if last == "contact" and word in _NEEDLESS:
        return "leave it out: contact and friction are exact, without penalty"
    if last == "contact" and word == "interference" and isinstance(value, int | float):
        return f"write {line('gap', -abs(value))}"
    if last == "solver" and word == "nlgeom":
        return f"write {line('kinematics', 'large' if value in (True, 'YES', 'yes') else 'small')}"
    for key, words in {**_EVERYWHERE, **_KEYS.get(last, {})}.items():
        if word in words.split() and key in known:
            return f"write {line(key, value)}"
    return ""


def _table(word: str, value: Any) -> str:
    """The table that a word at the top of a case means, with what was given below it."""
    for name, words in _TABLES.items():
        if word in words.split():
            one = value[0] if isinstance(value, list) and value and isinstance(value[0], Mapping) else value
            below = dict(one) if isinstance(one, Mapping) else {"face": one} if isinstance(one, str) else {}
            several = name not in ("material", "history", "solver", "output") or isinstance(value, list)
            header = f"[[{name}]]" if several and name != "history" else f"[{name}]"
            lines = [line(str(key), given) for key, given in below.items()]
            return f"write {header}" + (f", and below it {', '.join(lines)}" if lines else "")
    return ""
