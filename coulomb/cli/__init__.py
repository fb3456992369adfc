"""The command line: commands, progress, log, interruption.  Not imported by other parts of the package."""
