"""The run directory: writing, reading, rechecking; summary, lock, FCLIB files, versions."""
