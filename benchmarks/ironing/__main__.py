"""`python -m benchmarks.ironing PROGRAM P DRAWING OUTPUT.npy`: one run here; the outcome is a line of JSON."""

from __future__ import annotations

import importlib
import json
import sys

import numpy as np

from . import PROGRAMS, Run


def main(name: str, p: int, drawing: int, output: str) -> dict[str, object]:
    """Write the forces to the file; any exception of the program becomes a text for the table."""
    try:
        peer = PROGRAMS[name]
        run: Run = getattr(importlib.import_module(f".{peer.module}", __package__), peer.function)(p, drawing)
    except Exception as error:
        said = " ".join(str(error).split())
        return {"failed": said[:300] or type(error).__name__}
    np.save(output, run.forces)
    return {"seconds": run.seconds, "iterations": run.iterations, "steps": run.steps}


if __name__ == "__main__":
    report = main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
    sys.stdout.write("\n" + json.dumps(report) + "\n")
