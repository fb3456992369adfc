"""Decks of CalculiX beside CalculiX: displacements and contact forces of `coulomb run DECK.inp`, of ccx with the deck
as it is, and with its penalties (contact stiffness, stick slope) 100 times stiffer; displacements of NAME.dat.ref."""

from __future__ import annotations

import contextlib
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from coulomb.decks.cards import key_of, read_cards
from coulomb.decks.geometry import Geometry
from coulomb.io.run_directory import FRD, RunDirectory

Nodes = dict[int, npt.NDArray[np.float64]]

STIFFER = 100.0

_HARD = 50.0
"""Stiffness of CalculiX' hard contact over the first elastic constant."""


def rows(folder: Path, seconds: float = 300.0) -> Iterator[Mapping[str, object]]:
    """A row for each deck of a folder: what refuses it, or the contact force on the slaves' bodies, the differences of
    displacements at its nodes to those of ccx, over the largest, and cpu seconds of both."""
    for deck in sorted(folder.glob("*.inp")):
        with tempfile.TemporaryDirectory() as temporary:
            here = Path(temporary)
            shutil.copy(deck, here / deck.name)
            yield {"deck": deck.stem, **_row(here / deck.name, deck.with_suffix(".dat.ref"), seconds)}


def _row(deck: Path, reference: Path, seconds: float) -> Mapping[str, object]:
    columns = (
        "result",
        "cells",
        "steps",
        "force N",
        "stiff ccx N",
        "largest u",
        "reference",
        "ccx",
        "stiff ccx",
        "cpu s",
        "ccx cpu s",
    )
    row: dict[str, object] = dict.fromkeys(columns, "")
    row["cells"] = _cells(deck)
    command = [sys.executable, "-m", "coulomb", "run", deck.name, "--quiet", "--set", "output.picture=false"]
    before = _children()
    done = subprocess.run(command, cwd=deck.parent, capture_output=True, text=True, check=False, timeout=seconds)
    row["cpu s"] = round(_children() - before, 2)
    results = deck.parent / "results" / deck.stem
    if not (results / FRD).exists():
        row["result"] = _reason(done.stderr)
        return row
    row["result"] = "valid" if done.returncode == 0 else "not valid"
    whole, steps = RunDirectory(results), RunDirectory(results).complete_steps
    row["steps"] = len(steps) or 1
    faces = (whole.step(steps[-1]) if steps else whole).read_summary()["faces"]
    row["force N"] = _force([np.array(one["force"]) for one in faces])
    given = set(map(int, Geometry(str(deck)).tags))  # both add nodes in a bolt's section, in different orders
    own = {node: u for node, u in at_nodes(results / FRD, "DISP").items() if node in given}
    row["largest u"] = f"{max(np.linalg.norm(u) for u in own.values()):.6g}"
    if reference.exists() and (listed := listed_displacements(reference)):
        row["reference"] = _difference(own, listed)
    for column, factor in (("ccx", 1.0), ("stiff ccx", STIFFER)):
        before = _children()
        found = _ccx(deck, factor, seconds)
        if factor == 1.0:
            row["ccx cpu s"] = round(_children() - before, 2)
        row[column] = found if isinstance(found, str) else _difference(own, found)
    if not isinstance(found, str):
        forces, bodies = at_nodes(deck.parent / f"ccx{STIFFER:g}" / "deck.frd", "FORC"), slave_bodies(deck)
        row["stiff ccx N"] = _force([-force for node, force in forces.items() if node in bodies])
    return row


def _force(forces: Sequence[npt.NDArray[np.float64]]) -> str:
    total = np.sum(forces, axis=0)
    return " ".join(f"{one:.4g}" for one in np.where(np.abs(total) > 1e-5 * np.abs(total).max(), total, 0.0))


def slave_bodies(deck: Path, pairs: int | None = None) -> set[int]:
    """The nodes of the bodies of the slave surfaces, of the first pairs alone if their number is given.

    Where no such body is a master of another pair, ccx' forces at them, which are of the stresses inside, add up to the
    contact force, turned.
    """
    geometry = Geometry(str(deck))
    elements = list(geometry.solids.values())
    found: npt.NDArray[np.int64] = np.empty(0, dtype=np.int64)
    slaves = [words[0] for card in geometry.cards if card.kind == "CONTACTPAIR" for _, words in card.rows()]
    for slave in slaves[:pairs]:
        surface = geometry.surfaces.get(key_of(slave))
        for what, _ in [(slave, "")] if surface is None or surface.nodes else surface.lines:
            if surface is None or surface.nodes:
                found = np.union1d(found, geometry.node_sets.members(slave))
                continue
            numbers = [what] if isinstance(what, int) else geometry.element_sets.members(what)
            found = np.union1d(found, np.concatenate([of[np.isin(of[:, 0], numbers), 1:].ravel() for of in elements]))
    count = -1
    while len(found) != count:
        count = len(found)
        touched = [of[np.any(np.isin(of[:, 1:], found), axis=1), 1:].ravel() for of in elements]
        found = np.union1d(found, np.concatenate(touched))
    return set(map(int, found))


def _reason(text: str) -> str:
    """The refused cards, or the first line of an error."""
    cards = re.findall(r"^  (\*[^:]+):", text, re.MULTILINE)
    lines = [line for line in text.splitlines() if line.startswith("error")]
    return "refused: " + ", ".join(cards) if cards else (lines[0][:90] if lines else "failed")


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _ccx(deck: Path, factor: float, seconds: float) -> Nodes | str:
    """Displacements of ccx at the end, by node; or why there are none."""
    if shutil.which("ccx") is None:
        return "no ccx"
    folder = deck.parent / f"ccx{factor:g}"
    folder.mkdir()
    (folder / "deck.inp").write_text(stiffened(deck, factor))
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    try:
        subprocess.run(["ccx", "deck"], cwd=folder, capture_output=True, check=False, timeout=seconds, env=environment)
    except subprocess.TimeoutExpired:
        return f"> {seconds:g} s"
    file = folder / "deck.frd"
    try:
        return at_nodes(file, "DISP")
    except (OSError, ValueError):
        return "fails"


def stiffened(deck: Path, factor: float) -> str:
    """The text of a deck with stiffer penalties, that writes displacements."""
    lines: list[str] = []
    cards = read_cards(str(deck))
    young = next((card.floats([0])[0] for card in cards if card.kind == "ELASTIC" and card.lines), 0.0)
    for card in cards:
        data = list(card.lines)
        if factor != 1.0 and card.kind == "SURFACEBEHAVIOR" and card.key("PRESSURE-OVERCLOSURE") == "HARD":
            card.parameters["PRESSURE-OVERCLOSURE"], data = "LINEAR", [repr(float(_HARD * young))]
        parameters = "".join(f",{name}={value}" if value else f",{name}" for name, value in card.parameters.items())
        if card.kind == "SURFACEBEHAVIOR" and card.key("PRESSURE-OVERCLOSURE") in ("LINEAR", "TIED") and data:
            data[0] = _scaled(data[0], 0, factor)
        if card.kind == "SURFACEBEHAVIOR" and card.key("PRESSURE-OVERCLOSURE") == "EXPONENTIAL" and data:
            data[0] = _scaled(data[0], 0, 1.0 / factor)
        if card.kind == "FRICTION" and data:
            coefficient, _, slope = data[0].partition(",")
            given = slope.partition(",")[0].strip() or repr(0.5 * float(young))
            data[0] = _scaled(f"{coefficient},{given}", 1, factor)
        if card.kind == "ENDSTEP":
            lines += ["*NODE FILE", "U, RF"]
        lines += [f"*{card.keyword}{parameters}", *data]
    return "\n".join(lines) + "\n"


def _scaled(line: str, column: int, factor: float) -> str:
    words = line.split(",")
    if len(words) > column and words[column].strip():
        words[column] = repr(float(words[column].upper().replace("D", "E")) * factor)
    return ",".join(words)


def at_nodes(path: Path, name: str) -> Nodes:
    """The vectors of the last block of a name, as DISP, of an .frd file, by node; ValueError if there is none."""
    found: Nodes = {}
    inside = False
    for line in path.read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith(" -4"):
            inside = line[5:13].strip() == name
            found = {} if inside else found
        elif line.startswith(" -3"):
            inside = False
        elif inside and line.startswith(" -1"):
            found[int(line[3:13])] = np.array([float(line[13 + 12 * k : 25 + 12 * k]) for k in range(3)])
    if not found:
        raise ValueError(f"{path}: has no {name}")
    return found


def listed_displacements(path: Path) -> Nodes:
    """The displacements of the last block of a .dat file that has some, by node; empty if there is none."""
    found: Nodes = {}
    inside = False
    for line in path.read_text(encoding="ascii", errors="replace").splitlines():
        words = line.split()
        if "for set" in line:
            inside = line.lstrip().startswith("displacements")
            found = {} if inside else found
        elif inside and len(words) == 4:
            found[int(words[0])] = np.array([float(word) for word in words[1:]])
    return found


def _cells(deck: Path) -> str:
    """The types of its elements, with their number."""
    found: dict[str, int] = {}
    with contextlib.suppress(ValueError):
        for name, blocks in Geometry(str(deck)).elements.items():
            found[name] = sum(map(len, blocks))
    return ", ".join(f"{count} {name}" for name, count in found.items())


def _difference(own: Nodes, other: Nodes) -> str:
    common = sorted(own.keys() & other.keys())
    if not common:
        return "no common nodes"
    a, b = (np.array([nodes[n] for n in common]) for nodes in (own, other))
    largest = float(np.abs(b).max())
    return f"{100.0 * float(np.abs(a - b).max()) / largest:.2f} %" if largest else "0"
