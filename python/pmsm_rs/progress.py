"""How long calls tell how far they are."""

from __future__ import annotations

from collections.abc import Callable

# Is called with the stage in words and the share that is done, 0 to 1.
Progress = Callable[[str, float], None]
