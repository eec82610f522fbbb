"""Answers as they are handed out: their values, and how they print, draw and show themselves."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, overload

from .results import DiagnosisValues, IdentificationValues

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .notebook import Page

# What draws and renders is fetched by those who use it: a fleet of diagnoses needs none of it.


class Identification(IdentificationValues):
    """Estimated parameters of the dq-model.

    `history` holds the best cost of each generation, `rms` measured minus model per channel in its SI unit,
    and `cannot_show` the parameters that this recording does not determine, with the reason.
    """

    def __str__(self) -> str:
        from .summary import identification

        return identification(self)

    def _repr_html_(self) -> str:
        from .notebook import identification

        return identification(self)


class Diagnosis(DiagnosisValues):
    """What the dq-model leaves out; fields are those of the JSON answer, of which `effects` and `base` stand
    under `model` there.

    `read` says for each recording which of its columns became what, which were not used and why, and which
    questions could be asked; in the JSON answer it is an object for one recording and a list for several. The
    verdict is `no_mismatch`, `named`, `partial` (the named effects are missing, and something else beside
    them that is not in the catalogue), `ambiguous`, `unknown` or `undetermined`. Channels are i_d, i_q (A),
    omega_e (rad/s, electrical), of operating points v_d, v_q (V). `noise_floor` is what a perfect model would
    leave in each, `fit["recording" or "validation"]["before" or "after"]` what is left, both as root mean
    square in the channel's unit. `data_quality` has finding, consequence and fix; `cannot_see` effect, why,
    and power, the probability that it would have been found. `remaining` says what the effects that were
    found, named or not, leave beyond noise, and is empty where they reach it. `budget` says
    which share of the mismatch each effect takes away, by channel and run. `options` are the constants on
    which the verdict rests, see `DiagnosisOptions`. `reason` says why a verdict is `undetermined`, and is
    None otherwise. `data["machine"]` is what was stated of machine, drive and load. `data["path"]` is the way
    to the model, one effect more at each step.

    `traces["recording"]` and, where a validation run was given, `traces["validation"]` hold arrays of shape
    (samples,): `t` in s, per channel `NAME_measured`, `NAME_before`, `NAME_after`, and the operating point
    `op_omega_e` (rad/s), `op_i_d`, `op_i_q` (A), `op_theta_e`, `op_theta_m` (rad) as far as they are known.
    Several recordings lie end to end there, numbered by `recording`; `recordings` says of each its file,
    samples, duration in s, kind, load, noise_floor and fit, and is empty for a single one.
    """

    @overload
    def report(
        self, path: str | os.PathLike[str], title: str | None = None, *, command: str | None = None
    ) -> None: ...
    @overload
    def report(self, path: None = None, title: str | None = None, *, command: str | None = None) -> Page: ...
    def report(
        self,
        path: str | os.PathLike[str] | None = None,
        title: str | None = None,
        *,
        command: str | None = None,
    ) -> Page | None:
        """One self-contained HTML page: written to `path`, or returned for a notebook to show.

        `command` is the command line that made the answer, where there is one; the page shows it. The same
        answer, title and command give the same bytes. Raises UsageError if it cannot be written.
        """
        from .notebook import Page
        from .report import render

        page = Page(render(self, title, command))
        if path is None:
            return page
        page.save(path)
        return None

    def trajectories(self, path: str | os.PathLike[str]) -> None:
        """Writes t and the measured, before and after values per channel as Parquet.

        Raises UsageError if it cannot.
        """
        from .trajectories import write

        write(self, path)

    def plot(self) -> Figure:
        """A matplotlib figure: measured minus model before and after over time, and over the operating
        points.
        """
        from .plot import overview

        return overview(self)

    def __str__(self) -> str:
        from .summary import diagnosis

        return diagnosis(self)

    def _repr_html_(self) -> str:
        from .notebook import diagnosis

        return diagnosis(self)
