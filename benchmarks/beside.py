"""Parts by coulomb and by what users would take instead, a deck for all: `python -m benchmarks parts --peer NAME`."""

from __future__ import annotations

import itertools
import re
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from coulomb.arrays import FloatArray
from coulomb.decks.geometry import Geometry
from coulomb.io.run_directory import FRD, RunDirectory

from .decks import Nodes, at_nodes, slave_bodies
from .part_decks import DECKS, write
from .processes import alone

SIZES: Final = {
    "bracket": (0.8, 1.3),
    "foot": (0.7, 1.5),
    "hook": (0.0, 2.0),
    "ring": (0.7, 1.8),
    "flange": (1.0, 1.8),
    "pin_joint": (0.0, 1.2),
    "press_fit": (0.0, 1.8),
    "seal": (1.0, 0.0),
    "dome": (1.0, 1.8),
}
"""Factors of the mesh sizes of each part in first and second order; 0: not measured, of curved faces that fit
each other in first order, whose chords gape or overlap by more than their clearance; of the seal in second order gmsh
makes prisms."""

PEERS: Final = ("CalculiX", "GetFEM")
_AUGMENTATIONS: Final = (1.0, 0.1, 0.01)
_RIGID: Final = "1.E11"
"""Slope of CalculiX' mortar method, MPa/mm, whose multipliers allow one so large that its penetration is negligible."""


class Row(NamedTuple):
    """A row of beside.csv.

    Attributes:
        part, order: What, and of which elements.
        unknowns: Of displacement.
        program: With its method.
        outcome: solved, or why not; of coulomb also "not valid".
        cpu_seconds: Of whole processes, files read and written.
        ratio: Over those of coulomb; None without an answer.
        force: Size of the sum of the contact forces on the first slave's body, newtons.
        force_differs, u_differs: From coulomb, over its force, and over the largest displacement.
    """

    part: str
    order: int
    unknowns: int
    program: str
    outcome: str
    cpu_seconds: float
    ratio: float | None = None
    force: float | None = None
    force_differs: float | None = None
    u_differs: float | None = None


class _Answer(NamedTuple):
    outcome: str
    cpu_seconds: float
    u: Nodes = {}  # noqa: RUF012
    force: FloatArray = np.zeros(3)


def measure(
    names: Sequence[str] | None, peers: Sequence[str], limit: float, scales: Sequence[float]
) -> Iterator[Row | str]:
    """Rows as they are measured, first that of coulomb; a text where there is no mesh.

    Args:
        names: Of SIZES; None for all.
        peers: Of PEERS.
        limit: Processor seconds for each run.
        scales: Factors of SIZES.

    Raises:
        ValueError: If a name is unknown.
    """
    for given, known in ((names or (), SIZES), (peers, PEERS)):
        if unknown := [name for name in given if name not in known]:
            raise ValueError(f"there is no {unknown[0]!r} here; there are {', '.join(known)}")
    for scale, order, name in itertools.product(scales, (1, 2), names or SIZES):
        with tempfile.TemporaryDirectory() as folder:
            if size := scale * SIZES[name][order - 1]:
                try:
                    deck = write(DECKS / f"{name}.inp", size, order, Path(folder))
                except RuntimeError as error:
                    yield f"{name}, order {order}: {error}"
                    continue
                yield from _beside(deck, order, peers, limit)


def fields(
    names: Sequence[str] | None, peers: Sequence[str], limit: float, scales: Sequence[float]
) -> Iterator[Mapping[str, object] | str]:
    """`measure` for `benchmarks.__main__.table`."""
    return (row if isinstance(row, str) else row._asdict() for row in measure(names, peers, limit, scales))


def draw(rows: Sequence[Mapping[str, object]], directory: Path | None) -> None:
    """Processor seconds of every run, crosses where there is no answer: beside.png in the directory."""
    if directory is None or not rows:
        return
    runs = [f"{row['part']} {row['order']}, {row['unknowns']}" for row in rows]
    figure = Figure(figsize=(8.0, 2.0 + 0.25 * len(set(runs))), layout="constrained")
    axis = figure.subplots()
    places = {run: place for place, run in enumerate(dict.fromkeys(runs))}
    for program, colour in zip(dict.fromkeys(row["program"] for row in rows), ("k", "C0", "C2", "C1"), strict=False):
        for ended, marker in ((True, "o"), (False, "x")):
            own = [k for k, row in enumerate(rows) if row["program"] == program and (row["ratio"] is not None) == ended]
            seconds = [rows[k]["cpu_seconds"] for k in own]
            axis.plot(seconds, [places[runs[k]] for k in own], colour + marker, label=program if ended else None)
    axis.set_yticks(range(len(places)), [run.replace("_", " ") for run in places])
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.set_xlabel("processor seconds of the whole process (crosses: no answer)")
    axis.grid(alpha=0.3)
    axis.legend()
    figure.savefig(directory / "beside.png", dpi=110)


def _beside(deck: Path, order: int, peers: Sequence[str], limit: float) -> Iterator[Row]:
    programs: dict[str, Callable[[Path, float], _Answer]] = {"coulomb": _coulomb}
    if "CalculiX" in peers:
        programs |= {"CalculiX, penalty": _calculix, "CalculiX, mortar": partial(_calculix, mortar=True)}
    if "GetFEM" in peers and "*HYPERELASTIC" not in deck.read_text():
        programs |= {"GetFEM": _getfem}
    ours = _Answer("", 0.0)
    for program, run in programs.items():
        answer = run(deck, limit)
        ours = answer if program == "coulomb" else ours
        row = Row(deck.stem, order, 3 * _count(deck), program, answer.outcome, round(answer.cpu_seconds, 2))
        if answer.u and ours.u:
            force = float(np.linalg.norm(ours.force)) or 1.0
            row = row._replace(ratio=answer.cpu_seconds / ours.cpu_seconds, force=float(np.linalg.norm(answer.force)))
            row = row._replace(force_differs=float(np.linalg.norm(answer.force - ours.force)) / force)
            if common := answer.u.keys() & ours.u.keys():
                largest = max(float(np.linalg.norm(ours.u[node])) for node in common)
                away = max(float(np.linalg.norm(answer.u[node] - ours.u[node])) for node in common)
                row = row._replace(u_differs=away / largest)
        yield row


def _coulomb(deck: Path, limit: float) -> _Answer:
    command = [sys.executable, "-m", "coulomb", "run", deck.name, "--quiet", "--set", "output.picture=false"]
    said, seconds = _run(command, deck.parent, limit)
    results = deck.parent / "results" / deck.stem
    if not (results / FRD).is_file():
        return _Answer(said or "no answer", seconds)
    whole = RunDirectory(results)
    last = whole.step(whole.complete_steps[-1]) if whole.complete_steps else whole
    sets, body = Geometry(str(deck)).node_sets, slave_bodies(deck, 1)
    faces = last.read_summary()["faces"]
    forces = [face["force"] for face in faces if int(sets.members(face["faces"][0])[0]) in body]
    return _Answer("not valid" if said else "solved", seconds, at_nodes(results / FRD, "DISP"), np.sum(forces, axis=0))


def _calculix(deck: Path, limit: float, mortar: bool = False) -> _Answer:
    """Penalty between faces, with the slopes of the deck, or multipliers of the dual mortar method."""
    folder = deck.parent / ("mortar" if mortar else "penalty")
    folder.mkdir()
    text = deck.read_text()
    if mortar:
        text = text.replace("TYPE=SURFACE TO SURFACE", "TYPE=MORTAR")
        text = re.sub(r"(OVERCLOSURE=LINEAR\n).*", rf"\g<1>{_RIGID}", text)
        text = re.sub(r"(\*FRICTION\n[^,]*),.*", rf"\1, {_RIGID}", text)
    (folder / "deck.inp").write_text(text)
    said, seconds = _run(["ccx", "deck"], folder, limit)
    try:
        u, forces = (at_nodes(folder / "deck.frd", name) for name in ("DISP", "FORC"))
    except (OSError, ValueError):
        said = said or "no answer"
    if said:
        return _Answer(said, seconds)
    bodies = slave_bodies(deck, 1)
    return _Answer("solved", seconds, u, -np.sum([forces[node] for node in forces.keys() & bodies], axis=0))


def _getfem(deck: Path, limit: float) -> _Answer:
    """The first augmentation that converges; its time alone counts."""
    out = deck.parent / "getfem.npz"
    for augmentation in _AUGMENTATIONS:
        command = [sys.executable, "-m", "benchmarks.peers.part_getfem", str(deck), str(augmentation), str(out)]
        said, seconds = _run(command, deck.parent, limit)
        if not said:
            with np.load(out) as answer:
                u = dict(zip(map(int, answer["numbers"]), answer["u"], strict=True))
                return _Answer("solved", seconds, u, answer["force"])
        if said.startswith(">"):
            break
    return _Answer(said, seconds)


def _run(command: list[str], folder: Path, limit: float) -> tuple[str, float]:
    """What a program that failed said, nothing of one that did not, and its processor seconds."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 1))

    before = _children()
    with (folder / "log").open("w") as log:
        done = subprocess.run(
            command, cwd=folder, env=alone(), stdout=log, stderr=subprocess.STDOUT, check=False, preexec_fn=limited
        )
    seconds = _children() - before
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"> {limit:g} s", seconds
    found = re.search(r"\*?error:?\s+(.*)", (folder / "log").read_text(errors="replace"), re.IGNORECASE)
    said = found[1][:120] if found else f"ended with code {done.returncode}"
    return said if done.returncode else "", seconds


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _count(deck: Path) -> int:
    text = deck.read_text()
    return text[: text.index("*ELEMENT")].count("\n") - 1
