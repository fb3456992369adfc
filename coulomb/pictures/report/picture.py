"""Pictures of a run: of one field, or an animation of a load history (`coulomb plot`); and picture.png, with pressure
and zones of the contact face at the end.

The process that draws picture.png starts while the run still computes: it loads its libraries (0.5 s), draws a small
warm-up picture, which makes the first picture of the block 0.3 s faster, and waits for the directory on standard input.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image

from ...io.field_files import Grid
from ...io.run_directory import PICTURE, RunDirectory
from ...units import in_seconds, number, scale_of
from .fields import AXES, INK, ZONES, Bar, Field, Limits, limits_of, named, ramp, zone_counts
from .files import Run, Step, read_run
from .scene import SECTION, VIEWS, Look, Shot, automatic_scale, camera_of, cropped, paint, plotter_for, shoot, shots_of
from .words import friction_in_words, in_nodes

PICTURES, ANIMATIONS = (".png", ".jpg", ".pdf", ".svg"), (".gif", ".mp4")

SHOT, FILM = (1500, 1100), (900, 660)
"""Pixels of the body in a picture and in a film, at most."""

_FILM_DPI: Final = 100

_SECONDS: Final = 0.15  # duration of a frame


def plot(
    directory: Path,
    field: str,
    scale: float | None,
    view: str | None,
    save: Path | None = None,
    step: int | None = None,
    show: bool = True,
) -> Any:
    """Draw a run; returns a message for the user.

    Args:
        field: One of `fields.FIELDS`, vectors also with _x, _y, _z.
        scale: Factor of the displacement; None chooses a visible one.
        view: One of `VIEWS`; None chooses by the field.
        save: File of a picture, or for a load history of an animation; None opens a window.
        step: Step of a load history, from 1; None for the last.
        show: Whether to open the window; if not, pyvista's plotter is returned.

    Raises:
        ValueError: If the directory contains no run, or field, view, step or the ending of `save` is not known.
    """
    chosen = named(field)
    if view is not None and view not in VIEWS:
        raise ValueError(f"there is no view {view!r} (known: {', '.join(VIEWS)})")
    if save is not None and save.suffix.lower() not in PICTURES + ANIMATIONS:
        raise ValueError(
            f"{save}: must end in {', '.join(PICTURES)} for a picture, {' or '.join(ANIMATIONS)} for a film"
        )
    run = read_run(directory, (chosen.file,))
    film = save is not None and save.suffix.lower() in ANIMATIONS
    if film and not run.is_history:
        raise ValueError(f"{directory} holds a single run: a film needs a load history; save a picture (.png)")
    if film and step is not None:
        raise ValueError("a film shows all steps: leave out either the step or the film")
    if step is not None and not 1 <= step <= len(run.steps):
        raise ValueError(f"{directory}: there is no step {step}; there are {len(run.steps)}")
    writer = film_writer(save, chosen) if film and save is not None else None

    steps = run.steps if film else run.steps[(step or 0) - 1 :][:1]
    shown = replace(run, steps=tuple(steps))  # whose colours and scale those of the picture are
    used = automatic_scale(shown) if scale is None else scale
    view = view or (SECTION if "slice" in run.summary else "iso" if chosen.file == "solution" else "contact")
    limits = limits_of(shown, chosen)
    if save is None:
        plotter = plotter_for((1280, 880), window=True)
        paint(plotter, steps[0], Look(chosen, limits, used, view, f"{caption(run, steps[0], used)} {run.alarm}"))
        if not show:
            return plotter
        plotter.show(title=f"coulomb: {directory}")
        return ""
    look = Look(chosen, limits, used, view)
    size = FILM if film else SHOT
    shots = cropped(shots_of(steps, look, camera_of(steps, look, size)))
    sheets = [
        sheet(
            shot,
            chosen,
            limits.bars(chosen.values(state.grid(chosen.file)), state.grid(chosen.file)),
            caption(run, state, used),
            run.alarm,
            zone_counts(state.grid("contact")),
        )
        for state, shot in zip(steps, shots, strict=True)
    ]
    try:
        if writer is not None:
            writer([pixels_of(figure) for figure in sheets])
            return f"{save}: {len(sheets)} steps{_without(steps)}"
        sheets[0].savefig(save, dpi=150)
    except OSError as error:
        save.unlink(missing_ok=True)
        raise OSError(error.errno, f"cannot be written: {error.strerror or error}", str(save)) from None
    return f"{save}{_without(steps)}"


def _without(steps: tuple[Step, ...]) -> str:
    """A remark on missing files."""
    lacking = steps[-1].lacks
    return f"; without {lacking}, which cannot be read" if lacking else ""


def film_writer(save: Path, field: Field) -> Any:
    """The writer of a film, checked before anything is drawn.

    Raises:
        ValueError: For .mp4, if there is no writer, with the package to install.
    """
    if save.suffix.lower() == ".gif":
        return lambda frames: _gif(frames, field, save)
    try:
        import imageio_ffmpeg
    except ImportError:
        raise ValueError(
            f"{save}: MP4 needs the package imageio-ffmpeg (pip install imageio-ffmpeg); or save a .gif"
        ) from None

    def write(frames: list[Pixels]) -> None:
        height, width, _ = frames[0].shape
        target = imageio_ffmpeg.write_frames(str(save), (width, height), fps=1.0 / _SECONDS, macro_block_size=2)
        target.send(None)
        for frame in frames:
            target.send(np.ascontiguousarray(frame))
        target.close()

    return write


def _gif(frames: list[Pixels], field: Field, save: Path) -> None:
    """All frames in the same 256 colours, to avoid flicker: those of the field, greys, and others that they need."""
    sample = Image.fromarray(np.concatenate([frames[len(frames) // 2], frames[-1]]))
    own = [int(colour[k : k + 2], 16) for colour in (*ramp(field, 140), *AXES) for k in (1, 3, 5)]
    greys = [int(grey) for grey in np.linspace(0, 255, 27).round() for _ in "rgb"]
    rest = sample.quantize(colors=80, dither=Image.Dither.NONE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette((own + greys + rest)[: 3 * 256])
    images = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    held = [round(1000 * _SECONDS)] * (len(images) - 1) + [1200]
    images[0].save(save, save_all=True, append_images=images[1:], duration=held, loop=0, optimize=False)


def main(arguments: list[str]) -> str:
    """The arguments of `plot` in JSON."""
    directory, field, scale, view, save, step = json.loads(arguments[0])
    return str(plot(Path(directory), field, scale, view, save and Path(save), step))


# --- a picture with caption, axes, and a colour bar with its unit or the names of the zones -------------------------

BAR: Final = 0.72
"""Height of a colour bar with its numbers and title, inches: of 150 pixels, a whole and, for films, even number."""

Pixels = npt.NDArray[np.uint8]

SIZE = (8.8, 6.4)
"""Size of a sheet in inches of 150 pixels; even numbers of pixels, as films require."""

_ALARM, _EDGE = "#b3261e", "#8a8a8a"


def sheet(shot: Shot, field: Field, bars: Sequence[Bar], caption: str, alarm: str, zones: dict[str, int]) -> Any:
    """A matplotlib figure with the cropped picture: caption and alarm above, the colour bars of the field below, or the
    zones with their numbers of nodes."""
    from matplotlib.figure import Figure

    width, high = SIZE
    below = BAR * (len(bars) - 1)
    tall = high + below
    figure = Figure(figsize=(width, tall), facecolor="white")
    stage = figure.add_axes((0.03, (0.19 * high + below) / tall, 0.94, 0.71 * high / tall))
    stage.imshow(shot.pixels, interpolation="antialiased")
    stage.set_axis_off()
    figure.text(0.03, 1.0 - 0.045 * high / tall, caption, fontsize=11, color=INK, va="center")
    if alarm:
        figure.text(0.03, 1.0 - 0.085 * high / tall, alarm, fontsize=11, color=_ALARM, weight="bold", va="center")
    directions(figure.add_axes((0.02, 0.02 * high / tall, 0.11, 0.15 * high / tall)), shot)
    if field.zones:
        legend(figure, zones, (0.55, 0.08), columns=2)
        return figure
    for k, bar in enumerate(bars):
        bottom = (0.085 * high + below - BAR * k) / tall
        colour_bar(figure, field, bar, (0.2, bottom, 0.66, 0.03 * high / tall))
    return figure


def colour_bar(figure: Any, field: Field, bar: Bar, box: tuple[float, float, float, float]) -> None:
    """Colour bar with round numbers, the field and its unit below, beside it the largest value, of signed values the
    smallest as well; `box`: left, bottom, width and height over those of the figure."""
    from matplotlib.ticker import MaxNLocator

    factor, unit = scale_of(bar.high, field.unit)
    norm = matplotlib.colors.Normalize(bar.low / factor, bar.high / factor)
    drawn = figure.colorbar(
        matplotlib.cm.ScalarMappable(norm, field.colours),
        cax=figure.add_axes(box),
        orientation="horizontal",
        ticks=MaxNLocator(6, steps=[1, 2, 5, 10]),
    )
    title = f"{field.title}, {unit}" if unit else field.title
    drawn.set_label(f"{bar.of}: {title}" if bar.of else title, fontsize=11, color=INK)
    drawn.ax.spines["outline"].set_visible(False)
    if field.unit:
        place = (box[0] + box[2] + 0.01, box[1] + 0.5 * box[3])
        ends = f"max {number(bar.largest / factor)}"
        if bar.low < 0.0:
            ends += f"\nmin {number(bar.smallest / factor)}"
        figure.text(*place, ends, fontsize=10, color=INK, va="center")


def legend(figure: Any, zones: dict[str, int], middle: tuple[float, float], columns: int = 4) -> None:
    """Legend of the zones with their numbers of nodes, held nodes only if there are any; `middle` is its centre, over
    width and height of the figure."""
    from matplotlib.patches import Patch

    patches = [
        Patch(facecolor=colour, edgecolor=_EDGE, linewidth=0.6, label=f"{name}: {in_nodes(zones[name])}")
        for name, colour in ZONES.values()
        if zones[name] or name != ZONES[3][0]
    ]
    columns = columns if len(patches) > 3 else 3
    figure.legend(handles=patches, loc="center", bbox_to_anchor=middle, ncols=columns, frameon=False, fontsize=11)


def directions(axes: Any, shot: Shot) -> None:
    """The axes x, y, z as seen by the camera."""
    axes.set(xlim=(-1.35, 1.35), ylim=(-1.35, 1.35), aspect="equal")
    axes.set_axis_off()
    for name, (right, up), colour in zip("xyz", shot.axes, AXES, strict=True):
        if np.hypot(right, up) < 0.1:  # it points at the camera, or away
            axes.plot(0, 0, "o", color=colour, markersize=4)
            axes.text(0.14, 0.1, name, color=colour, fontsize=10)
            continue
        axes.annotate("", (right, up), (0, 0), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.4})
        reach = 1.0 + 0.22 / np.hypot(right, up)
        axes.text(reach * right, reach * up, name, color=colour, fontsize=10, ha="center", va="center")


def pixels_of(figure: Any) -> Pixels:
    """A sheet as pixels, (height, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(_FILM_DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), dtype=np.uint8)[:, :, :3]


def caption(run: Run, step: Step, scale: float) -> str:
    """Name of the case, friction, time and the scale of the displacement in one line."""
    kind = f"{run.summary['slice']['kind']}, " if "slice" in (run.summary or {}) else ""
    parts = [f"{run.title}: {kind}{friction_in_words(run.summary) if run.summary else 'friction unknown'}"]
    if step.time is not None:
        parts.append(f"time {in_seconds(step.time)}")
    return ", ".join([*parts, f"displacement × {number(scale)}"])


# --- picture.png --------------------------------------------------------------------------------------------------

DPI: Final = 150

WIDE: Final = 1.5
"""Aspect ratio of the body in the picture above which the two views are stacked."""

# inches
_BORDER, _HEAD, _BAR, _LEGEND = 0.25, 0.42, 0.78, 0.42
_ABOVE, _BESIDE = (8.3, 3.7), (5.4, 5.4)
"""Largest width and height of a view, stacked and side by side."""


def draw(directory: Path, run: Run | None = None) -> Path:
    """Draw picture.png into the directory of a run, with solution.xdmf, contact.xdmf and summary.json; it may have been
    read.

    Raises:
        ValueError: If the directory contains no run, or a file cannot be read.
    """
    run = run or read_run(directory)
    run = replace(run, steps=run.steps[-1:])  # the last step of a load history, which may be long
    step, scale = run.steps[-1], automatic_scale(run)
    first, view = named("pressure"), "contact"
    if "slice" in run.summary:
        stressed = "von_mises_stress" in step.grid("solution").fields
        first, view = named("von_mises_stress" if stressed else "displacement"), SECTION
    looks = [Look(field, limits_of(run, field), scale, view) for field in (first, named("status"))]
    most = (round(DPI * _ABOVE[0]), round(DPI * _ABOVE[1]))
    camera = camera_of([step], looks[0], most)
    if camera.size[0] < WIDE * camera.size[1]:
        camera = camera_of([step], looks[0], (round(DPI * _BESIDE[0]), round(DPI * _BESIDE[1])))
    shots = [shoot(step, look, camera=camera) for look in looks]
    contact, of_first = step.grid("contact"), step.grid(first.file)
    bars = looks[0].limits.bars(first.values(of_first), of_first)
    figure = _composed(shots, first, bars, caption(run, step, scale), run.alarm, zone_counts(contact))
    partial = directory / f".{PICTURE}"
    figure.savefig(partial, dpi=DPI, format="png", pil_kwargs={"compress_level": 1})
    return partial.replace(RunDirectory(directory).picture)


def _composed(
    shots: list[Shot], field: Field, bars: Sequence[Bar], words: str, alarm: str, zones: dict[str, int]
) -> Any:
    """Both views with their legends, as a matplotlib figure."""
    from matplotlib.figure import Figure

    pixels, across = shots[0].pixels.shape, shots[0].pixels.shape[1] < WIDE * shots[0].pixels.shape[0]
    width, height = pixels[1] / DPI, pixels[0] / DPI
    column = max(width, 5.6 if across else 8.3)
    total = 2 * column + 3 * _BORDER if across else column + 2 * _BORDER
    head = _HEAD + (0.25 if alarm else 0.0)
    below = _BAR + BAR * (len(bars) - 1)
    tall = head + below + height + (0.0 if across else height + _LEGEND) + _BORDER
    figure = Figure(figsize=(total, tall), dpi=DPI, facecolor="white")

    def box(left: float, bottom: float, wide: float, high: float) -> tuple[float, float, float, float]:
        return left / total, bottom / tall, wide / total, high / tall

    figure.text(_BORDER / total, 1.0 - 0.26 / tall, words, fontsize=11, color=INK, va="center")
    if alarm:
        figure.text(_BORDER / total, 1.0 - 0.52 / tall, alarm, fontsize=11, color=_ALARM, weight="bold", va="center")
    bottoms = [_BORDER + below] * 2 if across else [_BORDER + _LEGEND + height + below, _BORDER + _LEGEND]
    lefts = [_BORDER, 2 * _BORDER + column] if across else [_BORDER] * 2
    for shot, left, bottom in zip(shots, lefts, bottoms, strict=True):
        figure.figimage(shot.pixels, round(DPI * (left + 0.5 * (column - width))), round(DPI * bottom), origin="upper")
    for k, bar in enumerate(bars):
        place = box(_BORDER + 0.2 * column, bottoms[0] - 0.22 - BAR * k, 0.62 * column, 0.16)
        colour_bar(figure, field, bar, place)
    named_below = (bottoms[1] - (0.36 if across else 0.26)) / tall
    legend(figure, zones, ((lefts[1] + 0.5 * column) / total, named_below), columns=2 if across else 4)
    directions(figure.add_axes(box(_BORDER, bottoms[0] - 0.8, 0.9, 0.8)), shots[0])
    return figure


class _Cube(Step):
    """A state with one cell, for the warm-up."""

    def grid(self, file: str) -> Grid:
        """A cube, or its lower face, with all fields that a view needs."""
        points = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
        if file == "solution":
            return Grid("Hexahedron", np.array([[0, 1, 3, 2, 4, 5, 7, 6]]), points, {"displacement": 0.0 * points})
        down = np.tile([0.0, 0.0, -1.0], (4, 1))
        fields = {"normal": down, "pressure": np.arange(4.0), "status": np.arange(4.0), "area": np.full(4, 0.25)}
        return Grid("Quadrilateral", np.array([[0, 1, 3, 2]]), points[:4], fields)


def _warm_up() -> None:
    """Draw a small picture without a file, to load and compile everything that a picture needs."""
    cube = _Cube(Path(), None)
    looks = [Look(named(name), Limits(0.0, 3.0), 1.0, "contact") for name in ("pressure", "status")]
    shots = [shoot(cube, look, (60, 60)) for look in looks]
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(
        _composed(shots, named("pressure"), [Bar(0.0, 3.0, 0.0, 3.0)], "0123", "", zone_counts(cube.grid("contact")))
    ).draw()


def overview(arguments: list[str]) -> str:
    """Without arguments: warm up, then draw the run in the directory given on standard input."""
    assert not arguments
    _warm_up()
    directory = sys.stdin.read()
    if not directory:  # no picture is needed, or the parent process has ended
        return ""
    return str(draw(Path(directory)))
