"""Just enough of the Thrift compact protocol to read a Parquet footer without allocating what it declares.

Source: Apache Thrift, "Thrift Compact protocol encoding"; Apache Parquet format, `parquet.thrift`.
"""

from __future__ import annotations

from typing import Final

_MAX_DEPTH: Final = 16
_TRUE, _FALSE, _BYTE, _I16, _I32, _I64, _DOUBLE, _BINARY, _LIST, _SET, _MAP, _STRUCT = range(1, 13)


class Malformed(ValueError):
    """The bytes are no Thrift structure."""


class Compact:
    """A cursor over the bytes of one structure."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

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

    def struct(self, depth: int = 0) -> dict[int, object]:
        """The fields of a structure by number."""
        if depth > _MAX_DEPTH:
            raise Malformed("the footer is nested too deeply")
        fields: dict[int, object] = {}
        number = 0
        while (head := self._byte()) != 0:
            delta, kind = head >> 4, head & 0x0F
            number = number + delta if delta else self._zigzag()
            fields[number] = kind == _TRUE if kind in (_TRUE, _FALSE) else self._value(kind, depth)
        return fields

    def _value(self, kind: int, depth: int) -> object:
        if kind in (_TRUE, _FALSE, _BYTE):
            return self._byte()
        if kind in (_I16, _I32, _I64):
            return self._zigzag()
        if kind == _DOUBLE:
            return self._take(8)
        if kind == _BINARY:
            return self._take(self._varint())
        if kind in (_LIST, _SET):
            head = self._byte()
            size, element = head >> 4, head & 0x0F
            return self._items(size if size < 15 else self._varint(), element, depth)
        if kind == _MAP:
            size = self._varint()
            kinds = self._byte() if size else 0
            self._bound(size)
            return [
                (self._value(kinds >> 4, depth + 1), self._value(kinds & 0x0F, depth + 1))
                for _ in range(size)
            ]
        if kind == _STRUCT:
            return self.struct(depth + 1)
        raise Malformed(f"the footer has a field of unknown kind {kind}")

    def _items(self, size: int, element: int, depth: int) -> list[object]:
        self._bound(size)
        return [self._value(element, depth + 1) for _ in range(size)]

    def _bound(self, size: int) -> None:
        # Each item takes at least one byte, so a longer list is a lie.
        if size > len(self.data) - self.at:
            raise Malformed("a list in the footer is longer than the footer")

    def _take(self, size: int) -> bytes:
        self._bound(size)
        self.at += size
        return self.data[self.at - size : self.at]
