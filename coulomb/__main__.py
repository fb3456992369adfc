"""The program: `coulomb`, or `python -m coulomb`.  Signals and streams are set up before anything else is loaded."""

import gc

from .process import begin

begin()
gc.set_threshold(200_000)  # else the modules to be loaded cost a tenth of a second of searches for garbage


def main() -> None:
    """Run the command line."""
    from .cli.app import main

    main()


if __name__ == "__main__":
    main()
