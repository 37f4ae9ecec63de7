"""Names of array types. They stand apart from the compiler, which takes half a second to import:
the processes that read untrusted files go without it."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
CountArray = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]
