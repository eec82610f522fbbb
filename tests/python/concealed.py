"""Cases of the independent plant in proof/, as a user meets them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pmsm_rs as pm
from conftest import ROOT
from pmsm_rs import Diagnosis
from pmsm_rs.config.machine_file import read_machine

sys.path.insert(0, str(ROOT))


def diagnose(opened: Path, *, judged: bool = True) -> Diagnosis:
    """The diagnosis of a case's open folder, held against its validation run unless `judged` is false."""
    machine = read_machine(opened / "machine.toml")
    names = ("recording", "validation")
    first, other = (pm.load(opened / f"{n}.parquet", machine=machine) for n in names)
    return pm.diagnose(first, machine.machine, validation=other if judged else None)


def diagnosed(folder: Path, *case: Any, **how: Any) -> Diagnosis:
    """The diagnosis of a case that `proof.case.make_case` makes of `case` and `how` in `folder`."""
    from proof.case import make_case

    make_case(folder / "open", *case, truth_folder=folder / "sealed", **how)
    return diagnose(folder / "open")
