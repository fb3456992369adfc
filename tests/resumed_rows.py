"""Rows of history.csv of a run that was interrupted, beside those of one that was not."""

import csv

SOLVER = {"outer", "path_following", "krylov", "products", "residual"}


def rows_of(folder):
    """The rows of a history, names to texts."""
    with (folder / "history.csv").open() as lines:
        return list(csv.DictReader(lines))


def same_to_the_tolerance(one, other):
    """Whether two rows are the same figures to a residual of 1e-8, that is to an error of 1e-7.

    They are not equal in all digits: what the solver has found of A in earlier steps is not in the files.  The error is
    the residual times (1 + L)/m, L and m the extreme eigenvalues of A over their mean.
    """
    assert list(one) == list(other)
    names = [name for name in one if name not in SOLVER and not name.endswith("_balance")]
    size: dict[str, float] = {}
    for name in names:  # components of a vector relative to its largest
        if one[name] not in ("True", "False", ""):
            size[_vector(name)] = max(size.get(_vector(name), 0.0), abs(float(one[name])))
    for name in names:
        equal = one[name] == other[name]
        assert equal or abs(float(one[name]) - float(other[name])) <= 1e-7 * size[_vector(name)] + 1e-12, name
    return True


def _vector(name):
    """What its error is a part of: of all energies, forces or moments, of which one may be a difference of others."""
    for kind in ("energy", "force", "moment"):
        if kind in name.split("_"):
            return kind
    return name.removesuffix("_x").removesuffix("_y").removesuffix("_z")
