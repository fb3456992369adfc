"""The program: `coulomb`, or `python -m coulomb`.  Signals and streams are set up before anything else is loaded."""

import gc
import sys

from .process import begin

begin()
gc.set_threshold(200_000)  # else the modules to be loaded cost a tenth of a second of searches for garbage

from .pictures import drawing_process  # noqa: E402  (streams and signals are in order when it begins)

drawing_process.begin_early(sys.argv[1:])


def main() -> None:
    """Run the command line."""
    from .cli.app import main

    main()


if __name__ == "__main__":
    main()
