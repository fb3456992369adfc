"""Wrong inputs and their messages: the table behind docs/errors.md.

Rewritten by `python tests/wrong_inputs.py`; `mpirun -n 2 python tests/wrong_inputs.py` runs it on two ranks
and compares the messages of the ranks.
"""

import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

from wrong_bodies import SEVERAL
from wrong_cases import CASE_FILES, CONTACT, MATERIALS_AND_LOADS
from wrong_commands import COMMANDS
from wrong_files import MESHES, RESOURCES
from wrong_gaps import GAPS
from wrong_input import BLOCK, case, comm, said
from wrong_loads import LOADS
from wrong_materials import MATERIALS
from wrong_probes import PROBES
from wrong_rigid import RIGID
from wrong_supports import SUPPORTS
from wrong_values import VALUES

from coulomb.cli import app as cli

DOCUMENT = Path(__file__).parents[1] / "docs" / "errors.md"

TABLE = {
    "Case files": CASE_FILES,
    "Values": VALUES,
    "Materials, loads, history": MATERIALS_AND_LOADS,
    "Orthotropic materials, temperature": MATERIALS,
    "Supports": SUPPORTS,
    "Loads, expressions, load curves": LOADS,
    "Meshes": MESHES,
    "Several bodies": SEVERAL,
    "Contact": [*CONTACT, *GAPS],
    "Probes": PROBES,
    "Rigid bodies": RIGID,
    "Machine": RESOURCES,
    "Commands": COMMANDS,
}
ALL = [wrong for rows in TABLE.values() for wrong in rows]


def answer(wrong, directory):
    """Exit code of a wrong input in an empty directory, and this rank's message; collective."""
    home = Path.cwd()
    os.chdir(directory)
    try:
        if comm.rank == 0:
            case(BLOCK)()
        collective = getattr(wrong.prepare, "__qualname__", "").startswith("ran.")
        if collective or comm.rank == 0:
            wrong.prepare()
        comm.barrier()
        with said() as heard, wrong.patch():
            try:
                cli.app(list(wrong.arguments))
                code = 0
            except SystemExit as end:
                code = end.code or 0
        comm.barrier()
    finally:
        os.chdir(home)
    text = heard.getvalue().strip().replace(f"{directory}/", "").replace(str(directory), ".")
    return code, text


def shown(wrong, text):
    """The message as in the document, without the text of libraries."""
    start = text.find(wrong.library) if wrong.library else -1
    return text if start < 0 else text[: start + len(wrong.library)].rstrip() + " ..."


def document(answers):
    """The table in Markdown; on one rank.

    Args:
        answers: Exit codes and messages by `what`; the others are asked for.
    """
    lines = [
        "# Messages about wrong input",
        "",
        "Written by `python tests/wrong_inputs.py`; `tests/cli/test_errors.py` compares it on one rank and on two. An",
        "error ends with exit code 2 before anything is solved, unless another code is given; after a warning the run",
        "continues. Here the case is `case.toml`, its mesh `part.msh`, its output `results`.",
    ]
    for title, rows in TABLE.items():
        lines += ["", f"## {title}", "", "| input | message |", "|---|---|"]
        for wrong in rows:
            if wrong.alone is None:
                continue
            if wrong.what in answers:
                code, text = answers[wrong.what]
            else:
                with tempfile.TemporaryDirectory() as directory:
                    code, text = answer(wrong, directory)
            ends = "" if code in (0, 2) else f" (exit code {code})"
            contents = "<br>".join(shown(wrong, text).replace("|", r"\|").splitlines())
            lines.append(f"| {wrong.what}{ends} | {contents} |")
    return "\n".join(lines) + "\n"


def walk():
    """Every input on all ranks; the faults found, the same on every rank."""
    faults = []
    for wrong in ALL:
        if wrong.alone:
            continue
        directory = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
        answers = comm.allgather(answer(wrong, directory))
        if comm.rank == 0:
            shutil.rmtree(directory)
        if len(set(answers)) > 1:
            faults.append(f"{wrong.what}: the ranks do not agree: {answers}")
        code, text = answers[0]
        if code != wrong.code or not re.search(wrong.message, text):
            faults.append(f"{wrong.what}: exit code {code}, {text!r}")
    return faults


if __name__ == "__main__":
    if comm.size == 1:
        DOCUMENT.write_text(document({}), encoding="utf-8")
    else:
        found = walk()
        if comm.rank == 0:
            print(
                "\n".join(found)
                or f"{len([w for w in ALL if not w.alone])} wrong inputs, the same on {comm.size} ranks"
            )
        sys.exit(bool(found))
