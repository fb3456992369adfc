"""Peak memory of a process."""

from __future__ import annotations

import resource
from pathlib import Path


def peak_memory(pid: int | str = "self") -> int:
    """Peak memory in bytes; 0 if the process has ended.

    From the kernel's high-water mark, since getrusage includes the memory before exec, that is, the parent's.  Without
    such a file, getrusage is used for this process.
    """
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
    except OSError:
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss if pid == "self" else 0
    return max((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), default=0)
