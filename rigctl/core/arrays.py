"""Arrays of numbers by what they hold, in annotations."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
Int64Array = NDArray[np.int64]
Int8Array = NDArray[np.int8]
TextArray = NDArray[np.str_]
