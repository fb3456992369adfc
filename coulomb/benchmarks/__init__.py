"""Measurements behind the choices: each returns the rows of its table, the command line prints them."""
