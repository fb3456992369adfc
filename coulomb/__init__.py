"""coulomb: 3D contact with Coulomb friction, solved by path following."""

__version__ = "0.1.0.dev0"
