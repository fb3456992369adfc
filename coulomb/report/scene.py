"""A state of the body in three dimensions, drawn by pyvista without a window or into one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..plotting import ZONES, FloatArray, Grid, match, nice, patches, polygons, renderer, skin_of, without
from .fields import Field, named
from .files import Run, Step
from .units import in_seconds, number, scale_of

VIEWS = {
    "contact": None,
    "iso": ((0.9, -1.5, 0.8), (0.0, 0.0, 1.0)),
    "below": ((0.9, -1.5, -0.9), (0.0, 0.0, 1.0)),
    "top": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    "bottom": ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    "front": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "back": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "left": ((-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "right": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
}
"""From where one looks, and what is up; "contact": at the contact face from outside the body."""

_OBLIQUE = ("contact", "iso", "below")  # the others look along an axis: without perspective
_BODY, _EDGE, _FACE_EDGE = "#e4e1da", "#b9b5ab", "#8a8a8a"
_INK = "#202020"


@dataclass(frozen=True)
class Look:
    """How to show a state.

    Attributes:
        field: What the colours mean.
        limits: Range of the colours, in the bare unit of the field.
        scale: Of the displacement.
        view: One of `VIEWS`.
        caption: At the top of a window, with colour bar and axes; empty for what `sheet` or the page surrounds.
    """

    field: Field
    limits: tuple[float, float]
    scale: float
    view: str
    caption: str = ""


def automatic_scale(run: Run) -> float:
    """A round factor by which the greatest displacement of a run shows: a twentieth of the body's size."""
    greatest, size = 0.0, 1.0
    for step in run.steps:
        body = step.grid("solution")
        size = float(np.linalg.norm(np.ptp(body.points, axis=0)))
        greatest = max(greatest, float(np.linalg.norm(body.fields["displacement"], axis=1).max()))
    return nice(0.05 * size / greatest) if greatest > 0.0 else 1.0


def limits_of(run: Run, field: Field) -> tuple[float, float]:
    """Range of the colours, the same for all steps of a run."""
    if field.zones:
        return 0.0, float(max(ZONES))
    return field.limits(np.concatenate([np.ravel(field.values(step.grid(field.file))) for step in run.steps]))


def outward(contact: Grid) -> FloatArray:
    """Mean outward normal of the body on its contact face, (3,), of length 1."""
    mean: FloatArray = np.sum(contact.fields["normal"], axis=0)
    length = float(np.linalg.norm(mean))
    if length == 0.0:
        return np.array([0.0, 0.0, -1.0])
    return np.asarray(mean / length, dtype=np.float64)


@dataclass(frozen=True)
class Shot:
    """What the camera saw.

    Attributes:
        pixels: Red, green, blue and opacity, (height, width, 4).
        axes: Of x, y and z the direction in the picture, right and up, (3, 2).
    """

    pixels: npt.NDArray[np.uint8]
    axes: FloatArray


def shoot(step: Step, look: Look, size: tuple[int, int] = (1500, 1100)) -> Shot:
    """A state of the body, without any words and on no ground."""
    plotter = plotter_for(size)
    paint(plotter, step, look)
    pixels = plotter.screenshot(return_img=True, transparent_background=True)
    forward, up = np.array(plotter.camera.direction), np.array(plotter.camera.up)
    right = np.cross(forward, up)
    above = np.cross(right, forward)
    plotter.close()
    axes: FloatArray = np.column_stack([right / np.linalg.norm(right), above / np.linalg.norm(above)])
    return Shot(np.asarray(pixels, dtype=np.uint8), axes)


def cropped(shots: list[Shot]) -> list[Shot]:
    """The pictures without the empty margin that all of them have."""
    seen = np.any([shot.pixels[:, :, 3] > 0 for shot in shots], axis=0)
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if len(rows) == 0:
        return shots
    window = (slice(max(rows[0] - 4, 0), rows[-1] + 5), slice(max(columns[0] - 4, 0), columns[-1] + 5))
    return [Shot(shot.pixels[window], shot.axes) for shot in shots]


def plotter_for(size: tuple[int, int], window: bool = False) -> Any:
    """An empty stage, white; without a window unless one is asked for."""
    pyvista = renderer()
    plotter = pyvista.Plotter(off_screen=not window, window_size=size)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("msaa" if window else "ssaa")
    return plotter


def paint(plotter: Any, step: Step, look: Look) -> None:
    """Put a state onto an empty stage and look at it."""
    pyvista, field = renderer(), look.field
    body, contact = step.grid("solution"), step.grid("contact")
    displacement = body.fields["displacement"]
    in_contact = match(contact.points, body.points)
    points = contact.points + look.scale * displacement[in_contact]
    size = float(np.linalg.norm(np.ptp(body.points, axis=0)))
    skin = skin_of(pyvista, body, body.points + look.scale * displacement)
    face = pyvista.PolyData(points, polygons(contact.cells))
    factor, unit = scale_of(max(map(abs, look.limits)), field.unit)
    colours: dict[str, Any] = {"cmap": field.colours, "clim": tuple(bound / factor for bound in look.limits)}
    colours |= {"lighting": False, "scalars": "shown", "scalar_bar_args": _bar(field, unit)}
    colours |= {"show_scalar_bar": bool(look.caption)}

    if field.file == "solution":
        values = field.values(body) / factor
        if len(values) == len(body.points):
            skin.point_data["shown"] = values[skin.point_data["node"]]
        else:
            skin.cell_data["shown"] = values[skin.cell_data["vtkOriginalCellIds"]]
        plotter.add_mesh(skin, show_edges=True, edge_color=_FACE_EDGE, line_width=0.5, **colours)
        rest = skin_of(pyvista, body, body.points).extract_feature_edges(40.0, manifold_edges=False)
        plotter.add_mesh(rest, color=_FACE_EDGE, line_width=1)  # where the body was
    else:
        bare = without(skin, in_contact)
        plotter.add_mesh(bare, color=_BODY, show_edges=True, edge_color=_EDGE, ambient=0.5, diffuse=0.55)
        if field.zones:
            _zones(plotter, contact, points, bool(look.caption))
        else:
            face.point_data["shown"] = field.values(contact) / factor
            plotter.add_mesh(face, show_edges=True, edge_color=_FACE_EDGE, line_width=0.5, **colours)
        if field.zones:
            lines = face.extract_all_edges().translate(1e-3 * size * outward(contact))
            plotter.add_mesh(lines, color=_FACE_EDGE, line_width=0.5)
        if field.vector:
            _arrows(plotter, contact, points, field)
    _look(plotter, look.view, contact)
    if look.caption:
        plotter.add_text(look.caption, position=(0.02, 0.94), viewport=True, font_size=11, color=_INK)
        plotter.add_axes(color=_INK)


def _bar(field: Field, unit: str) -> dict[str, Any]:
    title = f"{field.title}, {unit}\n" if unit else f"{field.title}\n"
    shape = {"title_font_size": 20, "label_font_size": 18, "color": _INK, "fmt": "%.3g", "n_labels": 5}
    return shape | {"title": title, "position_x": 0.25, "position_y": 0.03, "width": 0.5, "height": 0.09}


def _zones(plotter: Any, contact: Grid, points: FloatArray, legend: bool) -> None:
    """The part of the face nearest to each node in the colour of its status, and how many nodes have it."""
    pyvista, status = renderer(), np.rint(contact.fields["status"]).astype(int)
    parts = pyvista.MultiBlock()
    names = {}
    for code, (name, _) in ZONES.items():
        chosen = status == code
        names[float(code)] = f"{name} {np.count_nonzero(chosen)}"
        if chosen.any():
            part = patches(pyvista, contact.cells, points, chosen)
            part.cell_data["zone"] = np.full(part.n_cells, float(code))
            parts.append(part)
    bar = {**_bar(named("status"), "nodes"), "n_labels": 0, "position_y": 0.07, "title": "zones, number of nodes\n\n"}
    colours: dict[str, Any] = {"cmap": [colour for _, colour in ZONES.values()], "clim": (-0.5, 3.5)}
    colours |= {"annotations": names, "scalar_bar_args": bar, "show_scalar_bar": legend}
    plotter.add_mesh(parts.combine().extract_surface(algorithm=None), scalars="zone", lighting=False, **colours)


def _arrows(plotter: Any, contact: Grid, points: FloatArray, field: Field) -> None:
    """Arrows along a vector field of the contact face, as long as a cell or two at the greatest."""
    pyvista, vectors = renderer(), contact.fields[field.name]
    greatest = float(np.linalg.norm(vectors, axis=1).max())
    if not greatest > 0.0:
        return
    shown = thinned(len(points), 700)
    reach = float(np.linalg.norm(np.ptp(points, axis=0)))
    cloud = pyvista.PolyData(points[shown] + 4e-3 * reach * outward(contact))
    cloud.point_data["along"] = vectors[shown] / greatest
    cell = np.sqrt(float(np.sum(contact.fields["area"])) / len(shown))
    glyphs = cloud.glyph(orient="along", scale="along", factor=1.6 * cell, geom=pyvista.Arrow(shaft_radius=0.045))
    plotter.add_mesh(glyphs, color=_INK, lighting=False)


def thinned(count: int, most: int) -> npt.NDArray[np.int64]:
    """At most so many of `count` numbers, evenly."""
    return np.arange(0, count, max(1, -(-count // most)))


def _look(plotter: Any, view: str, contact: Grid) -> None:
    given = VIEWS[view]
    direction, up = looking_at(outward(contact)) if given is None else (np.array(given[0]), np.array(given[1]))
    if view not in _OBLIQUE:
        plotter.enable_parallel_projection()
    plotter.view_vector(direction, viewup=up)


def looking_at(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """From where to look at a face with this outward normal: along it and a little from two sides; and what is up."""
    along = np.eye(3)[np.argmin(np.abs(normal))]
    across: FloatArray = np.cross(normal, along)
    return normal + 0.25 * along + 0.6 * across, -across


def zone_counts(contact: Grid) -> dict[str, int]:
    """Number of nodes in every zone, by its name."""
    status = np.rint(contact.fields["status"]).astype(int)
    return {name: int(np.count_nonzero(status == code)) for code, (name, _) in ZONES.items()}


def caption(run: Run, step: Step, scale: float) -> str:
    """Friction, time and the scale of the displacement, in a line."""
    parts = [f"{run.directory.resolve().name}: {friction_in_words(run.summary)}"]
    if step.time is not None:
        parts.append(f"time {in_seconds(step.time)}")
    return ", ".join([*parts, f"displacement × {number(scale)}"])


def friction_in_words(summary: dict[str, Any]) -> str:
    """The law with its coefficient: Coulomb friction 0.3."""
    coulomb = summary["law"] == "coulomb"
    given = summary["friction" if coulomb else "slip_stress"]
    values = [given["min"], given["max"]] if isinstance(given, dict) else [given]
    if coulomb:
        return "Coulomb friction " + " to ".join(number(value) for value in values)
    factor, unit = scale_of(max(values), "Pa")
    return "Tresca friction " + " to ".join(number(value / factor) for value in values) + f" {unit}"
