"""Peak memory of a process."""

from __future__ import annotations

import resource
from pathlib import Path


def peak_memory(pid: int | str = "self") -> int:
    """In bytes; 0 if the process is gone.

    From the kernel's high-water mark: getrusage counts in what a process was before it became another program, that is
    its parent's memory.  Where there is no such file, getrusage is what there is for this process.
    """
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if pid == "self" else 0
    return max((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), default=0)
