"""One picture of a run, or an animation of a load history."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from .fields import Field, limits_of, named, ramp, zone_counts
from .files import Step, read_run
from .scene import VIEWS, Look, automatic_scale, camera_of, cropped, paint, plotter_for, shoot
from .sheet import AXES, Pixels, caption, pixels_of, sheet

PICTURES, ANIMATIONS = (".png", ".jpg", ".pdf", ".svg"), (".gif", ".mp4")

SHOT = (1500, 1100)
"""Pixels of the body in a picture, at most."""

_SECONDS = 0.15  # duration of a frame


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
        directory: Directory of the run.
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
    used = automatic_scale(run) if scale is None else scale
    view = view or ("iso" if chosen.file == "solution" else "contact")
    limits = limits_of(run, chosen)
    if save is None:
        plotter = plotter_for((1280, 880), window=True)
        paint(plotter, steps[0], Look(chosen, limits, used, view, f"{caption(run, steps[0], used)} {run.alarm}"))
        if not show:
            return plotter
        plotter.show(title=f"coulomb: {directory}")
        return ""
    look = Look(chosen, limits, used, view)
    camera = camera_of(steps, look, SHOT)
    shots = cropped([shoot(state, look, SHOT, camera) for state in steps])
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
    """DIRECTORY FIELD SCALE VIEW SAVE STEP; "-" for defaults."""
    directory, field, scale, view, save, step = (None if given == "-" else given for given in arguments)
    assert directory is not None and field is not None
    text: str = plot(
        Path(directory),
        field,
        None if scale is None else float(scale),
        view,
        None if save is None else Path(save),
        None if step is None else int(step),
    )
    return text
