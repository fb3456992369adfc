"""`page DIRECTORY FILE`, or `plot DIRECTORY FIELD SCALE VIEW SAVE STEP`: what the command line calls, apart.

Exit code 2 and a line of standard error if the input is wrong.
"""

import sys

if __name__ == "__main__":
    kind, *arguments = sys.argv[1:]
    try:
        if kind == "page":
            from .page import main
        else:
            from .picture import main
        sys.stdout.write(main(arguments))
    except ValueError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(2)
