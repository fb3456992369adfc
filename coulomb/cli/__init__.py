"""The command line: commands, progress, log, interruption.  Nobody imports it."""
