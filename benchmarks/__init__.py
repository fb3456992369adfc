"""The tables of docs/measurements.md, from a checkout: `python -m benchmarks --help`.  Not part of the wheel.

In `measured` is what has been measured, a CSV file per table, with its commands.
"""
