"""Contact problems of elastic bodies: from bodies and contacts to the solution with its certificate, load steps and
histories.  Here are the types of results; what a user makes is at the top of the package.
"""

from ..lazy_names import lazily_loaded

__all__, __getattr__ = lazily_loaded(__name__, __file__)
