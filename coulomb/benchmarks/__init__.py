"""Benchmarks: each module returns the rows of its table, and the command line prints them."""
