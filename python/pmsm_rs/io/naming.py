"""What the name of a column says, word by word: quantity, axis, frame, what was done to it, and its unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

from ..quantities.canonical import CANONICAL
from ..quantities.units import canonical, dimension_of, is_unit
from ..quantities.vocabulary import (
    AIRGAP,
    AXES,
    BESIDE_TIME,
    BETWEEN,
    COMMANDED,
    DC,
    DC_SUPPLY,
    DC_WORDS,
    ESTIMATED,
    FILTERED,
    FRAMED,
    FRAMES,
    KNOWN,
    LETTERS,
    LOAD,
    MEASURED,
    NEUTRAL,
    NEUTRAL_FOR,
    OTHER,
    QUANTITIES,
    ROLES,
    SUPPLY,
    SYMBOLS,
    TIMES,
    TORQUE_FORMING,
    VECTORS,
)
from ..quantities.wording import (
    LONGEST,
    chunks,
    is_long_unit,
    name_and_slash,
    unit_and_words,
    words,
    words_of,
)

_BRACKETED: Final = re.compile(r"([^\[(]*)[\[(]([^\])]*)[\])]\s*$")
_BETWEEN_SEGMENTS: Final = re.compile(r"[./\\:|>]+(?=\S)")
_NUMBERED_PHASE: Final = re.compile(r"([iuv])_?(?:l|phase|ph)?_?[123]")
"""Phases by number, as `i1` and `U_L2`: of a motor, or of so many joints."""
_REMEMBERED: Final = 1 << 18
"""Names whose meaning is kept, more than one file may have: each is asked for several times in turn."""
_ROOTS: Final = {
    **{"volt": "voltage", "spannung": "voltage", "current": "current", "strom": "current"},
    **{"angle": "angle", "winkel": "angle", "theta": "angle", "speed": "speed", "drehzahl": "speed"},
    **{"omega": "speed", "velocity": "speed"},
}
"""What a name looks like that has one of these within it."""


@dataclass(frozen=True)
class Meaning:
    """What a name says.

    `columns` are the canonical ones that it may be. There is one where that is certain, several where
    electrical and mechanical are in doubt, none where no column can be made of it. `sure` is False where some
    of its words are not known. `unit` is the one that the name or the file states. `other` marks a quantity
    that is none of the motor's, such as a control error; `columns` say what the supply's voltage may be.
    `shaft_in_rpm` marks a speed that in rpm is always the shaft's.
    """

    quantity: str
    columns: tuple[str, ...]
    role: str | None = None
    unit: str | None = None
    sure: bool = True
    other: bool = False
    shaft_in_rpm: bool = False

    @property
    def needs_unit(self) -> bool:
        """Whether no unit may be assumed: nobody logs i_d in mA without saying so, but angles, speeds,
        torques and times come in every unit.
        """
        return self.unit is None and self.quantity not in {"voltage", "current"}


@lru_cache(maxsize=_REMEMBERED)
def meaning(name: str, stated: str | None = None) -> Meaning | None:
    """What the column `name`, of which the file states a unit or not, says of itself; None where nothing."""
    if len(name) > LONGEST:
        return None
    part = _BRACKETED.match(name)
    if part is not None and part[1].strip() and part[2].strip() and stated in {None, part[2].strip()}:
        # The brackets of `data[:,2]` choose a part of an array.
        name, stated = part[1].strip(), None if ":" in part[2] else part[2].strip()
    unit, beside = unit_and_words(stated)
    if unit is None:
        name, unit = name_and_slash(name)
    found = _of_segments(name, beside, unit is not None)
    if found is None:
        return _resembling(name, unit)
    unit = unit or found.unit
    if found.shaft_in_rpm and len(found.columns) > 1 and canonical(unit or "", "speed") in {"rpm", "krpm"}:
        found = replace(found, columns=("omega_m",))
    return replace(found, unit=unit)


def _of_segments(name: str, beside: tuple[str, ...], stated: bool) -> Meaning | None:
    """Of a path such as `axis0.motor.Iq.measured` the last part that has a quantity says it; a reference that
    is named before it makes it one. `stated` says that the file has the unit elsewhere.
    """
    # A point behind which a blank comes ends an abbreviation: `el. angle`.
    segments = [segment for segment in _BETWEEN_SEGMENTS.split(name) if segment.strip()]
    for start in range(len(segments) - 1, -1, -1):
        own = [chunk for segment in segments[start:] for chunk in chunks(segment)]
        unit = None
        if len(own) == 3 and (vector := VECTORS.get(own[0].lower())) is not None:
            # The unit of a vector stands before its component: `Idq_A.d`.
            unit = canonical(own[1], vector) if len(segments) - start == 2 else None
            own = [own[0], own[2]] if unit is not None else own
        found = _with_unit(own, beside, stated)
        if found is None:
            continue
        found = found if unit is None else replace(found, unit=unit)
        before = {ROLES.get(word) for segment in segments[:start] for word in words(segment)}
        if found.role is None and COMMANDED in before:
            found = replace(found, role=COMMANDED)
        return found
    return None


def _with_unit(own: Sequence[str], beside: tuple[str, ...], stated: bool) -> Meaning | None:
    """The meaning of the chunks of a name, of which the last ones may be its unit where none is `stated`."""
    whole = _interpret([*words_of(own), *beside])
    if whole is not None and whole.quantity == "speed" and not {"rpm", "erpm"}.isdisjoint(words_of(own)):
        return replace(whole, unit="rpm")
    if whole is not None and whole.sure and whole.columns and not is_long_unit(own[-1]):
        if not stated and _is_unit_or_phase(own, whole.quantity):
            return replace(whole, columns=(), sure=False)
        return whole
    for count in (1, 2, 3):
        if len(own) <= count:
            continue
        tail = [part for part in own[-count:] if part.lower() not in {"per", "p"}]
        texts = [text for text in ("/".join(tail), "".join(tail)) if text.lower() == "rms" or is_unit(text)]
        head = _interpret([*words_of(own[:-count]), *beside]) if texts else None
        if head is None or not head.sure:
            continue
        for text in texts:
            dimension = head.quantity
            effective = (
                {"current": "Arms", "voltage": "Vrms"}.get(dimension) if text.lower() == "rms" else None
            )
            unit = effective or canonical(text, dimension)
            if unit is not None:
                return replace(head, unit=unit)
    return whole


def _is_unit_or_phase(own: Sequence[str], quantity: str) -> bool:
    """Whether the last letter may be the unit as well as a phase, as in `Current_A` and `Voltage_V`."""
    phase = {"voltage": "V", "current": "A"}.get(quantity)
    by_word = any(QUANTITIES.get(chunk.lower()) == quantity for chunk in own) or phase == "V"
    return len(own) > 1 and own[-1] == phase and by_word and "phase" not in words_of(own)


def _interpret(given: Sequence[str]) -> Meaning | None:
    """The meaning of words; None where they hold no quantity."""
    own = list(given)
    if KNOWN.isdisjoint(own):
        return None
    time = _time(own)
    if time is not None:
        return time
    named = {QUANTITIES[word] for word in own if word in QUANTITIES}
    if "current" in named and named & {"speed", "angle"}:
        # The current speed is the one of this moment.
        own = ["act" if QUANTITIES.get(word) == "current" else word for word in own]
        named.discard("current")
    axis: list[str] = []
    if "current" in named and (forming := [TORQUE_FORMING[w] for w in own if w in TORQUE_FORMING]):
        axis += forming[:1]
        own = [word for word in own if word not in TORQUE_FORMING]
        named.discard("torque")
    if named == {"angle", "speed"}:
        named = {"speed"}
    if "zwischenkreisspannung" in own:
        return Meaning("voltage", ("v_dc",), _role(own)[0])
    symbols = [SYMBOLS[word] for word in own if word in SYMBOLS]
    if "id" in own and not all(word in KNOWN for word in own):
        # Behind a word of its own it is the number of something: `profile_id`.
        return None
    vectors = {VECTORS[word] for word in own if word in VECTORS}
    direct = {"voltage"} if any(word in DC for word in own) else set()
    quantities = named | {quantity for quantity, _ in symbols} | vectors | direct
    letter = None
    if not quantities:
        framed = next((FRAMED[word] for word in own if word in FRAMED and _is_symbol(word, own)), None)
        letter = next((k for k, word in enumerate(own[:-1]) if word in LETTERS and own[k + 1 :]), None)
        behind = [] if letter is None else own[letter + 1 :]
        if any(word in AXES or word in BETWEEN or word in DC_WORDS for word in behind):
            assert letter is not None
            quantities = {LETTERS[own[letter]]}
        elif framed is not None:
            quantities, letter = {framed[0]}, None
    if len(quantities) != 1:
        return None
    [quantity] = quantities
    return _detail(quantity, own, axis + [a for _, a in symbols], letter)


def _is_symbol(word: str, own: Sequence[str]) -> bool:
    """Whether a letter means a speed or an angle: not where it is one word of a sentence."""
    return all(w == word or w in FRAMES or w in ROLES or w in NEUTRAL or w == "r" or is_unit(w) for w in own)


def _detail(quantity: str, own: Sequence[str], axis: list[str], letter: int | None) -> Meaning:
    """Axis, frame, role and the columns of a quantity that the words `own` hold."""
    electric = quantity in {"voltage", "current"}
    frames: set[str] = set()
    unknown = other = foreign = dc = load = airgap = False
    for k, word in enumerate(own):
        if k == letter or word in SYMBOLS or word in VECTORS or QUANTITIES.get(word) is not None:
            continue
        if word in DC or (electric and word in DC_WORDS):
            dc = True
        elif word in OTHER or (electric and word in BETWEEN):
            other = True
            foreign = foreign or word not in DC_SUPPLY
        elif electric and word in AXES:
            axis.append(AXES[word])
        elif word in ROLES or word in NEUTRAL or word in NEUTRAL_FOR.get(quantity, ()):
            pass
        elif FRAMED.get(word, ("", ""))[0] == quantity:
            frames |= {FRAMED[word][1]} - {""}
        elif not electric and word in FRAMES:
            frames.add(FRAMES[word])
        elif quantity == "torque" and word in LOAD:
            load = True
        elif quantity == "torque" and word in AIRGAP:
            airgap = True
        else:
            unknown = True
    role, clear = _role(own)
    if quantity == "voltage" and FILTERED in {ROLES.get(word) for word in own}:
        # A commanded voltage acts; what a filter makes of it does not.
        role = FILTERED
    sure = clear and not unknown
    axes = tuple(dict.fromkeys(axis))
    if quantity == "voltage" and other and sure and not (foreign or axes or dc) and role != COMMANDED:
        return Meaning(quantity, ("v_dc",), role, sure=False, other=True)
    if electric:
        columns, sure, other = _electric(quantity, axes, dc, sure, other)
    elif quantity == "torque":
        columns = _torque(frames, load, airgap)
    else:
        if not frames and "drehzahl" in own:
            # German keeps this word for the turns of a shaft.
            frames.add("m")
        columns = _turning(quantity, frames)
        other = other or (quantity == "frequency" and not frames)
        quantity = "speed" if quantity == "frequency" else quantity
        sure = sure and len(frames) < 2
    shaft = quantity == "speed" and {"omega", "w", "wr"}.isdisjoint(own)
    return Meaning(quantity, () if other else columns, role, None, sure, other, shaft)


def _electric(
    quantity: str, axes: tuple[str, ...], dc: bool, sure: bool, other: bool
) -> tuple[tuple[str, ...], bool, bool]:
    """Columns of a voltage or current, whether they are sure, and whether it is another quantity."""
    letter = "v" if quantity == "voltage" else "i"
    if dc:
        # The current of the link is none of the motor, and a link has no axes.
        return (("v_dc",), sure, other) if letter == "v" and not axes else ((), sure, True)
    if len(axes) != 1:
        return (), False, other
    return (() if axes[0] in {"alpha", "beta"} else (f"{letter}_{axes[0]}",)), sure, other


def _torque(frames: set[str], load: bool, airgap: bool) -> tuple[str, ...]:
    """A torque is that of the load or of the motor only where its name says so."""
    if load != airgap:
        return ("tau_m",) if load else ("tau_e",)
    return {frozenset("e"): ("tau_e",), frozenset("m"): ("tau_m",)}.get(frozenset(frames), ("tau_m", "tau_e"))


def _turning(quantity: str, frames: set[str]) -> tuple[str, ...]:
    stem = "theta" if quantity == "angle" else "omega"
    return tuple(f"{stem}_{frame}" for frame in ("e", "m") if not frames or frame in frames)


def _role(own: Sequence[str]) -> tuple[str | None, bool]:
    """What was done to the signal, and whether the words agree on it."""
    roles = {ROLES[word] for word in own if word in ROLES}
    if {COMMANDED, MEASURED} <= roles or {COMMANDED, ESTIMATED} <= roles:
        return COMMANDED, False
    for role in (COMMANDED, ESTIMATED, FILTERED, MEASURED):
        if role in roles:
            return role, True
    return None, True


def _time(own: Sequence[str]) -> Meaning | None:
    """A time, with its unit where a name has one behind it (`time_us`)."""
    text = " ".join(word for word in own if word not in BESIDE_TIME)
    if text in TIMES:
        return Meaning("time", ("t",), unit=TIMES[text])
    head, _, tail = text.rpartition(" ")
    unit = canonical(tail, "time") if head in TIMES and TIMES[head] is None else None
    return None if unit is None else Meaning("time", ("t",), unit=unit)


def _resembling(name: str, unit: str | None) -> Meaning | None:
    """What a name that is not understood looks like, by a root within it or by its unit."""
    plain = name.lower()
    numbered = _NUMBERED_PHASE.fullmatch(plain.strip())
    if numbered is not None:
        return Meaning(LETTERS[numbered[1]], (), unit=unit, sure=False)
    root = next((quantity for root, quantity in _ROOTS.items() if root in plain), None)
    quantity = root or (dimension_of(unit) if unit is not None else None)
    if quantity not in {"voltage", "current", "angle", "speed"}:
        return None
    if any(word in SUPPLY or word in OTHER for word in words(name)):
        return None
    return Meaning(quantity, (), unit=unit, sure=False)


def candidates(found: Meaning) -> tuple[str, ...]:
    """The canonical columns that a column of this meaning could be, for the user to choose."""
    if found.columns:
        return found.columns
    groups = {
        "voltage": ("v_d", "v_q", "v_a", "v_b", "v_c", "v_dc"),
        "current": ("i_q", "i_d", "i_a", "i_b", "i_c"),
        "angle": ("theta_e", "theta_m"),
        "speed": ("omega_e", "omega_m"),
    }
    names = groups.get(found.quantity, ())
    assert all(name in CANONICAL for name in names)
    return names
