"""What other programs and people call the keys and tables of a case: a wrong word is answered with the right line.

The words are those of CalculiX, Abaqus, FEBio, MOOSE and of textbooks.
"""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Collection, Mapping
from typing import Any, Final

_EVERYWHERE: Final = {
    "face": "boundary on side sides set nset surface_set faces surfaces sideset side_set region_name slave_face "
    "slave_surface secondary_face",
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
        "foundation": "plane sphere cylinder obstacle rigid_surface rigid analytical",
        "motion": "velocity displacement translation",
    },
    "foundation": {
        "shape": "type kind",
        "centre": "center origin",
        "point": "origin",
        "normal": "n normal_vector",
        "axis": "direction",
        "radius": "r",
    },
    "friction": {"static": "mu_s static_friction", "kinetic": "dynamic mu_k mu_d kinetic_friction dynamic_friction"},
    "material": {
        "young": "e e1 youngs young_modulus youngs_modulus modulus elastic elasticity elastic_modulus",
        "poisson": "nu v poissons poisson_ratio poissons_ratio",
        "density": "rho",
        "expansion": "cte alpha_t thermal_expansion expansion_coefficient",
        "conductivity": "k thermal_conductivity",
        "cells": "group elset elements block material_group volume",
    },
    "traction": {"value": "traction t load vector stress force magnitude"},
    "pressure": {"value": "p pressure magnitude load"},
    "total_force": {"force": "value f load vector total"},
    "clamp": {"components": "dofs dof directions axes component", "value": "displacement u"},
    "prescribed_displacement": {"components": "dofs dof directions axes", "value": "displacement u"},
    "spring": {"stiffness": "k value spring_constant"},
    "mesh": {
        "file": "path filename mesh name",
        "cells": "divisions elements",
        "box": "lengths dimensions",
        "cell": "type element element_type",
        "degree": "order element_order",
    },
    "pretension": {"force": "preload pretension value clamp_force f", "shortening": "length preload_length"},
    "temperature": {"value": "t temp temperature change delta_t"},
    "history": {"times": "steps_at time_points", "steps": "n number", "end": "period total_time"},
    "solver": {"tolerance": "tol residual eps"},
    "body": {"translate": "position origin offset move location shift place"},
    "output": {"directory": "folder path dir name", "format": "vtk vtu vtkhdf paraview formats file_type"},
}
"""Of every table, its keys and other words for them."""

_NEEDLESS: Final = (
    "penalty penalty_parameter stiffness c_normal c_tangential normal_penalty stick_slope augmented laugon "
    "two_pass stabilize stabilise formulation surface_behavior hard epsilon eps epsn epst kn kt normal_stiffness "
    "tangential_stiffness tied_tolerance algorithm"
).split()
"""What contact has elsewhere, and does not need here."""

_ADVICE: Final = {
    "contact": {
        "type model law": "leave it out: friction alone is Coulomb's law, slip_stress Tresca's",
        "frictionless": "write friction = 0.0",
        "static kinetic dynamic": "write friction = { static = 0.3, kinetic = 0.2, decay_speed = 0.1 }",
    },
    "material": {
        "shear_modulus g bulk_modulus k_bulk lame lambda": "give young = 9 K G/(3 K + G) and poisson = (3 K - 2 G)/(6 K"
        " + 2 G) of the shear modulus G and the bulk modulus K",
    },
    "traction": {"direction": "the value is a vector: write value = [0.0, 0.0, -1e6]"},
    "symmetry": {"axis direction normal": "leave it out: displacements along the normal of the face are 0"},
    "mesh": {"size h element_size cell_size": "write cells = [30, 10, 10], the numbers along the edges of the box"},
    "history": {"dt time_step increment initial_increment": "write steps, their number: end over the length of a step"},
    "solver": {
        "threads n_threads cpus cores nprocs": "leave it out: mpirun -n 4 coulomb run CASE.toml computes on 4 ranks",
    },
    "units": {"force forces mass time temperature energy": "leave it out: it follows from length and stress"},
    "output": {"fields variables nodeout elout": "leave it out: all fields are written"},
    "": {
        "plane plane_strain plane_stress axisymmetric dimension": 'write slice = "plane strain" (or "generalised plane '
        'strain", "plane stress", "axisymmetric") in [mesh], whose file is a mesh in 2D',
        "nlgeom": 'write [solver], and below it kinematics = "large"',
    },
}
"""Of every table, words that have no key, and what to do in their place."""

_STEEL_AND_OTHERS: Final = {
    **{"steel": (2.1e11, 0.3), "stahl": (2.1e11, 0.3), "aluminium": (7e10, 0.33), "aluminum": (7e10, 0.33)},
    **{"copper": (1.2e11, 0.34), "titanium": (1.1e11, 0.34), "rubber": (5e6, 0.45), "cast iron": (1.1e11, 0.27)},
}
"""Young's modulus in pascals and Poisson's ratio of materials that are named, about."""

_UNITS: Final = {
    **{"pa": 1.0, "kpa": 1e3, "mpa": 1e6, "gpa": 1e9, "n": 1.0, "kn": 1e3, "mn": 1e6, "n/mm2": 1e6, "n/mm^2": 1e6},
    **{"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "s": 1.0, "ms": 1e-3, "kg/m3": 1.0, "kg/m^3": 1.0, "k": 1.0},
}
"""Units that are written behind numbers, in SI."""

_NAMES_OF_UNITS: Final = {
    **{"m": "meter metre meters metres", "mm": "millimeter millimetre millimeters millimetres", "in": "inch inches"},
    **{"ft": "foot feet", "um": "micron microns micrometer micrometre", "MPa": "mpa n/mm2 n/mm^2 megapascal"},
    **{"Pa": "pascal pascals pa n/m2 n/m^2", "GPa": "gpa gigapascal", "kPa": "kpa kilopascal"},
}
"""Units of a case, and other words for them."""

_BOX_FACES: Final = {
    **{"left": "xmin x0 x- minx west", "right": "xmax x1 x+ maxx east", "front": "ymin y0 y- miny south"},
    **{"back": "ymax y1 y+ maxy north", "bottom": "zmin z0 z- minz lower base", "top": "zmax z1 z+ maxz upper"},
}
"""Faces of a box, and other words for them."""

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
    "pretension": "bolt bolts preload pretension_section screw",
    "rigid_face": "rigid rigid_body rigid_bodies coupling kinematic_coupling rbe2",
    "temperature": "thermal temperatures",
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


_AXES: Final = ("x", "y", "z")


_VECTORS: Final = ("value", "force", "gravity", "body_force", "box", "cells")


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


def example(table: str, key: str) -> str:
    """A line with a usual value of a key of a table; empty for keys without one."""
    if key == "cells" and table != "mesh":
        return f"{line(key, 'upper')}, a group of cells of the mesh ([material] is one for all)"
    return line(key, _EXAMPLES[key]) if key in _EXAMPLES else ""


def right(table: str, word: str, value: Any, known: Collection[str]) -> str:
    """What to write in place of a word that a table ("" for the whole case) does not know among its `known` keys, in
    words that end with the line; empty if nothing is known."""
    if table.rpartition(".")[2] == "material" and isinstance(value, Mapping):
        return f"materials of several groups of cells are tables [[{table}]], each with {line('cells', word)}"
    word, last = word.lower(), table.rpartition(".")[2]
    last = "contact" if last in ("region", "pair", "auto_contact") else last  # which have keys of a contact
    for words, advice in _ADVICE.get(last if table else "", {}).items():
        if word in words.split():
            return advice
    if not table:
        return _table(word, value)
    if last == "contact" and word in _NEEDLESS:
        return "leave it out: contact and friction are exact, without penalty"
    if last == "contact" and word == "interference" and isinstance(value, int | float):
        return f"write {line('gap', -abs(value))}"
    if last == "contact" and word == "friction_angle" and isinstance(value, int | float):
        return f"write {line('friction', round(math.tan(math.radians(value)), 4))}, the tangent of the angle"
    if last == "foundation" and word in ("diameter", "d") and isinstance(value, int | float):
        return f"write {line('radius', 0.5 * value)}"
    if last == "material" and word == "name" and str(value).lower() in _STEEL_AND_OTHERS:
        young, poisson = _STEEL_AND_OTHERS[str(value).lower()]
        return f"write {line('young', young)}, {line('poisson', poisson)}, or those of its data sheet"
    if last == "rotate" and word in ("angle_deg", "angle_degrees", "degree", "deg"):
        return f"write {line('degrees', value)}"
    if last == "solver" and word == "nlgeom":
        return f"write {line('kinematics', 'large' if value in (True, 'YES', 'yes') else 'small')}"
    if last == "prescribed_displacement" and (axis := word.removeprefix("u").removeprefix("_")) in _AXES:
        given = line("value", [value if axis == one else 0.0 for one in _AXES])
        return f"write {line('components', axis)}, {given}"
    for key, words in {**_EVERYWHERE, **_KEYS.get(last, {})}.items():
        if word in words.split() and key in known:
            if key == "face" and isinstance(value, list):
                return f"write a table for each face, the first with {line(key, value[0] if value else 'left')}"
            if key == "foundation":
                shape = word if word in ("plane", "sphere", "cylinder") else "plane"
                below = value if isinstance(value, Mapping) else {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
                lines = [line("shape", shape), *(_below(key, str(name), one) for name, one in below.items())]
                return f"write {key} = {{ {', '.join(lines)} }}"
            if key == "motion":
                to = [1.0, *value] if isinstance(value, list) else [1.0, 0.0, 0.0, 0.0]
                return f"write {line(key, [[0.0] * 4, to])}, rows of time and displacement"
            return f"write {line(key, _value(last, key, value))}"
    return _table(word, value)


def in_its_place(table: str, key: str, value: Any) -> str:
    """The line that is meant by a value of another kind than a key of a table has, or, without a key, the value that is
    meant by one in a list; empty if nothing is known."""
    if table == "contact" and isinstance(value, str):
        if key in ("slave", "surface", "against_surface"):
            return line("against" if key == "against_surface" else "face", value)
        if key == "foundation":
            return line(key, {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]})
    if key == "format" and isinstance(value, str):
        return line(key, ["xdmf", "vtkhdf"])
    if key == "material" and str(value).lower() in _STEEL_AND_OTHERS:
        return line(key, dict(zip(("young", "poisson"), _STEEL_AND_OTHERS[str(value).lower()], strict=True)))
    found = meant(table, key, value)
    return "" if found is None else line(key, found) if key else _toml(found)


def meant(table: str, key: str, value: Any) -> Any:
    """The value that is meant by one of another kind; None if nothing is known."""
    if key == "components" and isinstance(value, str | list):
        digits = value if isinstance(value, list) else [*map(int, re.findall(r"\d", value))] if value else []
        if isinstance(value, str) and "-" in value and len(digits) == 2:
            digits = list(range(digits[0], digits[1] + 1))
        components = "".join(axis for number, axis in enumerate(_AXES, 1) if number in digits or axis in digits)
        return components or None
    if table == "units" and isinstance(value, str):
        return next((unit for unit, words in _NAMES_OF_UNITS.items() if value.lower() in words.split()), None)
    if key == "times" and isinstance(value, int | float):
        return [float(value)]
    if isinstance(value, str):
        number = re.fullmatch(r"\s*([-+]?[.\d]+(?:[eE][-+]?\d+)?)\s*([A-Za-z/^2-3]*)\s*", value)
        factor = 1.0 if number and not number[2] else _UNITS.get(number[2].lower()) if number else None
        return None if number is None or factor is None else float(f"{float(number[1]) * factor:.12g}")
    if table == "rigid_face" and key in ("translation", "rotation") and isinstance(value, list) and len(value) == 3:
        return dict(zip(_AXES, value, strict=True))
    if isinstance(value, int | float) and not isinstance(value, bool) and (table, key) == ("contact", "force"):
        return {"z": float(value)}
    if isinstance(value, int | float) and not isinstance(value, bool) and key in _VECTORS:
        return [value] * 3 if key in ("box", "cells") else [0.0, 0.0, float(value)]
    if key == "value" and table == "pressure" and isinstance(value, list) and len(value) == 3:
        return float(f"{math.hypot(*value):.12g}")
    return None


def face_meant(name: str, faces: Collection[str]) -> str:
    """The face of these that another name stands for, or one that is written nearly so; empty if there is none."""
    body, colon, bare = name.rpartition(":")
    for face, words in _BOX_FACES.items():
        if bare.lower() in words.split() and (full_name := f"{body}{colon}{face}") in faces:
            return full_name
    lower = {face.lower(): face for face in faces}
    close = difflib.get_close_matches(name.lower(), lower, n=1)
    return lower[close[0]] if close else ""


def _value(table: str, key: str, value: Any) -> Any:
    """A value as a key has it, from one in the words of another program."""
    if key == "components" and (components := meant("", key, value)):
        return components
    if key == "format":
        return ["xdmf", "vtkhdf"]
    if key == "cell" and isinstance(value, str):
        return "tetrahedron" if re.search(r"tet|c3d(4|10)", value.lower()) else "hexahedron"
    if table in ("traction", "prescribed_displacement") and isinstance(value, int | float):
        return [0.0, 0.0, value]
    if isinstance(value, list):  # of texts with units
        return [given if (number := meant(table, "", given)) is None else number for given in value]
    return value


def _table(word: str, value: Any) -> str:
    """The table that a word at the top of a case means, with what was given below it."""
    for name, words in _TABLES.items():
        if word in words.split():
            one = value[0] if isinstance(value, list) and value and isinstance(value[0], Mapping) else value
            below = dict(one) if isinstance(one, Mapping) else {"face": one} if isinstance(one, str) else {}
            several = name not in ("material", "history", "solver", "output", "temperature") or isinstance(value, list)
            header = f"[[{name}]]" if several and name != "history" else f"[{name}]"
            lines = [_below(name, str(key), given) for key, given in below.items()]
            return f"write {header}" + (f", and below it {', '.join(lines)}" if lines else "")
    return ""


def _below(table: str, key: str, value: Any) -> str:
    """The line of a table with a key and its value, which may be another word for it."""
    known = {**_EVERYWHERE, **_KEYS.get(table, {})}
    better = "" if key in known else right(table, key, value, known)
    return better.removeprefix("write ") if better.startswith("write ") and "[[" not in better else line(key, value)
