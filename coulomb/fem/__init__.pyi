"""The names of the package, with the modules that have them: for type checkers, and read by `lazy_names`."""

from .contact import ContactSurface as ContactSurface
from .contact import FoundPair as FoundPair
from .contact import FoundPairs as FoundPairs
from .meshes import JoinedMesh as JoinedMesh
