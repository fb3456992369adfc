"""A state of the body in three dimensions, drawn by pyvista without a window or into one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from ...arrays import FloatArray
from ...io.field_files import Grid
from ...units import scale_of
from .fields import INK, ZONES, Field, Limits, named, zone_counts
from .files import Run, Step
from .grids import (
    corners_in,
    drawn_apart,
    nodes_in_body,
    opposite,
    outward,
    patches,
    polygons,
    renderer,
    skin_of,
    without,
)

ANGLE: Final = 30.0
"""Opening angle in degrees of a camera that sees the bounding sphere: the strength of the perspective."""

SHAPES = 0.2, 6.0
"""Smallest and largest aspect ratio of a picture; thinner scenes get empty space."""

MARGIN: Final = 0.015
"""Empty border on each side, over width and height: room for the width of lines."""


class Camera(NamedTuple):
    """A camera and its picture.

    Attributes:
        of_vtk: pyvista's camera.
        size: Size of the picture in pixels, width and height.
        axes: Directions of x, y and z in the picture, right and up, (3, 2).
        closeness: Pixels per metre in the middle, but for a factor that all cameras at the same points have.
    """

    of_vtk: Any
    size: tuple[int, int]
    axes: FloatArray
    closeness: float


def beside(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction of view of a face with this outward normal and of the body drawn apart from it, from the side, and
    upward direction."""
    one, other = _along(normal)
    return 0.8 * normal + 0.9 * one - 1.5 * other, normal


def looking_at(normal: FloatArray, turned: bool = False) -> tuple[FloatArray, FloatArray]:
    """Direction of view of a face with this outward normal, inclined to it in two directions, and upward direction;
    `turned` by a quarter turn about the normal."""
    along, across = _along(normal)
    if turned:
        along, across = across, -along
    return normal + 0.25 * along + 0.6 * across, -across


def _along(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two directions along a face, the first as near to an axis as can be; the second is the normal times the first."""
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    one = axis - (axis @ normal) * normal
    one /= np.linalg.norm(one)
    return one, np.cross(normal, one)


def framing(points: FloatArray, direction: FloatArray, up: FloatArray, most: tuple[int, int], parallel: bool) -> Camera:
    """The camera with the closest view of all points (k, 3), `direction` from them to the camera, not parallel to `up`.

    The picture has at most `most` pixels, and reaches this width or height; `parallel` is without perspective.
    By VTK's ResetCameraScreenSpace, which sees the box around the points, pictures are up to 18 % smaller (block 2,
    pin joint 12, history 15, seal 18 %).
    """
    back = direction / np.linalg.norm(direction)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    above = np.cross(back, right)
    low, high = points.min(axis=0), points.max(axis=0)
    middle, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0
    distance = radius / np.sin(np.radians(0.5 * ANGLE))
    across, along = (points - middle) @ right, (points - middle) @ above
    if not parallel:
        depth = distance - (points - middle) @ back
        across, along = across / depth, along / depth
    least = 1e-6 * (radius if parallel else 1.0)
    half = [max(0.5 * float(np.ptp(seen)), least) * (1.0 + 2.0 * MARGIN) for seen in (across, along)]
    width = max(half[0], SHAPES[0] * half[1])
    height = max(half[1], width / SHAPES[1])
    centre = [0.5 * float(seen.min() + seen.max()) for seen in (across, along)]
    shape = width / height
    pixels = (most[0], round(most[0] / shape)) if shape > most[0] / most[1] else (round(most[1] * shape), most[1])
    camera = renderer().Camera()
    camera.position, camera.focal_point, camera.up = map(tuple, (middle + distance * back, middle, above))
    camera.SetParallelProjection(parallel)
    camera.SetParallelScale(height)
    if not parallel:
        camera.SetViewAngle(2.0 * float(np.degrees(np.arctan(height))))
    camera.SetWindowCenter(centre[0] / width, centre[1] / height)
    camera.is_set = True
    return Camera(camera, pixels, np.column_stack([right, above]), pixels[1] / height)


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
"""Direction of view and upward direction; "contact": at the contact face from outside the body."""

SECTION: Final = "section"
"""View of a slice from its front, on which contact faces are lines."""

_EDGES = {
    "Tetrahedron": ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)),
    "Hexahedron": (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}
"""Corners at the ends of the edges of a cell."""

_OBLIQUE = ("contact", "iso", "below")  # the others are along an axis: without perspective
_BODY, _EDGE, _FACE_EDGE = "#f2f0eb", "#c8c5be", "#8a8a8a"
_LINED: Final = 15_000  # facets up to which their edges are drawn: on finer ones lines would cover the colours
_THROUGH: Final = 0.6  # strength of colours that are seen through a body
_THICK: Final = 7  # pixels of contact faces that are seen as lines
_TIP: Final = 0.07  # radius of an arrow's tip over its length
_ARROWS: Final = 22  # along the largest extent of the contact face


@dataclass(frozen=True)
class Look:
    """Display settings of a state.

    Attributes:
        view: One of `VIEWS`, or `SECTION`.
        caption: Text at the top of a window, with colour bar and axes; empty if `sheet` or the page adds these.
    """

    field: Field
    limits: Limits
    scale: float
    view: str
    caption: str = ""


def automatic_scale(run: Run) -> float:
    """A round factor that shows the largest displacement of a run as a twentieth of the body's size.

    It is smaller for thin bodies, which would be turned inside out: strains shown are at most one half, except in the
    hundredth of the cells with the largest strains.  Large motions are shown as they are.
    """
    if run.summary.get("method", {}).get("kinematics") == "large":
        return 1.0
    largest, stretch, size = 0.0, 0.0, 1.0
    for step in run.steps:
        body = step.grid("solution")
        displacement = body.fields["displacement"]
        size = float(np.linalg.norm(np.ptp(body.points, axis=0)))
        largest = max(largest, float(np.linalg.norm(displacement, axis=1).max()))
        if not displacement.any():
            continue
        edges = np.zeros(len(body.cells))
        corners = corners_in(body.cells)
        for kind, ends in _EDGES.items():
            of = corners == (4 if kind == "Tetrahedron" else 8)
            for here, there in ends if np.any(of) else ():
                a, b = body.cells[of, here], body.cells[of, there]
                change = np.linalg.norm(displacement[a] - displacement[b], axis=1)
                edges[of] = np.maximum(edges[of], change / np.linalg.norm(body.points[a] - body.points[b], axis=1))
        stretch = max(stretch, float(np.quantile(edges, 0.99)))
    if not largest > 0.0:
        return 1.0
    return round_down(min(0.05 * size / largest, 0.5 / stretch if stretch > 0.0 else np.inf))


@dataclass(frozen=True, eq=False)
class Shot:
    """A rendered picture.

    Attributes:
        pixels: Red, green, blue and opacity, (height, width, 4).
        axes: Directions of x, y and z in the picture, right and up, (3, 2).
    """

    pixels: npt.NDArray[np.uint8]
    axes: FloatArray


def shoot(step: Step, look: Look, size: tuple[int, int] = (1500, 1100), camera: Camera | None = None) -> Shot:
    """Render a state of the body, without text and with transparent background, in at most `size` pixels; by default by
    a camera that sees the whole state."""
    (shot,) = shots_of([step], look, camera or camera_of([step], look, size))
    return shot


def shots_of(steps: Sequence[Step], look: Look, camera: Camera) -> list[Shot]:
    """Render states of the body one after another, by one window."""
    plotter, shots = _off_screen(), []
    for step in steps:
        plotter.suppress_rendering = True  # pyvista would draw at every change
        plotter.window_size = camera.size
        plotter.clear_actors()
        bodies = paint(plotter, step, look)
        plotter.camera = camera.of_vtk
        plotter.renderer.ResetCameraClippingRange()
        plotter.suppress_rendering = False
        pixels = _pixels(plotter)
        if bodies is not None:
            bodies.SetVisibility(False)
            pixels = _shown_through(pixels, _pixels(plotter))
        shots.append(Shot(pixels, camera.axes))
    return shots


@cache
def _off_screen() -> Any:
    """The window of all pictures without one on the screen: a new one takes 0.1 s longer for each picture."""
    return plotter_for((60, 60))


def _pixels(plotter: Any) -> npt.NDArray[np.uint8]:
    """What an off-screen window shows, drawn once, (height, width, 4)."""
    plotter.render()
    return np.asarray(plotter.screenshot(return_img=True, transparent_background=True), dtype=np.uint8)


def _shown_through(whole: npt.NDArray[np.uint8], faces: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """A picture in which the contact faces are seen through what hides them, from pictures with and without bodies."""
    share = _THROUGH * (faces[:, :, 3:] / 255.0)
    mixed: npt.NDArray[np.uint8] = np.rint((1.0 - share) * whole + share * faces).astype(np.uint8)
    mixed[:, :, 3] = whole[:, :, 3]
    return mixed


def camera_of(steps: Sequence[Step], look: Look, size: tuple[int, int]) -> Camera:
    """The camera that sees all these states completely."""
    seen: list[FloatArray] = []
    for step in steps:
        body, contact = _shown(step, look)
        seen += [body.points + look.scale * body.fields["displacement"]]
        seen += [body.points] if look.field.file == "solution" else []
        if look.field.vector and look.field.file == "contact":
            tails, along = _arrows_of(contact, body, look)
            seen += [tails + along + _TIP * np.abs(along).max(initial=0.0) * side for side in (*np.eye(3), *-np.eye(3))]
    points, parallel = np.concatenate(seen), look.view not in _OBLIQUE
    ways = _directions(look.view, steps[-1].grid("contact"))
    cameras = [framing(points, direction, up, size, parallel) for direction, up in ways]
    return max(cameras, key=lambda camera: camera.closeness)  # the largest picture


def _shown(step: Step, look: Look) -> tuple[Grid, Grid]:
    """Bodies and contact faces; for a field of the faces the bodies of pairs are drawn apart."""
    body, contact = step.grid("solution"), step.grid("contact")
    return drawn_apart(body, contact) if look.field.file == "contact" else (body, contact)


def cropped(shots: list[Shot]) -> list[Shot]:
    """The pictures without the empty margin that all of them have."""
    seen = np.any([shot.pixels[:, :, 3] > 0 for shot in shots], axis=0)
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if len(rows) == 0:
        return shots
    window = (slice(max(rows[0] - 4, 0), rows[-1] + 5), slice(max(columns[0] - 4, 0), columns[-1] + 5))
    return [Shot(shot.pixels[window], shot.axes) for shot in shots]


def plotter_for(size: tuple[int, int], window: bool = False) -> Any:
    """An empty white plotter, by default without a window."""
    pyvista = renderer()
    plotter = pyvista.Plotter(off_screen=not window, window_size=size)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("msaa", multi_samples=8)  # two thirds of the time of drawing four times as large
    return plotter


def paint(plotter: Any, step: Step, look: Look) -> Any:
    """Add a state to an empty plotter, in a window with its camera; returns VTK's actor of what may hide contact faces,
    or None."""
    pyvista, field = renderer(), look.field
    body, contact = _shown(step, look)
    bodies = None
    displacement = body.fields["displacement"]
    in_contact = nodes_in_body(contact, body)
    points = contact.points + look.scale * displacement[in_contact]
    size = float(np.linalg.norm(np.ptp(body.points, axis=0)))
    skin = skin_of(body, body.points + look.scale * displacement)
    face = pyvista.PolyData(points, polygons(contact.cells))
    limits = look.limits
    factor, unit = scale_of(limits.high, field.unit)
    colours: dict[str, Any] = {"cmap": field.colours, "clim": (limits.low / factor, limits.high / factor)}
    others = limits.bars(np.zeros(len(contact.points)), contact)[1:]
    ends = "".join(f"; of {bar.of} to {bar.high / factor:.3g}" for bar in others)
    colours |= {"lighting": False, "scalars": "shown", "scalar_bar_args": _bar(field, unit + ends)}
    colours |= {"show_scalar_bar": bool(look.caption)}

    if field.file == "solution":
        values = limits.exact(field.values(body)) / factor
        if len(values) == len(body.points):
            skin.point_data["shown"] = values[skin.point_data["node"]]
        else:
            skin.cell_data["shown"] = values[skin.cell_data["vtkOriginalCellIds"]]
        plotter.add_mesh(skin, edge_color=_FACE_EDGE, line_width=0.5, show_edges=skin.n_cells <= _LINED, **colours)
        rest = skin_of(body, body.points).extract_feature_edges(40.0, manifold_edges=False)
        plotter.add_mesh(rest, color=_FACE_EDGE, line_width=1)  # undeformed body
    else:
        lined = skin.n_cells <= _LINED
        bare = without(skin, in_contact[contact.cells])
        if bare.n_cells:  # no body if its file is missing
            window = bool(look.caption) and np.any(opposite(contact))
            plain = {"ambient": 0.75, "diffuse": 0.3, "opacity": 1.0 - _THROUGH if window else 1.0}
            bodies = plotter.add_mesh(bare, color=_BODY, show_edges=lined, edge_color=_EDGE, **plain)
        if field.zones:
            _zones(plotter, contact, points, look)
        else:
            face.point_data["shown"] = limits.stretched(field.values(contact), contact) / factor
            line = {"style": "wireframe", "line_width": _THICK} if look.view == SECTION else {"line_width": 0.5}
            plotter.add_mesh(face, show_edges=lined, edge_color=_FACE_EDGE, **line, **colours)
        if field.zones and lined and look.view != SECTION:
            lines = pyvista.PolyData(points + 1e-3 * size * contact.fields["normal"], polygons(contact.cells))
            plotter.add_mesh(lines.extract_all_edges(), color=_FACE_EDGE, line_width=0.5)
        if field.vector:
            _arrows(plotter, contact, body, look)
    if look.caption:
        camera = camera_of([step], look, tuple(plotter.window_size)).of_vtk
        if camera.parallel_projection:
            plotter.enable_parallel_projection()
        plotter.view_vector(np.subtract(camera.position, camera.focal_point), viewup=camera.up)
        plotter.add_text(look.caption, position=(0.02, 0.94), viewport=True, font_size=11, color=INK)
        plotter.add_axes(color=INK)
    return bodies


def _bar(field: Field, unit: str) -> dict[str, Any]:
    title = f"{field.title}, {unit}\n" if unit else f"{field.title}\n"
    shape = {"title_font_size": 20, "label_font_size": 18, "color": INK, "fmt": "%.3g", "n_labels": 5}
    return shape | {"title": title, "position_x": 0.25, "position_y": 0.03, "width": 0.5, "height": 0.09}


def _zones(plotter: Any, contact: Grid, points: FloatArray, look: Look) -> None:
    """The part of the face nearest to each node in the colour of its status, and the number of nodes per status."""
    status, count = np.rint(named("status").values(contact)), zone_counts(contact)
    pieces = patches(contact.cells, points)
    pieces.cell_data["zone"] = status[pieces.cell_data["node"]]
    names = {float(code): f"{name} {count[name]}" for code, (name, _) in ZONES.items()}
    bar = {**_bar(named("status"), "nodes"), "n_labels": 0, "position_y": 0.07, "title": "zones, number of nodes\n\n"}
    colours: dict[str, Any] = {"cmap": [colour for _, colour in ZONES.values()], "clim": (-0.5, 3.5)}
    colours |= {"annotations": names, "scalar_bar_args": bar, "show_scalar_bar": bool(look.caption)}
    if look.view == SECTION:
        colours |= {"style": "wireframe", "line_width": _THICK}
    plotter.add_mesh(pieces, scalars="zone", lighting=False, **colours)


def _arrows(plotter: Any, contact: Grid, body: Grid, look: Look) -> None:
    """Arrows along a vector field of the contact face: few and slim, to keep the colours below visible."""
    pyvista = renderer()
    tails, along = _arrows_of(contact, body, look)
    if not along.any():
        return
    cloud = pyvista.PolyData(tails)
    cloud.point_data["along"] = along
    arrow = pyvista.Arrow(tip_length=0.3, tip_radius=_TIP, shaft_radius=0.022)
    plotter.add_mesh(cloud.glyph(orient="along", scale="along", factor=1.0, geom=arrow), color=INK, lighting=False)


def _arrows_of(contact: Grid, body: Grid, look: Look) -> tuple[FloatArray, FloatArray]:
    """Tails of the arrows slightly in front of the deformed face, and the arrows; metres, (k, 3) each.

    One per cube of a grid over the face; the largest has nine tenths of the length of a cube.
    """
    points, vectors = contact.points, contact.fields[look.field.name]
    vectors = vectors * (look.limits.high / np.reshape(look.limits.end_at(contact), (-1, 1)))
    largest = float(np.linalg.norm(vectors, axis=1).max())
    extent = np.ptp(points, axis=0)
    reach = float(extent.max())
    if not largest > look.limits.least or not reach > 0.0:
        return points[:0], vectors[:0]
    cell = np.sqrt(float(np.sum(contact.fields["area"])) / max(1, len(points)))
    edge = max(reach / _ARROWS, 1.2 * cell)
    cube = np.floor((points - points.min(axis=0)) / edge)
    off = np.linalg.norm((points - points.min(axis=0)) / edge - cube - 0.5, axis=1)
    order = np.lexsort((off, *cube.T))  # the node nearest to the centre of each cube first
    _, first = np.unique(cube[order], axis=0, return_index=True)
    shown = order[first]
    deformed = points[shown] + look.scale * body.fields["displacement"][nodes_in_body(contact, body)[shown]]
    return deformed + 4e-3 * reach * contact.fields["normal"][shown], 0.9 * edge / largest * vectors[shown]


def _directions(view: str, contact: Grid) -> list[tuple[FloatArray, FloatArray]]:
    """Directions of a view to choose from, each with the upward direction: of the contact face along either side."""
    given = VIEWS["top" if view == SECTION else view]
    if given is not None:
        return [(np.array(given[0]), np.array(given[1]))]
    if np.any(opposite(contact)):
        return [beside(outward(contact))]
    return [looking_at(outward(contact), turned) for turned in (False, True)]


def round_down(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten below."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value * (1.0 + 1e-12)))
