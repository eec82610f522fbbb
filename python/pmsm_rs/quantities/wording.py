"""A name taken apart: chunks between blanks and of camel case, words written together, a unit at the end."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from .units import is_unit
from .vocabulary import AXES, FRAMES, KNOWN, NEUTRAL, NUMBERED, ROLES, TYPES

LONGEST: Final = 200
"""Characters of a name that are read; a longer one is none that a tool gives a column."""
_LONGEST_WORD: Final = 40
"""Letters of words written together that are taken apart; German makes long ones, but none longer."""
_GREEK: Final = str.maketrans(
    {
        **{"ω": "omega", "Ω": "omega", "θ": "theta", "ϑ": "theta", "φ": "phi", "ϕ": "phi", "τ": "tau"},
        **{"ψ": "psi", "α": "alpha", "β": "beta", "ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"},
        # A star marks a reference, a hat an estimate.
        **{"*": " ref ", "\u0302": " hat ", "^": " ", "'": " "},
    }
)
_CAMEL: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")
_BETWEEN_CHUNKS: Final = re.compile(r"[^A-Za-z0-9°µμ/%·]+")
_STEM: Final = 4
"""Letters from which a word is told inside of another, as `winkel` in `rotorwinkel`."""


def unit_and_words(stated: str | None) -> tuple[str | None, tuple[str, ...]]:
    """The unit in what a file states behind a name, and the words beside it, as in `[rad/s, electrical]`."""
    if stated is None or is_unit(stated):
        return stated, ()
    parts = re.split(r"[\s,;]+", stated[:LONGEST].strip())
    beside = tuple(word for part in parts for word in words(part) if _aside(part))
    rest = " ".join(part for part in parts if not _aside(part))
    if re.fullmatch(r"e[- ]?rpm", rest, re.IGNORECASE):
        return "rpm", (*beside, "e")
    if rest.isdigit():
        # The number of an element, as in `i[0]`.
        return None, (*beside, rest)
    return rest or None, beside


def _aside(part: str) -> bool:
    plain = part.lower().strip(".")
    if plain in AXES:
        return not is_unit(part)
    return len(plain) > 1 and (plain in FRAMES or plain in ROLES or plain in NEUTRAL)


def name_and_slash(name: str) -> tuple[str, str | None]:
    """Name and unit of `U_d / V` and of `speed rad/s`."""
    head, slash, tail = name.rpartition(" / ")
    if slash and is_unit(tail):
        return head, tail.strip()
    head, _, tail = name.rpartition(" ")
    return (head.removesuffix(" in"), tail) if head and "/" in tail and is_unit(tail) else (name, None)


@lru_cache(maxsize=4096)
def chunks(segment: str) -> tuple[str, ...]:
    """The parts of a name between blanks, underscores and the like, and of camel case."""
    text = segment.translate(_GREEK)
    out: list[str] = []
    for chunk in _BETWEEN_CHUNKS.split(text):
        if not chunk:
            continue
        pieces = _CAMEL.findall(chunk)
        whole = chunk.lower()
        if is_long_unit(chunk) or whole in KNOWN or not pieces:
            out.append(chunk)
        elif all(piece.lower() in KNOWN or piece.isdigit() or is_long_unit(piece) for piece in pieces):
            out += pieces
        else:
            out += (split(whole) if len(whole) <= _LONGEST_WORD else None) or pieces
    return tuple(out)


@lru_cache(maxsize=4096)
def split(text: str) -> list[str] | None:
    """`text` as words written together (`iqref`, `istdrehzahl`), the fewest there are, or None."""
    if not text.isalpha():
        # No word has anything but letters.
        return None
    best: list[list[str] | None] = [[]]
    for end in range(1, len(text) + 1):
        found = None
        for start in range(max(0, end - 24), end):
            head, word = best[start], text[start:end]
            if head is None or not _joins(word, head, end == len(text)):
                continue
            if found is None or len(head) + 1 < len(found):
                found = [*head, word]
        best.append(found)
    return best[-1]


def _joins(word: str, head: list[str], last: bool) -> bool:
    """Whether `word` may be written together with what stands before it; a single letter only behind a long
    word, as in `thetae`.
    """
    if len(word) == 1:
        return last and bool(head) and len(head[-1]) >= _STEM and (word in FRAMES or word in AXES)
    return word in KNOWN


def words(segment: str) -> list[str]:
    """The words of a part of a name, in lower case."""
    return words_of(chunks(segment))


def words_of(own: Sequence[str]) -> list[str]:
    """Chunks in lower case without the numbers of devices (`axis0`) and of parameters (`r0078`)."""
    out: list[str] = []
    for chunk in own[1:] if len(own) > 1 and own[0] in TYPES else own:
        word = chunk.lower()
        if word.isdigit() and out and out[-1] in NUMBERED:
            if out[-1] == "m":
                out.pop()
        elif word.isdigit() and len(word) > 2 and out and out[-1] in {"r", "p"}:
            out.pop()
        else:
            out.append(word)
    return out


def is_long_unit(chunk: str) -> bool:
    """Whether a chunk is a unit of more than one letter, which no camel case parts."""
    return len(chunk) > 1 and is_unit(chunk)
