"""Which column of a file becomes which canonical one: what [columns] says first, safe guesses for the rest.

Everything that is missing or unclear is collected, and refused at once.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from .._core import DataError
from ..config.rules import Rule, Rules
from ..errors import Problem, fact, refuse_all, shown
from ..quantities.canonical import CANONICAL, LOGS, TEMPERATURES, normal, spellings
from ..quantities.units import UNITS, canonical
from ..quantities.vocabulary import COMMANDED, ESTIMATED, FILTERED, MEASURED
from ..quantities.wording import unit_and_words
from .formats.sniff import name_and_unit
from .formats.source import Source
from .naming import Meaning, meaning
from .notes import SUPPLY_VOLTAGE, line_for, look_alike, never_taken, of_supply, quoted
from .reading import Account, Unused, missed
from .stated import unit_of

_LISTED: Final = 12
"""Names of a file that a refusal lists."""

_RANKS: Final[dict[str, dict[str | None, int]]] = {
    # A voltage that acts is the commanded one; which of several acted, their names do not tell.
    "voltage": {COMMANDED: 2, None: 2, MEASURED: 2, FILTERED: 1},
    "v_dc": {MEASURED: 3, None: 2, FILTERED: 1},
    # A current that the controller asks for is none that flows.
    "current": {MEASURED: 3, None: 2, FILTERED: 1},
    "angle": {MEASURED: 3, None: 2, FILTERED: 1, ESTIMATED: 1},
    "speed": {MEASURED: 3, None: 2, FILTERED: 1, ESTIMATED: 1},
    "torque": {MEASURED: 3, None: 2, FILTERED: 1},
    "time": {None: 2},
    "temperature": {None: 2},
}
"""Of several columns for one quantity the highest rank is taken, by what was done to the signal; a role that
is not here is never taken."""
_KEEP: Final = "keep the right line in [columns] of the machine file"
_EXACT: Final = 9
"""Rank of a column that has the canonical name to the letter, above all of `_RANKS`."""


CANONICAL_NAME, OWN_NAME, COLUMNS = "canonical name", "its name", "[columns]"
CLOCK, UNIT_ALONE, LOCKED = "date and time", "its unit", "[load]"
"""What a column was recognised by; a documented log is told by its own name."""


_MOTION: Final = frozenset({"theta_e", "theta_m", "omega_e", "omega_m", "n"})


@dataclass(frozen=True)
class Survey:
    """What a file or frame holds before it is known whether that will do.

    `plan` has the rule of every canonical column that can be had, in the order of `CANONICAL`, and `how` what
    it was recognised by. `problems` are all that is missing, in doubt or of the wrong unit.
    """

    plan: Mapping[str, Rule]
    account: Account
    problems: tuple[Problem, ...]
    how: Mapping[str, str]


@dataclass(frozen=True)
class _Claim:
    """A column that could become a canonical one, and what it was recognised by."""

    column: str
    name: str
    unit: str | None
    rank: int
    how: str = OWN_NAME


@dataclass
class _Draft:
    """A plan in the making: rules by canonical name, and what is to be said of the columns."""

    source: Source
    given: Rules
    plan: dict[str, Rule] = field(default_factory=dict)
    claims: dict[str, list[_Claim]] = field(default_factory=dict)
    doubts: dict[str, Meaning] = field(default_factory=dict)
    unused: dict[str, Unused] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    how: dict[str, str] = field(default_factory=dict)

    def claim(self, column: str, name: str, unit: str | None, rank: int, how: str = OWN_NAME) -> None:
        self.claims.setdefault(_slot(name), []).append(_Claim(column, name, unit, rank, how))


def planned(
    source: Source, rules: Rules, *, whole: bool, locked: bool = False
) -> tuple[dict[str, Rule], Account]:
    """The plan and the account of `surveyed`. Raises one DataError for all the problems that there are."""
    survey = surveyed(source, rules, whole=whole, locked=locked)
    if survey.problems:
        raise refuse_all(DataError, survey.problems, source.file)
    return dict(survey.plan), survey.account


def surveyed(source: Source, rules: Rules, *, whole: bool, locked: bool = False) -> Survey:
    """What can be had of the columns of `source`, and everything that is missing or unclear.

    With `whole` the columns must answer a question by themselves, as those of a file must; a batch of a
    stream need not. Of a `locked` rotor without any column of its motion the speed is zero.
    """
    draft = _Draft(source, rules)
    _given(draft)
    taken = {rule.source for rule in draft.plan.values()}
    taken |= {part for parts in source.clocks.values() for part in parts}
    _guess(draft, [name for name in dict.fromkeys(source.names) if name not in taken])
    _torque_of_shorted_terminals(draft, taken)
    _choose(draft)
    doubts = _settled(draft)
    moving = _MOTION & ({*draft.plan, *rules} | {name for found in doubts.values() for name in found.columns})
    if locked and not moving:
        draft.plan["omega_m"] = Rule(unit=CANONICAL["omega_m"].unit, value=0.0)
        draft.how["omega_m"] = LOCKED
    for column, found in doubts.items():
        _doubt(draft, column, found)
    told = rules.get("t") is not None or any(found.quantity == "time" for found in doubts.values())
    if "t" not in draft.plan and not told:
        draft.problems.append(_no_time(source))
    if whole and (draft.given or _has_header(source)):
        _ask(draft)
    plan = {name: draft.plan[name] for name in CANONICAL if name in draft.plan}
    how = {name: draft.how.get(name, COLUMNS) for name in plan}
    return Survey(plan, _account(draft, plan), tuple(draft.problems), how)


def _slot(name: str) -> str:
    """The column that a canonical name fills: n in rpm becomes omega_m."""
    return "omega_m" if name == "n" else name


def _given(draft: _Draft) -> None:
    """The rules that the user gave, with their columns and units found."""
    for name, rule in draft.given.items():
        if rule is None or rule.file is not None:
            continue
        if rule.source is None:
            draft.plan[name] = replace(rule, unit=rule.unit or CANONICAL[name].unit)
            continue
        try:
            found = replace(rule, source=draft.source.find(rule.source, name))
            draft.plan[name] = replace(found, unit=unit_of(name, found, draft.source))
        except DataError as error:
            draft.problems.append(_of(error))
            continue
        if found.source in draft.source.twice:
            draft.problems.append(_which(draft.source, found.source or ""))
    speeds = {name for name, rule in draft.given.items() if rule is not None} & {"n", "omega_m"}
    if len(speeds) > 1:
        draft.problems.append(
            Problem("both n and omega_m are there", "leave one of them out in [columns]", "n")
        )


def _of(error: DataError) -> Problem:
    """A refusal as one problem of several."""
    return Problem(str(fact(error, "problem")), str(fact(error, "fix")), str(fact(error, "column")))


def _which(source: Source, column: str) -> Problem:
    """That several columns have the name, in the words with which reading it is refused."""
    try:
        source.read([column])
    except DataError as error:
        return _of(error)
    raise AssertionError(f"'{column}' was read though several columns have that name")


def _guess(draft: _Draft, columns: Iterable[str]) -> None:
    """What the names of the columns say, each by itself."""
    source = draft.source
    plain = {way for name in source.names for way in spellings(name_and_unit(name)[0])}
    tool, log = next(((tool, table) for tool, (marks, table) in LOGS.items() if marks <= plain), ("", {}))
    units = {column: source.unit(column) for column in columns}
    meanings = {column: meaning(column, stated) for column, stated in units.items()}
    pair = "i_q" in draft.given or any(
        found is not None and found.sure and found.columns == ("i_q",) for found in meanings.values()
    )
    for column, found in meanings.items():
        stated, key = units[column], normal(column)
        unit, beside = unit_and_words(stated)
        ways = spellings(name_and_unit(column)[0]) if log else ()
        known = next((way for way in ways if way in log), None)
        if known is not None:
            name, documented = log[known]
            if documented is None and unit is None:
                draft.doubts[column] = Meaning(CANONICAL[name].dimension, (name,))
            else:
                draft.claim(column, name, unit or documented, _EXACT, f"{tool} log")
        elif column in source.clocks and column != "t":
            # Stamps of the time of day go behind a column that counts time.
            draft.claim(column, "t", "s", 1, CLOCK)
        elif column in CANONICAL and not beside:
            draft.claim(column, column, unit or CANONICAL[column].unit, _EXACT, CANONICAL_NAME)
        elif key == "column" and canonical(stated or "", "time") is not None:
            # A header that is a unit alone, as in `in s`.
            draft.claim(column, "t", stated, _EXACT, UNIT_ALONE)
        elif key in TEMPERATURES:
            _temperature(draft, column, TEMPERATURES[key], stated)
        elif found is not None:
            if log and (len(found.columns) != 1 or not found.sure):
                # The names of this log are documented: what its table leaves out is none of the motor's.
                continue
            if key == "id" and not pair:
                draft.unused[column] = Unused(column, "number", "it may be the number of something")
                continue
            _take(draft, column, found)


def _torque_of_shorted_terminals(draft: _Draft, taken: set[str | None]) -> None:
    """The only column in a unit of torque that moves, where the terminals are shorted: no drive estimates a
    torque there, and a load machine's sensor measures it.
    """
    source, given = draft.source, draft.given
    shorted = all(rule is not None and rule.value == 0.0 for rule in map(given.get, ("v_d", "v_q")))
    if not shorted or {"tau_m", "tau_e"} & {*given, *draft.claims}:
        return
    units = {column: source.unit(column) for column in dict.fromkeys(source.names) if column not in taken}
    torques = [column for column, unit in units.items() if canonical(unit or "", "torque") is not None]
    asked = [
        column for column in torques if (found := meaning(column, None)) is None or found.role != COMMANDED
    ]
    read = source.read(asked) if asked else {}
    moving = [column for column in asked if read[column].min() < read[column].max()]
    if len(moving) == 1:
        [column] = moving
        draft.unused.pop(column, None)
        draft.claim(column, "tau_m", units[column], 1, UNIT_ALONE)


def _temperature(draft: _Draft, column: str, name: str, stated: str | None) -> None:
    if stated is None:
        draft.doubts[column] = Meaning("temperature", (name,))
    else:
        draft.claim(column, name, stated, 2)


def _take(draft: _Draft, column: str, found: Meaning) -> None:
    """A claim, a doubt, or a note on a column whose name says `found`."""
    ranks = _RANKS["v_dc" if found.columns == ("v_dc",) else found.quantity]
    if found.other:
        if found.columns:
            draft.unused[column] = of_supply(draft.source, column, found)
        return
    dimension = found.quantity
    unassumed = dimension in {"angle", "speed", "torque", "time"}
    if unassumed and found.unit is not None and canonical(found.unit, dimension) is None:
        if found.sure and dimension == "torque" and found.role in ranks:
            draft.unused[column] = look_alike(draft.source, column, replace(found, sure=False))
        # Names of these are names of much else, which the unit tells: a position in mm is no angle.
        found = replace(found, sure=False, columns=())
    if dimension in {"torque", "time"} and not found.sure:
        return
    if not found.sure or not found.columns:
        draft.unused[column] = look_alike(draft.source, column, found)
    elif found.role not in ranks:
        draft.unused[column] = never_taken(draft.source, column, found)
    elif found.quantity == "torque" and len(found.columns) > 1:
        why = "it may be the torque of the load or of the motor"
        use = line_for(draft.source, column, found, found.columns[0])
        draft.unused[column] = Unused(column, "torque", why, use, found.columns)
    elif len(found.columns) > 1 and len(normal(column)) == 1:
        # A single letter names all sorts of things: no file is refused for it.
        why = f"a single letter does not say that it is a {found.quantity}"
        use = line_for(draft.source, column, found, found.columns[0])
        draft.unused[column] = Unused(column, found.quantity, why, use, found.columns)
    elif len(found.columns) > 1 or found.needs_unit:
        draft.doubts[column] = found
    else:
        [name] = found.columns
        draft.claim(column, name, found.unit or CANONICAL[name].unit, ranks[found.role])


def _choose(draft: _Draft) -> None:
    """The best claim on each column; a problem where two are equally good or a name stands twice."""
    for slot, claims in draft.claims.items():
        if any(_slot(name) == slot for name in draft.given):
            continue
        best = max(claim.rank for claim in claims)
        first = [claim for claim in claims if claim.rank == best]
        if len(first) > 1:
            draft.problems.append(_rivals(draft.source, first, slot))
            continue
        [claim] = first
        if claim.column in draft.source.twice:
            draft.problems.append(_which(draft.source, claim.column))
            continue
        rule = Rule(claim.column, claim.unit)
        try:
            draft.plan[claim.name] = replace(rule, unit=unit_of(claim.name, rule, draft.source))
            draft.how[claim.name] = claim.how
        except DataError as error:
            draft.problems.append(_of(error))
        for other in claims:
            if other is not claim:
                why = f"{claim.column} was taken for {claim.name}"
                kind = "DC-link voltage" if slot == "v_dc" else CANONICAL[slot].dimension
                draft.unused[other.column] = Unused(other.column, kind, why)


def _rivals(source: Source, claims: list[_Claim], slot: str) -> Problem:
    names = [f"'{shown(claim.column)}'" for claim in claims[:_LISTED]]
    if len(claims) > _LISTED:
        names.append(f"{len(claims) - _LISTED} more")
    both = (
        f"both {names[0]} and {names[1]}" if len(names) == 2 else f"{', '.join(names[:-1])} and {names[-1]}"
    )
    lines = [
        f'{claim.name} = {{ from = {quoted(source.header(claim.column))}, unit = "{claim.unit}" }}'
        for claim in claims[:_LISTED]
    ]
    return Problem(
        f"{both} could be {slot}",
        f"say which in [columns]: {' or '.join(lines)}",
        claims[0].column,
        tuple(lines),
        _KEEP,
    )


def _settled(draft: _Draft) -> dict[str, Meaning]:
    """The doubts that nothing else settles: of several for one quantity those of the highest rank."""
    open_ones = {}
    for column, found in draft.doubts.items():
        dimension = CANONICAL[found.columns[0]].dimension
        supplied = (
            any(CANONICAL[name].dimension == dimension for name in draft.plan)
            if dimension in {"angle", "speed"}
            else found.columns[0] in draft.plan
        )
        if supplied or any(_slot(name) in found.columns for name in draft.given):
            why = "another column was taken in its place"
            draft.unused[column] = Unused(column, found.quantity, why)
        else:
            open_ones[column] = found
    best: dict[str, int] = {}
    for found in open_ones.values():
        rank = _RANKS[found.quantity][found.role]
        best[found.quantity] = max(rank, best.get(found.quantity, 0))
    return {c: m for c, m in open_ones.items() if _RANKS[m.quantity][m.role] == best[m.quantity]}


def _doubt(draft: _Draft, column: str, found: Meaning) -> None:
    """A problem, or a note where the user's [columns] leave the column out."""
    dimension = CANONICAL[found.columns[0]].dimension
    units = " or ".join(f'"{unit}"' for unit in list(UNITS[dimension])[:3])
    name = quoted(draft.source.header(column))
    if len(found.columns) > 1:
        problem = "it may be electrical or mechanical"
        given = f'"{found.unit}"' if found.unit else units
        ways = [f"{entry} = {{ from = {name}, unit = {given} }}" for entry in found.columns]
        fix = f"say which in [columns]: {' or '.join(ways)}"
        unit = found.unit or next(iter(UNITS[dimension]))
        lines = [f'{entry} = {{ from = {name}, unit = "{unit}" }}' for entry in found.columns]
        brief = _KEEP if found.unit else f"{_KEEP}, with its unit, which may be {units}"
    else:
        problem = f"its unit is not stated, so it cannot be taken as {found.columns[0]}"
        fix = f"say it in [columns]: {found.columns[0]} = {{ from = {name}, unit = {units} }}"
        lines = [
            f'{found.columns[0]} = {{ from = {name}, unit = "{unit}" }}' for unit in [*UNITS[dimension]][:3]
        ]
        brief = _KEEP
    if draft.given and found.quantity != "time":
        use = line_for(draft.source, column, found, found.columns[0])
        draft.unused[column] = Unused(column, found.quantity, problem, use)
    else:
        draft.problems.append(Problem(problem, fix, column, tuple(lines), brief))


def _has_header(source: Source) -> bool:
    """Whether the columns have names, and not only numbers."""
    return not source.names or any(re.fullmatch(r"column \d+", name) is None for name in source.names)


def _no_time(source: Source) -> Problem:
    if not _has_header(source):
        fix = 'give each column by its number in [columns], as in t = { from = "column 1", unit = "s" }'
        return Problem(
            "there is no header line with column names",
            f"put one above the numbers, or {fix}; it has {len(source.names)} columns",
            "t",
            brief=fix,
        )
    fix = 'add t = { from = "...", unit = "s" } or t = { period = ... } (in s) to [columns]'
    return Problem(
        "there is no time column",
        f"{fix}; the file has {listed_names(source.names)}",
        "t",
        brief=fix,
    )


def _ask(draft: _Draft) -> None:
    """Problems where the columns answer neither the electrical nor the mechanical question."""
    have = {*draft.plan, *(name for name, rule in draft.given.items() if rule is not None)}
    doubtful = {found.quantity for column, found in draft.doubts.items() if column not in draft.unused}
    refused = {problem.column for problem in draft.problems}
    claimed = {claim.name for claims in draft.claims.values() for claim in claims if claim.column in refused}
    have |= claimed
    lacks = "is missing, so that neither the electrical nor the mechanical equation can be tested"
    # Phase voltages can tell the motion by themselves, as in captures of an oscilloscope.
    phases = have & {"v_a", "v_b", "v_c"}
    motion = have & {"omega_e", "omega_m", "n", "theta_e", "theta_m"} or phases
    if not motion and not doubtful & {"angle", "speed"}:
        wanted = (
            "omega_e (or omega_m, theta_e, theta_m), or v_a, v_b, i_a, i_b alone, which tell the angle of a "
            "turning motor"
        )
        fix = _how(draft, ("speed", "angle"), wanted)
        draft.problems.append(Problem(lacks, fix, "omega_e", brief=f"give {wanted}"))
    currents = {"i_d", "i_q"} <= have or len({"i_a", "i_b", "i_c"} & have) > 1
    alone = phases if not have & {"omega_e", "omega_m", "n", "theta_e", "theta_m"} else len(phases) == 3
    if not currents and not have & {"tau_e", "tau_m"} and not alone:
        wanted = "the currents i_d, i_q or i_a, i_b, i_c with theta_e, or the motor torque tau_e"
        axes = {"i_d": "i_q", "i_q": "i_d"}
        lone = next((axis for axis in axes if axis in have), None)
        lost = axes[lone] if lone is not None else "i_q"
        zero = f'{lost} = {{ value = 0.0, unit = "A" }}'
        if lone is not None:
            wanted = f"{lost} (or {zero} if it was held at zero)"
        lines = () if lone is None else (zero,)
        how = _how(draft, ("current", "torque"), wanted)
        draft.problems.append(Problem(lacks, how, lost, lines, f"give {wanted}"))


def _how(draft: _Draft, quantities: tuple[str, ...], wanted: str) -> str:
    """The lines of [columns] that would give a quantity, else the names to choose from."""
    lines = [u for u in draft.unused.values() if u.quantity in quantities and u.use is not None]
    if lines:
        told = [f"'{u.column}' was not taken, since {u.why}: {_of_motor(u)} would take it" for u in lines[:4]]
        return f"give {wanted}, or settle it in [columns]: {'; '.join(told)}"
    names = listed_names(draft.source.names)
    if any(names in problem.fix for problem in draft.problems):
        return f"give {wanted} (map them in [columns])"
    return f"give {wanted} (the file has {names}; map them in [columns])"


def _of_motor(entry: Unused) -> str | None:
    """The line that would use a column; where currents are missing, a torque is wanted as the motor's."""
    own = entry.use is not None and "tau_e" in entry.could_be
    return f"tau_e{entry.use.removeprefix('tau_m')}" if own and entry.use is not None else entry.use


def _account(draft: _Draft, plan: dict[str, Rule]) -> Account:
    source = draft.source
    used = {rule.source for rule in plan.values()}
    used |= {part for column in used & {*source.clocks} for part in source.clocks[column or ""]}
    told = {
        name: rule if rule.source is None else replace(rule, source=source.header(rule.source))
        for name, rule in plan.items()
    }
    beside = {name: rule for name, rule in draft.given.items() if rule is not None and rule.file is not None}
    for name, rule in beside.items():
        told[name] = replace(rule, unit=rule.unit or CANONICAL[name].unit)
    arrays = {name.partition("[")[0].removesuffix(".real").removesuffix(".imag") for name in used if name}
    ignored = [name for name in dict.fromkeys(source.names) if name not in used and name not in arrays]
    # Of an array with a column that is used, and of a supply beside a DC link, there is nothing to say.
    unused = [
        replace(u, column=source.header(u.column))
        for u in draft.unused.values()
        if u.column not in used | arrays and not ("v_dc" in told and u.quantity == SUPPLY_VOLTAGE)
    ]
    return Account(
        {name: told[name] for name in CANONICAL if name in told},
        tuple(source.header(name) for name in ignored),
        tuple(unused),
        missed({*told}, draft.given, unused),
        "recording" if source.file is None else "file",
    )


def listed_names(names: tuple[str, ...]) -> str:
    """The first names of a file, in quotes."""
    told = ", ".join(f"'{shown(name)}'" for name in names[:_LISTED])
    return told + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")
