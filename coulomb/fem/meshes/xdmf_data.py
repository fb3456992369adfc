"""The grids of an XDMF file, as rank 0 finds them in the XML, and their arrays, of which every rank reads its share."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...regular_file import read_bytes, refuse_irregular
from ..geometry import on_all_ranks
from .exchange import even_starts, fetched, starts_of

NAMES = "coulomb:names"
"""Name of the Information element with the names of numbers, as {"faces": {"sole": 3}, "cells": {"steel": 1}}: the XDMF
format has elements for data of a program, but no names for numbers on cells."""

_WHOLE = ("Int", "UInt", "Char", "UChar")


@dataclass(frozen=True)
class XdmfArray:
    """An array of a file, the same on every rank.

    Attributes:
        place: HDF5 file and the dataset's path in it; None if the numbers are in the XML.
        number: Of those in the XML, which array it is.
        shape: Of the whole.
        whole: Whether the numbers are whole ones.
    """

    place: tuple[str, str] | None
    number: int
    shape: tuple[int, ...]
    whole: bool


@dataclass(frozen=True)
class XdmfGrid:
    """A Grid of a file.

    Attributes:
        kind: Of its cells, as in the XML in lower case.
        topology: Points of every cell.
        geometry: The last one up to this Grid; None if there is none.
        numbers: Attributes on the cells that are whole numbers, by name.
    """

    kind: str
    topology: XdmfArray
    geometry: XdmfArray | None
    numbers: dict[str, XdmfArray]


class XdmfFile:
    """An XDMF file that several ranks read; collective.

    Args:
        path: The file; rank 0 reads the XML, and every rank its share of the rows of the HDF5 datasets.
        comm: The ranks.

    Attributes:
        grids: Its Grids that have cells.
        names: Names of the numbers on facets ("faces") and on cells ("cells") in its Information element, if any.

    Raises:
        ValueError: On every rank, if the file cannot be read or is not XDMF.
    """

    def __init__(self, path: str, comm: MPI.Comm):
        self.path, self.comm = path, comm
        self._texts: list[npt.NDArray[Any]] = []
        found: tuple[list[XdmfGrid], dict[str, dict[str, int]]] | None = None
        fault = ""
        if comm.rank == 0:
            try:
                found = self._described()
            except OSError as error:
                fault = f"{error.filename or path}: cannot be read: {error.strerror or error}"
            except ValueError as error:
                fault = str(error)
            except Exception as error:  # no error due to a damaged file may leave the other ranks waiting
                fault = f"{path}: is damaged: {type(error).__name__}: {error}"
        fault, found = comm.bcast((fault, found))
        if found is None:
            raise ValueError(fault)
        self.grids: list[XdmfGrid] = found[0]
        self.names: dict[str, dict[str, int]] = found[1]

    def part(self, array: XdmfArray, width: int | None = None) -> npt.NDArray[Any]:
        """This rank's rows: rows are shared evenly; those in the XML are all on rank 0; collective.

        Args:
            array: One of this file.
            width: Numbers of a row; by default those that the array has.

        Raises:
            ValueError: On every rank, if they cannot be read.
        """

        def read() -> npt.NDArray[Any]:
            if array.place is None:
                rest = array.shape[1:] if width is None else (width,)
                if self.comm.rank == 0:
                    return self._texts[array.number].reshape(-1, *rest)
                return np.empty((0, *rest), dtype=np.int64 if array.whole else np.float64)
            per_row = int(np.prod(array.shape[1:])) if width is None else width
            share = even_starts(self.comm.size, int(np.prod(array.shape)) // max(per_row, 1))
            first, last = int(share[self.comm.rank]), int(share[self.comm.rank + 1])
            with h5py.File(array.place[0], "r") as file:
                data = file[array.place[1]]
                if width is None or array.shape[1:] == (width,):
                    return np.asarray(data[first:last])
                if len(array.shape) == 1:
                    return np.asarray(data[first * width : last * width]).reshape(-1, width)
                return np.asarray(data).reshape(-1, width)[first:last]

        where = "numbers in the XML" if array.place is None else f"the data {array.place[0]}:{array.place[1]}"
        return on_all_ranks(read, f"{self.path}: {where} cannot be read", self.comm)

    def beside(self, values: XdmfArray, rows: int) -> npt.NDArray[Any]:
        """The values of an array with one number per row of another array, of which this rank has so many rows;
        collective."""
        found = np.ravel(self.part(values, 1))
        theirs, ours = starts_of(self.comm, len(found)), starts_of(self.comm, rows)
        if np.array_equal(theirs, ours):
            return found
        mine = np.arange(ours[self.comm.rank], ours[self.comm.rank + 1])
        return fetched(self.comm, theirs, mine, found)

    def _described(self) -> tuple[list[XdmfGrid], dict[str, dict[str, int]]]:
        """What the XML says; not collective."""
        tree = _tree(self.path)
        grids: list[XdmfGrid] = []
        geometry: XdmfArray | None = None
        for grid in tree.iter("Grid"):
            points, topology = grid.find("Geometry"), grid.find("Topology")
            if points is not None:
                geometry = self._array(points)
            if topology is None:
                continue
            kind = (topology.get("TopologyType") or topology.get("Type") or "").lower()
            numbers = {}
            for attribute in grid.findall("Attribute"):
                if attribute.get("Center") == "Cell" and (values := self._array(attribute)).whole:
                    numbers[attribute.get("Name") or "unnamed"] = values
            grids.append(XdmfGrid(kind, self._array(topology), geometry, numbers))
        return grids, self._names(tree)

    def _names(self, tree: ElementTree.Element) -> dict[str, dict[str, int]]:
        for entry in tree.iter("Information"):
            if entry.get("Name") == NAMES:
                try:
                    given = json.loads(entry.get("Value") or "")
                    return {of: {str(name): int(number) for name, number in given[of].items()} for of in given}
                except (ValueError, TypeError, AttributeError) as error:
                    raise ValueError(f"{self.path}: the Information {NAMES} is damaged: {error}") from None
        return {}

    def _array(self, parent: ElementTree.Element) -> XdmfArray:
        item = _item(self.path, parent)
        if _form(item) != "HDF":
            self._texts.append(array_of(self.path, parent))
            text = self._texts[-1]
            return XdmfArray(None, len(self._texts) - 1, text.shape, text.dtype.kind in "iu")
        file, inside = _place(self.path, item)
        with _opened(self.path, item) as data:
            return XdmfArray((file, inside), 0, data[inside].shape, data[inside].dtype.kind in "iu")


def array_of(path: str, parent: ElementTree.Element) -> npt.NDArray[Any]:
    """All numbers of an element's DataItem.

    Raises:
        ValueError: If they cannot be read.
    """
    item = _item(path, parent)
    if _form(item) == "HDF":
        with _opened(path, item) as file:
            return np.asarray(file[_place(path, item)[1]])
    if _form(item) == "XML":
        shape = [int(n) for n in (item.get("Dimensions") or "-1").split()]
        whole = (item.get("NumberType") or item.get("DataType") or "Float") in _WHOLE
        try:
            return np.array((item.text or "").split(), dtype=np.int64 if whole else np.float64).reshape(shape)
        except ValueError as error:
            raise ValueError(f"{path}: a {parent.tag} is damaged: {error}") from None
    raise ValueError(f"{path}: has data in the format {_form(item)}; write HDF or XML")


def _tree(path: str) -> ElementTree.Element:
    try:
        tree = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: is not XDMF, or cut short: {error}") from None
    if tree.tag != "Xdmf":
        raise ValueError(f"{path}: is not XDMF: it begins with <{tree.tag}>")
    return tree


def _item(path: str, parent: ElementTree.Element) -> ElementTree.Element:
    item = parent.find("DataItem")
    if item is None or item.text is None:
        raise ValueError(f"{path}: a {parent.tag} has no DataItem")
    return item


def _form(item: ElementTree.Element) -> str:
    return (item.get("Format") or "XML").upper()


def _place(path: str, item: ElementTree.Element) -> tuple[str, str]:
    text = (item.text or "").strip()
    name, found, inside = text.rpartition(":/")  # the name of a file may have a colon
    if not found:
        name, _, inside = text.partition(":")
    return str(Path(path).parent / name), f"/{inside}" if found else inside


def _opened(path: str, item: ElementTree.Element) -> h5py.File:
    """The HDF5 file of an item, in which its dataset is."""
    name, inside = _place(path, item)
    try:
        refuse_irregular(Path(name))
        file = h5py.File(name, "r")
        if not isinstance(file.get(inside), h5py.Dataset):
            file.close()
            raise KeyError(f"there is no dataset {inside!r}")
    except (OSError, KeyError, ValueError) as error:
        raise ValueError(f"{path}: the data {(item.text or '').strip()} cannot be read: {error}") from None
    return file
