"""`python -m benchmarks.peers PROBLEM NAME P OUTPUT.npz`: one peer here; the outcome is a line of JSON."""

from __future__ import annotations

import importlib
import json
import sys

import numpy as np

from coulomb.process import peak_memory

from . import PROBLEMS
from .answer import Answer


def main(problem: str, name: str, p: int, output: str) -> dict[str, object]:
    """Write points and forces to the file; the returned value goes to standard output.

    Any exception of the peer becomes a text for the table.
    """
    try:
        peer = PROBLEMS[problem][name]
        answer: Answer = getattr(importlib.import_module(f".{peer.module}", __package__), peer.function)(p)
    except Exception as error:
        said = " ".join(str(error).split())
        return {"failed": said[:300] or type(error).__name__}
    np.savez(output, points=answer.points, forces=answer.forces)
    return {
        "seconds": answer.seconds,
        "iterations": answer.iterations,
        "peak_memory_bytes": answer.peak_memory_bytes or peak_memory(),
        "figures": answer.figures,
        "first_seconds": answer.first_seconds,
        "products": answer.products,
    }


if __name__ == "__main__":
    report = main(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4])
    sys.stdout.write("\n" + json.dumps(report) + "\n")
