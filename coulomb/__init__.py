"""coulomb: 3D contact with Coulomb friction, solved by an interior-point method.

u = K^-1 (f - B^T x),   A = B K^-1 B^T,   b = B K^-1 f - c
min 1/2 x^T A x - b^T x   subject to   x_n >= 0,  |x_t| <= g,   with g = F x_n at the solution
"""

import os
import sys
from importlib import import_module

from . import fem as fem
from . import model as model
from . import solvers as solvers
from .installation import Unusable
from .lazy_names import late_bound, lazily_loaded

# Read when the library of OpenMP is loaded.  Threads that wait in busy loops, its default, make products of multigrid
# ten times as slow where other programs need the processors too.  With GNU's library they look a thousand times, for
# some microseconds, before they sleep: to be woken takes longer than many products do.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("GOMP_SPINCOUNT", "1000")


class _MpiFirst:
    """Loads MPI before DOLFINx and PETSc, in every import after that of coulomb: PyPI's wheel of DOLFINx requires it.

    Its package `dolfinx_solver` does it, and refuses a second petsc4py; elsewhere there is no such package.
    """

    def find_spec(self, name, path=None, target=None):
        if name in ("dolfinx", "petsc4py", "slepc4py"):
            sys.meta_path.remove(self)
            try:
                import_module("dolfinx_solver")
            except ModuleNotFoundError:
                pass
            except ImportError as error:
                raise Unusable(str(error)) from None
        return None  # the others find the module itself


sys.meta_path.insert(0, _MpiFirst())

__all__, __getattr__ = lazily_loaded(__name__, __file__)


def _later(module, name):
    """A function of a module that is loaded when it is first called."""
    return lambda *arguments: getattr(import_module(module, __name__), name)(*arguments)


late_bound.update(
    write=_later(".pictures.picture_of_run", "write_with_picture"),
    faces=_later(".io.result_grids", "face_answers"),
    fields_on_bodies=_later(".io.result_grids", "fields_on_bodies"),
    error=_later(".io.error_bars", "error_of"),
    refine=_later(".io.refinement", "refine"),
    plot=_later(".pictures.picture_of_run", "plot_solution"),
    picture=_later(".pictures.picture_of_run", "picture"),
    plot_history=_later(".pictures.picture_of_run", "plot_history"),
)


def __dir__():
    return sorted({*globals(), *__all__})
