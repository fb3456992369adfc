"""`page DIRECTORY FILE`, `overview`, or `plot DIRECTORY FIELD SCALE VIEW SAVE STEP`: run in a separate process by the
command line.

On failure one line on standard error, and exit code 2 if the input is wrong, 1 if there is no room for the file.
"""

import os
import sys

if __name__ == "__main__":
    kind, *arguments = sys.argv[1:]
    try:
        if kind == "page":
            from .page import main
        elif kind == "overview":
            from .overview import main
        else:
            from .picture import main
        sys.stdout.write(main(arguments))
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)  # the files are written, and VTK needs 0.1 to 0.2 s to close its windows
    except ValueError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        sys.stderr.write(f"{place}{error.strerror or error}\n")
        sys.exit(1)
