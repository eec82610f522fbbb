"""Completes the answer of the core: the files, what was read of them, mistakes of the log, and codes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from ._core import Machine, Recording
from .config.rules import Rule
from .io.conventions import scaled
from .io.corrections import corrected, of_load
from .io.reading import Account, told, warnings
from .messages import coded, of_finding
from .results.provenance import dated
from .results.words import lower_first

_SPACING: Final = "PR254"
"""Code of the findings that tell how far apart the rows lie."""


def completed(
    data: dict[str, Any],
    recordings: Sequence[Recording],
    validation: Recording | None = None,
    machine: Machine | None = None,
) -> dict[str, Any]:
    """The core's answer with what only this side knows: the files, what was read of them, and what that says
    beside the nameplate.
    """
    for entry, recording in zip(data.get("recordings", ()), recordings, strict=False):
        entry["file"] = file_of(recording)
    floors = [entry["noise_floor"] for entry in data.get("recordings", ())]
    floors = floors or [data.get("noise_floor", {})] * len(recordings)
    each = zip(recordings, floors, strict=True)
    spaced = any(of_finding(finding["finding"]) == _SPACING for finding in data["data_quality"])
    reads = [_read(recording, machine, steady="v_q" in own, spaced=spaced) for recording, own in each]
    complete = with_read(data, reads)
    # Lines that undo a mistake are those of the first recording; only where all were read alike do they help.
    accounts = [_account(recording).columns for recording in recordings]
    if all(columns == accounts[0] for columns in accounts):
        load = _mean_load(recordings)
        complete["data_quality"] = [
            of_load(corrected(each, accounts[0]), load, accounts[0]) for each in complete["data_quality"]
        ]
        complete["data_quality"] += _of_convention(data, machine, accounts[0])
    if validation is not None:
        other = _read(validation, machine, spaced=spaced)
        complete["validation"] = other
        told_already = [finding for read in reads for finding in warnings(read)]
        own = [finding for finding in warnings(other) if finding not in told_already]
        complete["data_quality"] += [_of("Validation run", finding) for finding in own]
    complete["data_quality"] = coded(complete["data_quality"])
    return complete


def _mean_load(recordings: Sequence[Recording]) -> float:
    """The mean of the logged load torque, N·m; zero where none was logged."""
    logged = [
        each.column("tau_m") for each in recordings if "tau_m" in each.names and each.load == "measured"
    ]
    return float(np.mean(np.concatenate(logged))) if logged else 0.0


def _of_convention(
    data: Mapping[str, Any], machine: Machine | None, columns: Mapping[str, Rule]
) -> list[dict[str, str]]:
    """The finding on a scale of another convention, where the values of the answer show one."""
    if machine is None:
        return []
    values = data.get("model", {}).get("base", {})
    base = {name: entry["value"] for name, entry in values.items() if entry["value"] is not None}
    plate = {name: value for name in base if (value := getattr(machine, name, None)) is not None}
    found = scaled(base, plate, columns, machine.v_dc)
    return [] if found is None else [found]


def _account(recording: Recording) -> Account:
    return getattr(recording, "account", None) or Account.of_arrays(recording.names)


def _read(
    recording: Recording, machine: Machine | None, *, steady: bool = True, spaced: bool = False
) -> dict[str, Any]:
    account_of = told(
        _account(recording),
        recording.column("t"),
        recording.kind,
        recording.load,
        steady=steady,
        machine=machine,
        spacing_told=spaced,
    )
    return dated(file_of(recording)) | account_of


def with_read(data: dict[str, Any], reads: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The answer with `read`, and with a finding for each column that was not used though it may be needed.

    `read` is an object for one recording and a list of them for several.
    """
    each = [warnings(read) for read in reads]
    findings = [
        finding if all(finding in other for other in each) else _of(f"Recording {count}", finding)
        for count, own in enumerate(each, 1)
        for finding in own
    ]
    once = [finding for k, finding in enumerate(findings) if finding not in findings[:k]]
    head = {"schema": data["schema"], "verdict": data["verdict"]}
    head["read"] = reads[0] if len(reads) == 1 else list(reads)
    head["data_quality"] = [*once, *data["data_quality"]]
    return head | {name: value for name, value in data.items() if name not in head}


def _of(run: str, finding: Mapping[str, str]) -> dict[str, str]:
    return {**finding, "finding": f"{run}: {lower_first(finding['finding'])}"}


def file_of(recording: Recording) -> str | None:
    file = getattr(recording, "file", None)
    return file if isinstance(file, str) else None
