"""The program: `coulomb`, or `python -m coulomb`.  The process is put in order before anything else is loaded."""

from .process import begin

begin()


def main() -> None:
    """Run the command line."""
    from .cli.app import main

    main()


if __name__ == "__main__":
    main()
