"""Time as loggers write it: dates and times of day, counters that wrap, stamps that several rows share."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns, csv_text
from pmsm_rs.io.timing import spread, unwrapped

BEGAN = datetime(2024, 3, 1, 16, 53, 12, 590000)


def table(columns: Columns, stamps: Callable[[datetime], list[str]], names: list[str], separator: str) -> str:
    rest = {name: values for name, values in columns.items() if name != "t"}
    lines = [separator.join([*names, *rest])]
    for k, row in enumerate(zip(*rest.values(), strict=True)):
        moment = BEGAN + timedelta(seconds=float(columns["t"][k]))
        lines.append(separator.join([*stamps(moment), *(repr(float(value)) for value in row)]))
    return "\n".join(lines) + "\n"


def check(path: Path, columns: Columns) -> pm.Recording:
    recording = pm.load(path)
    assert sorted(recording.names) == sorted(columns)
    for name, values in columns.items():
        np.testing.assert_allclose(recording.column(name), values, rtol=1e-12, atol=1e-9, err_msg=name)
    return recording


STAMPS: dict[str, tuple[list[str], str, Callable[[datetime], list[str]]]] = {
    "ISO": (["timestamp"], ",", lambda m: [m.isoformat(timespec="microseconds")]),
    "ISO with a zone": (["Time"], ";", lambda m: [m.isoformat(" ", "milliseconds") + "+01:00"]),
    "a name that says nothing": (["when"], "\t", lambda m: [m.strftime("%d/%m/%Y  %H:%M:%S.%f")]),
    "date and time": (["Date", "Time"], ",", lambda m: [m.strftime("%Y/%m/%d"), m.strftime("%H:%M:%S.%f")]),
    "time and date": (["Zeit", "Datum"], ";", lambda m: [m.strftime("%H:%M:%S,%f"), m.strftime("%d.%m.%Y")]),
    "blanks": (["date", "time"], "  ", lambda m: [m.strftime("%m/%d/%Y"), m.strftime("%H:%M:%S.%f")]),
    "one name over two fields": (
        ["timestamp"],
        " ",
        lambda m: [m.strftime("%Y-%m-%d %H:%M:%S.%f")],
    ),
    "half a day": (["Time"], ",", lambda m: [m.strftime("%I:%M:%S.%f %p")]),
    "milliseconds behind a colon": (["Time"], ",", lambda m: [m.strftime("%H:%M:%S:%f")[:-3]]),
    "fraction": (
        ["Date", "Time", "us"],
        "\t",
        lambda m: [f"{m:%d-%b-%Y}", f"{m:%H:%M:%S}", str(m.microsecond)],
    ),
    "fraction in ms": (["Time", "Millis"], ",", lambda m: [f"{m:%H:%M:%S}", str(m.microsecond // 1000)]),
}


@pytest.mark.parametrize("kind", STAMPS)
def test_dates_and_times_of_day_are_a_time(kind: str, columns: Columns, tmp_path: Path) -> None:
    names, separator, stamps = STAMPS[kind]
    (tmp_path / "r.csv").write_text(table(columns, stamps, names, separator))
    recording = check(tmp_path / "r.csv", columns)
    assert recording.account.columns["t"].unit == "s"
    told = [remark.finding for remark in recording.account.remarks]
    assert told[0].startswith("The sample time was taken from")
    assert all(f"'{name}'" in told[0] for name in names if name != "timestamp" or len(names) == 1)


def test_a_data_logger(columns: Columns, tmp_path: Path) -> None:
    units = {"v_d": "V", "v_q": "V", "i_d": "A", "i_q": "A", "theta_e": "rad", "omega_e": "rad/s"}
    lines = ["Vendor\tLOGGER", "Sampling interval\t1ms", *(f"CH{k}\tVOLT\t10V\tOff" for k in range(30))]
    lines += ["\t".join(["NO.", "Date", "Time", "ms", *units]), "\t".join(["", "", "", "", *units.values()])]
    rest = [columns[name] for name in units]
    for k, row in enumerate(zip(*rest, strict=True)):
        signed = [f"{'-' if value < 0 else '+'} {abs(value)!r}" for value in map(float, row)]
        moment = BEGAN + timedelta(milliseconds=k)
        lines.append(
            "\t".join(
                [
                    str(k + 1),
                    f"{moment:%Y/%m/%d}",
                    f"{moment:%H:%M:%S}",
                    str(moment.microsecond // 1000),
                    *signed,
                ]
            )
        )
    (tmp_path / "r.csv").write_text("\n".join(lines) + "\n")
    recording = check(tmp_path / "r.csv", columns)
    assert recording.account.ignored == ("NO.",)
    assert recording.account.columns["v_d"].unit == "V"


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_signs_apart_from_their_digits(separator: str, columns: Columns, tmp_path: Path) -> None:
    text = csv_text(columns, separator=separator)
    (tmp_path / "r.csv").write_text(text.replace(f"{separator}-", f"{separator}-  "))
    check(tmp_path / "r.csv", columns)


def test_a_time_of_day_goes_on_over_midnight(columns: Columns, tmp_path: Path) -> None:
    late = {**columns, "t": columns["t"] + 7 * 3600.0 + 6 * 60.0 + 47.21}
    stamped = table(late, lambda m: [m.strftime("%H:%M:%S.%f")], ["Time"], ",")
    (tmp_path / "r.csv").write_text(stamped)
    recording = check(tmp_path / "r.csv", columns)
    assert any("passes midnight" in remark.finding for remark in recording.account.remarks)


def test_a_date_that_can_be_read_in_two_ways_is_settled_by_midnight(columns: Columns, tmp_path: Path) -> None:
    late = {**columns, "t": columns["t"] + 7 * 3600.0 + 6 * 60.0 + 47.21}
    for pattern in ("%d/%m/%Y", "%m/%d/%Y"):
        stamped = table(late, lambda m: [m.strftime(f"{pattern} %H:%M:%S.%f")], ["Time"], ",")  # noqa: B023
        (tmp_path / "r.csv").write_text(stamped)
        check(tmp_path / "r.csv", columns)


def test_dates_that_stay_open_are_refused(columns: Columns, tmp_path: Path) -> None:
    odd = {**columns, "t": columns["t"] + 86400.0 * 10 * (columns["t"] > 0.2)}
    (tmp_path / "r.csv").write_text(table(odd, lambda m: [m.strftime("%d/%m/%Y %H:%M:%S.%f")], ["Time"], ","))
    with pytest.raises(pm.DataError, match="day or the month first; write dates as 2024-12-31"):
        pm.load(tmp_path / "r.csv")


def test_a_column_that_counts_time_goes_before_times_of_day(columns: Columns, tmp_path: Path) -> None:
    text = csv_text(columns, {"t": "time_s"}).splitlines()
    stamped = ["clock," + text[0], *(f"16:53:12,{line}" for line in text[1:])]
    (tmp_path / "r.csv").write_text("\n".join(stamped) + "\n")
    recording = check(tmp_path / "r.csv", columns)
    assert recording.account.columns["t"].source == "time_s"


def test_a_counter_beside_times_of_day_is_no_fraction_of_them(columns: Columns, tmp_path: Path) -> None:
    stamped = table(
        columns,
        lambda m: [f"{m:%H:%M:%S}", str(5_000_000 + round((m - BEGAN).total_seconds() * 1e6))],
        ["Time", "micros"],
        ",",
    )
    (tmp_path / "r.csv").write_text(stamped)
    recording = pm.load(tmp_path / "r.csv")
    assert recording.account.columns["t"].source == "micros"


def test_what_is_no_time_of_day_is_refused_with_its_line(columns: Columns, tmp_path: Path) -> None:
    text = table(columns, lambda m: [m.strftime("%H:%M:%S.%f")], ["Time"], ",").splitlines()
    text[300] = text[300].replace("16:53:", "16-53-")
    (tmp_path / "r.csv").write_text("\n".join(text) + "\n")
    with pytest.raises(pm.DataError, match="no date or time of day") as refused:
        pm.load(tmp_path / "r.csv")
    assert (refused.value.row, refused.value.column) == (301, "Time")


def test_stamps_without_a_date_among_others_are_refused(columns: Columns, tmp_path: Path) -> None:
    text = table(columns, lambda m: [m.isoformat(" ", "microseconds")], ["Time"], ",").splitlines()
    text[300] = text[300].removeprefix("2024-03-01 ")
    (tmp_path / "r.csv").write_text("\n".join(text) + "\n")
    with pytest.raises(pm.DataError, match="there is no date, and other rows have one") as refused:
        pm.load(tmp_path / "r.csv")
    assert refused.value.row == 301


def test_the_unit_of_a_time_of_day_cannot_be_chosen(
    columns: Columns, tmp_path: Path, machine_file: Path
) -> None:
    (tmp_path / "r.csv").write_text(table(columns, lambda m: [m.strftime("%H:%M:%S.%f")], ["Time"], ","))
    machine_file.write_text('[machine]\nn_p = 3\n[columns]\nt = { from = "Time", unit = "ms" }\n')
    with pytest.raises(pm.DataError, match="times of day, which are read as seconds"):
        pm.load(tmp_path / "r.csv", machine_file)


@pytest.mark.parametrize(
    ("header", "scale", "bits"), [("time_us", 1e6, 32), ("time_ms", 1e3, 16), ("time_ms", 1e3, 32)]
)
def test_a_counter_that_wraps_is_continued(
    header: str, scale: float, bits: int, columns: Columns, tmp_path: Path
) -> None:
    counts = np.remainder(np.rint(columns["t"] * scale) + 2.0**bits - 150.0 * scale / 1e3, 2.0**bits)
    (tmp_path / "r.csv").write_text(csv_text({**columns, "t": counts}, {"t": header}))
    recording = pm.load(tmp_path / "r.csv")
    np.testing.assert_allclose(np.diff(recording.column("t")), 1e-3, rtol=1e-6)
    [remark] = recording.account.remarks
    assert f"wraps once at 2^{bits} counts, at line 152" in remark.finding


def test_counters_wrap_often_and_in_any_unit() -> None:
    even = np.arange(0.0, 300.0, 0.5)
    mended, remark = unwrapped(np.remainder(even * 1e3, 2.0**16) / 1e3, "t", lambda row: (row, f"row {row}"))
    np.testing.assert_allclose(mended, even, atol=1e-9)
    assert remark is not None
    assert "4 times at 2^16 counts of 0.001, first at row 132" in remark.finding


@pytest.mark.parametrize("jump", [1.0, 60.0, 65.0, 66.0, 4200.0, 4294.9])
def test_other_jumps_back_are_not_mended(jump: float) -> None:
    stamps = np.arange(100.0) * 1e-3 + 5000.0
    stamps[50:] -= jump
    mended, remark = unwrapped(stamps, "t", lambda row: (row, ""))
    assert remark is None
    assert mended is stamps


@pytest.mark.parametrize(("rows", "first"), [(5, 0), (5, 3), (3.3, 1), (1.5, 0), (40, 17)])
def test_rows_that_share_a_stamp_are_spaced_evenly(rows: float, first: int) -> None:
    even = (np.arange(2000) + first) / rows
    mended, remark = spread(np.floor(even), [np.sin(even)], "t", "ms")
    assert remark is not None
    np.testing.assert_allclose(np.diff(mended), 1.0 / rows, rtol=1e-2)
    assert np.all(np.abs(mended - even) < 1.05)
    assert remark.finding.startswith(f"{rows:.3g} rows share each stamp of 't'")


def test_shared_stamps_with_a_gap_are_spaced_between_stamps() -> None:
    even = np.arange(1000) / 4.0
    stamps = np.floor(even) + 100.0 * (even >= 120.0)
    mended, remark = spread(stamps, [even], "t", "ms")
    assert remark is not None
    assert "between one stamp and the next" in remark.finding
    steps = np.diff(mended)
    np.testing.assert_allclose(np.sort(steps)[:-1], 0.25, rtol=1e-9, atol=1e-9)
    assert np.all(mended >= stamps)


def test_repeated_rows_are_still_refused(columns: Columns, tmp_path: Path) -> None:
    twice = {name: values.repeat(2) for name, values in columns.items()}
    (tmp_path / "r.csv").write_text(csv_text(twice))
    with pytest.raises(pm.DataError, match="time stands still"):
        pm.load(tmp_path / "r.csv")


def test_too_few_stamps_are_no_rate() -> None:
    stamps = np.repeat([0.0, 1.0, 2.0], 500)
    mended, remark = spread(stamps, [np.arange(1500.0)], "t", "s")
    assert remark is None
    assert mended is stamps
