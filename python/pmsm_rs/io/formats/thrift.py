"""Just enough of the Thrift compact protocol to walk a Parquet footer without keeping what is not needed.

Source: Apache Thrift, "Thrift Compact protocol encoding"; Apache Parquet format, `parquet.thrift`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

# Real footers nest seven levels.
_MAX_DEPTH: Final = 16
_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET, _MAP, _STRUCT = range(1, 13)


class Malformed(ValueError):
    """The bytes are no Thrift structure."""


class Compact:
    """A cursor over the bytes of one structure. Its methods raise Malformed."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def fields(self) -> Iterator[tuple[int, int]]:
        """Number and type of each field; the caller takes or skips its value before it asks for the next."""
        number = 0
        while (head := self._byte()) != 0:
            delta = head >> 4
            number = number + delta if delta else self._zigzag()
            yield number, head & 0x0F

    def integer(self, kind: int) -> int:
        """The value of a field that must be a whole number."""
        if kind not in (_I16, _I32, _I64):
            raise Malformed("the footer has something else where a whole number should be")
        return self._zigzag()

    def structures(self, kind: int) -> int:
        """How many structures follow in a field that must be a list of them."""
        if kind != _LIST:
            raise Malformed("the footer has something else where a list should be")
        size, element = self._list()
        if element != _STRUCT and size:
            raise Malformed("the footer has a list of something else where structures should be")
        return size

    def structure(self, kind: int) -> None:
        """Checks that a field is a structure, whose fields follow."""
        if kind != _STRUCT:
            raise Malformed("the footer has something else where a structure should be")

    def skip(self, kind: int, depth: int = 0) -> None:
        """Passes over the value of a field of type `kind`."""
        if depth > _MAX_DEPTH:
            raise Malformed("the footer is nested too deeply")
        if kind in (_TRUE, _FALSE):
            return
        if kind == _BYTE:
            self._pass(1)
        elif kind in (_I16, _I32, _I64):
            self._varint()
        elif kind == _DOUBLE:
            self._pass(8)
        elif kind == _BINARY:
            self._pass(self._varint())
        elif kind in (_LIST, _SET):
            self._skip_items(*self._list(), depth)
        elif kind == _MAP:
            size = self._bounded(self._varint())
            kinds = self._byte() if size else 0
            for _ in range(size):
                self._element(kinds >> 4, depth)
                self._element(kinds & 0x0F, depth)
        elif kind == _STRUCT:
            while head := self._byte():
                if not head >> 4:
                    self._varint()
                self.skip(head & 0x0F, depth + 1)
        else:
            raise Malformed(f"the footer has a field of unknown kind {kind}")

    def _skip_items(self, size: int, element: int, depth: int) -> None:
        if element in (_TRUE, _FALSE, _BYTE):
            self._pass(size)
        elif element == _DOUBLE:
            self._pass(8 * size)
        else:
            for _ in range(size):
                # A structure without fields is its end mark alone; a footer can hold millions of them.
                if element == _STRUCT and self.data[self.at : self.at + 1] == b"\0":
                    self.at += 1
                else:
                    self.skip(element, depth + 1)

    def _element(self, kind: int, depth: int) -> None:
        # Within lists and maps a truth value takes a byte of its own.
        if kind in (_TRUE, _FALSE):
            self._pass(1)
        else:
            self.skip(kind, depth + 1)

    def _list(self) -> tuple[int, int]:
        head = self._byte()
        size = head >> 4
        return self._bounded(size if size < 15 else self._varint()), head & 0x0F

    def _byte(self) -> int:
        if self.at >= len(self.data):
            raise Malformed("the footer ends early")
        self.at += 1
        return self.data[self.at - 1]

    def _varint(self) -> int:
        value = 0
        for shift in range(0, 70, 7):
            byte = self._byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise Malformed("a number in the footer is too long")

    def _zigzag(self) -> int:
        raw = self._varint()
        return (raw >> 1) ^ -(raw & 1)

    def _bounded(self, size: int) -> int:
        # Each item takes at least one byte, so a longer list is not true.
        if size > len(self.data) - self.at:
            raise Malformed("a list in the footer is longer than the footer")
        return size

    def _pass(self, size: int) -> None:
        self.at += self._bounded(size)
