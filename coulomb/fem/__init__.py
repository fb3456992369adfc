"""Finite elements: meshes, bodies, contact surfaces, in rooms of these names.  Uses DOLFINx, but no solver."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..lazy_names import lazy_names

if TYPE_CHECKING:
    from .contact import ContactSurface
    from .meshes import JoinedMesh

__all__ = [
    "ContactSurface",
    "JoinedMesh",
]

if not TYPE_CHECKING:  # type checkers would accept every name
    __getattr__ = lazy_names(
        __name__,
        {
            "contact": ("ContactSurface",),
            "meshes": ("JoinedMesh",),
        },
    )
