"""How much of the house one run goes through: `python -m benchmarks.trace [CASE.toml]`, by sys.setprofile.

Counts files and functions of `coulomb` that are entered, and how often the file changes from one call to the next;
class bodies and modules run at import are counted apart.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
HOUSE = str(ROOT / "coulomb")


def main(case: str) -> None:
    """Run a case without a picture in this process, and print the counts."""
    entered: set[tuple[str, str, int]] = set()
    changes, last = 0, ""

    def called(frame: FrameType, event: str, _: Any) -> None:
        nonlocal changes, last
        file = frame.f_code.co_filename
        if event == "call" and file.startswith(HOUSE):
            entered.add((file, frame.f_code.co_qualname, frame.f_code.co_firstlineno))
            changes += file != last
            last = file

    with tempfile.TemporaryDirectory() as folder:
        arguments = ["run", case, "--output", folder, "--set", "output.picture=false", "--quiet"]
        sys.setprofile(called)
        try:
            from coulomb.cli.app import app

            app(arguments, standalone_mode=False)
        finally:
            sys.setprofile(None)
    # A class body has the name of its class, a module "<module>": neither is called by the run itself.
    run = {one for one in entered if not one[1].rpartition(".")[2].lstrip("_")[:1].isupper() and one[1] != "<module>"}
    for what, found in (("with imports and class bodies", entered), ("functions alone", run)):
        print(f"{what}: {len({file for file, *_ in found})} files, {len(found)} functions and bodies")
    print(f"changes of file: {changes}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else str(ROOT / "demos" / "block.toml"))
