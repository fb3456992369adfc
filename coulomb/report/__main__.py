"""`page DIRECTORY FILE`, `overview`, or `plot DIRECTORY FIELD SCALE VIEW SAVE STEP`: called apart by the command line.

Exit code 2 and a line of standard error if the input is wrong.
"""

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
    except ValueError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)
