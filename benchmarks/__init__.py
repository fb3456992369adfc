"""The tables of docs/measurements.md, from a checkout: `python -m benchmarks --help`.  Not part of the wheel."""
