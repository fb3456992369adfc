"""Texts of cases: mesh, material and bodies, a line each, to which a test adds its supports, loads and contacts."""


def _inline(**values):
    return "{ " + ", ".join(f"{key} = {value}" for key, value in values.items()) + " }"


def _box(lengths, cells, cell, degree):
    kind = {} if cell == "hexahedron" else {"cell": f'"{cell}"'}
    kind |= {} if degree == 1 else {"degree": degree}
    return {"box": list(map(float, lengths)), "cells": list(cells), **kind}


def one_body(lengths, cells, young=2e11, poisson=0.3, cell="hexahedron", degree=1, **material):
    """The tables `mesh` and `material`, at the top of a case."""
    mesh, material = _inline(**_box(lengths, cells, cell, degree)), _inline(young=young, poisson=poisson, **material)
    return f"mesh = {mesh}\nmaterial = {material}\n"


def body(name, lengths, cells, at=None, young=2e11, poisson=0.3, cell="hexahedron", degree=1, **material):
    """A table `[[body]]` of a box, moved to `at`."""
    given = {"name": f'"{name}"', **_box(lengths, cells, cell, degree)}
    given |= {} if at is None else {"translate": list(at)}
    given["material"] = _inline(young=young, poisson=poisson, **material)
    return "[[body]]\n" + "".join(f"{key} = {value}\n" for key, value in given.items())
