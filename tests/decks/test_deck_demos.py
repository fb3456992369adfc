"""The two decks of docs/decks.md as a new user runs them: the commands of the page, and what they say there."""

import re
import shlex
import shutil
import tomllib
from pathlib import Path

import numpy as np
from conftest import ROOT, run_coulomb

NUMBER = re.compile(r"-?\b\d+(?:\.\d+)?(?:e[-+]\d+)?\b")


def agree(line, said):
    """Whether one of the lines that a command has said begins as the line, with its numbers to 1e-3 of the largest."""
    words, numbers = NUMBER.sub("#", line), [float(one) for one in NUMBER.findall(line)]
    for other in said:
        found = [float(one) for one in NUMBER.findall(other)[: len(numbers)]]
        if NUMBER.sub("#", other).startswith(words) and len(found) == len(numbers):
            return np.allclose(found, numbers, rtol=0.0, atol=1e-3 * max(np.abs(numbers), default=1.0))
    return False


def test_the_page_is_what_the_commands_say(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "demos").mkdir()
    for name in ("blocks.inp", "assembly.inp"):
        shutil.copy(ROOT / "demos" / name, tmp_path / "demos" / name)
    page = (ROOT / "docs" / "decks.md").read_text().partition("## Two decks")[2].partition("\n## ")[0]
    said, runs = [], 0
    for line in (line[4:] for line in page.splitlines() if line.startswith("    ")):
        if line.startswith("coulomb "):
            words = shlex.split(line, comments=True)[1:]
            more = ["--set", "output.picture=false"] if words[0] == "run" else []
            done = run_coulomb(*words, *more)
            said, runs = [" ".join(one.split()) for one in done.stdout.splitlines()], runs + 1
        else:
            assert agree(" ".join(line.split()), said), line
    assert runs == 5 and Path("results/blocks/results.frd").is_file()
    (case,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    given, written = tomllib.loads(case), tomllib.loads(Path("demos/assembly.toml").read_text())
    assert given == {key: value for key, value in written.items() if key != "output"}
