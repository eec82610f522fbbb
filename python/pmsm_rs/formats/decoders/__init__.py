"""What the decoding process runs, one module per family of formats; the user's process uses none of it.

Each module has a class `Table(file, max_bytes)` with `members`, a list of `Member`, and `read(wanted)`. It
gives for each `Wanted` the parts of its values as contiguous float64 arrays, and raises `Refused`. Whatever
else goes wrong is damage to the file.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Parts = list[list[NDArray[np.float64]]]
