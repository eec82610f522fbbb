"""Logs to inspect, and parts of what is found in them."""

from __future__ import annotations

from pathlib import Path

import pmsm_rs as pm
from conftest import Columns, csv_text
from pmsm_rs.io.signals import Signal


def written(columns: Columns, folder: Path, header: dict[str, str] | None = None) -> Path:
    (folder / "r.csv").write_text(csv_text(columns, header))
    return folder / "r.csv"


def signal(found: pm.Inspection, column: str) -> Signal:
    [entry] = [entry for entry in found.columns if entry.column == column]
    return entry


def opened(found: pm.Inspection, *names: str) -> str:
    """The machine file with the open lines of `names` taken."""
    lines = found.machine_file.splitlines()
    return "\n".join(line[1:] if line.startswith(tuple(f"#{n} =" for n in names)) else line for line in lines)
