"""The run directory: written, read, checked again; summary, lock, FCLIB files, versions."""
