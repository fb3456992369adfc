"""`python -m coulomb.benchmarks.peers NAME P OUTPUT.npz`: one peer in this process; a JSON line has the outcome."""

from __future__ import annotations

import importlib
import json
import sys

import numpy as np

from ...io.peak_memory import peak_memory
from . import PEERS
from .answer import Answer


def main(name: str, p: int, output: str) -> dict[str, float | str]:
    """Write points and forces to the file; the returned value goes to standard output.

    Any exception of the peer becomes a text for the table.
    """
    try:
        answer: Answer = importlib.import_module(f".{PEERS[name].module}", __package__).solve(p)
    except Exception as error:
        said = " ".join(str(error).split())
        return {"failed": said[:300] or type(error).__name__}
    np.savez(output, points=answer.points, forces=answer.forces)
    return {
        "seconds": answer.seconds,
        "iterations": answer.iterations,
        "peak_memory_bytes": answer.peak_memory_bytes or peak_memory(),
    }


if __name__ == "__main__":
    report = main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
    sys.stdout.write("\n" + json.dumps(report) + "\n")
