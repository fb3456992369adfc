"""The array type of all packages."""

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating[Any]]
"""Double precision; written so that numpy 1 and 2 infer it alike."""
