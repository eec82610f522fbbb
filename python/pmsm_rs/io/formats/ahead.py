"""A file that is opened while something else is done: its decoder takes a while to start."""

from __future__ import annotations

import os
import threading

from . import Source, open_source


class Opening(threading.Thread):
    """Opens `file` as `open_source` does; what is still under way when the program ends goes with it."""

    def __init__(self, file: str | os.PathLike[str], max_bytes: int) -> None:
        super().__init__(daemon=True)
        self.file, self._max_bytes = os.fspath(file), max_bytes
        self._source: Source | None = None
        self._error: BaseException | None = None
        self.start()

    def run(self) -> None:
        """Keeps what opening the file gives."""
        try:
            self._source = open_source(self.file, self._max_bytes)
        except BaseException as error:
            self._error = error

    def source(self, dbc: str | None = None) -> Source:
        """The opened file, once it is, with the description `dbc` of a CAN bus where it takes one. Raises
        UsageError and DataError as `open_source`.
        """
        self.join()
        if dbc is not None:
            return open_source(self.file, self._max_bytes, dbc)
        if self._error is not None:
            raise self._error
        assert self._source is not None
        return self._source
