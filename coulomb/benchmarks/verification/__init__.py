"""Problems whose answers are known, one a module: physics, formula, what we get, and the tolerance with its reason.

`coulomb benchmark verification` prints the table; tests/verification asserts its rows.
"""
