"""Case files: TOML, validated, and converted to a problem and its solver.

`case.read_case` reads a file and returns a `case.Case`, whose `problem` and `contact_solver` are what the file
describes.  The tables of a case are pydantic models: `bodies`, `material`, `loads`, `contact`, `solver`; `values` and
`curves` have the types of their entries, `error_messages` says what is wrong with them.
"""
