"""What the decoding process runs, one module per family of formats; the user's process uses none of it.

Each module of a format has a class `Table(file, max_bytes)`, which may be given more by name. It has
`members`, a list of `Member`, and `read(wanted)`. That gives for each `Wanted` the parts of its values as
contiguous float64 arrays, and raises `Refused`. Whatever else goes wrong is damage to the file.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

NO_TIME: Final = "no channel with a time base is wanted"
NO_TIME_FIX: Final = "map at least one channel"
"""What is said of the common sample times where nothing else is wanted."""

Parts = list[list[NDArray[np.float64]]]
