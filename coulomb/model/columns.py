"""Columns of history.csv: the figures of a face, of a support, ..., as entries of the row of a load step."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any


def along_axes(name: str, vector: Sequence[float] | None) -> dict[str, float]:
    """The columns name_x, name_y, name_z of a vector; nan without one."""
    return {f"{name}_{axis}": value for axis, value in zip("xyz", vector or [math.nan] * 3, strict=True)}


def face_columns(name: str, face: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of one of several contact faces, or of a pair, with its name in files (`side_names`), from its entry
    in summary.json."""
    opposite = ("opposite_force", "opposite_moment") if "against" in face else ()
    return {
        **along_axes(f"{name}_force", face["force"]),
        **along_axes(f"{name}_moment", face["moment"]),
        **{column: value for what in opposite for column, value in along_axes(f"{name}_{what}", face[what]).items()},
        f"{name}_normal_force": face["normal_force"],
        f"{name}_contact_area": face["contact_area"],
        **along_axes(f"{name}_centre_of_pressure", face["centre_of_pressure"]),
    }


def rotation_columns(face: Mapping[str, Any]) -> dict[str, float]:
    """The columns of a contact face whose foundation rotates, from its entry in summary.json; none of other faces."""
    names = ("angle", "torque", "power") if "torque" in face else ()
    return {f"{face['faces'][0]}_{name}": math.nan if face[name] is None else face[name] for name in names}


def probe_columns(probe: Mapping[str, Any]) -> dict[str, float | None]:
    """The columns of a probe, from its entry in summary.json (`ProbeValue.entry`); those of a contact are None
    elsewhere."""
    name, slip = f"probe_{probe['name']}", probe["slip"]
    return {
        **along_axes(f"{name}_displacement", probe["displacement"]),
        **(along_axes(f"{name}_slip", slip) if slip is not None else dict.fromkeys(axes(f"{name}_slip"))),
        f"{name}_pressure": probe["pressure"],
    }


def axes(name: str) -> list[str]:
    """The names of the columns of a vector."""
    return [f"{name}_{axis}" for axis in "xyz"]


def body_columns(body: Mapping[str, Any]) -> dict[str, float]:
    """The columns of one of several bodies, from its entry in summary.json (`BodyBalance.entry`)."""
    name = f"body_{body['name']}"
    return {
        **along_axes(f"{name}_contact_force", body["contact_force"]),
        **along_axes(f"{name}_contact_moment", body["contact_moment"]),
        f"{name}_balance": body["balance"],
    }


def reaction_columns(reaction: Mapping[str, Any]) -> dict[str, float]:
    """The columns of a support, from its entry in summary.json (`Resultant.entry`)."""
    name = reaction["name"]
    return {**along_axes(f"{name}_force", reaction["force"]), **along_axes(f"{name}_moment", reaction["moment"])}
