"""`page DIRECTORY FILE`, the same with picture.png as `both`, `overview`, or `plot ARGUMENTS` in JSON: in a separate
process by the command line (`drawing_process`), with which it ends.

On failure one line on standard error, and exit code 2 if the input is wrong, 1 if a package or the room for the file is
missing.
"""

import contextlib
import ctypes
import os
import signal
import sys
from typing import Final

from ..drawing_process import missing

_LINUX_DIE_WITH_PARENT: Final = 1  # prctl's PR_SET_PDEATHSIG

if __name__ == "__main__":
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_LINUX_DIE_WITH_PARENT, int(signal.SIGKILL), 0, 0, 0)
    kind, *arguments = sys.argv[1:]
    try:
        if kind == "page":
            from .page import main
        elif kind == "both":
            from .page import with_picture as main
        elif kind == "overview":
            from .picture import overview as main
        else:
            from .picture import main
        sys.stdout.write(main(arguments))
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)  # the files are written, and VTK needs 0.1 to 0.2 s to close its windows
    except ModuleNotFoundError as error:
        if not missing(error):
            raise
        sys.exit(missing(error))
    except ValueError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        sys.stderr.write(f"{place}{error.strerror or error}\n")
        sys.exit(1)
