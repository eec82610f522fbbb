"""Python: files by their names, frames, pictures, short repr, one family of errors."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import arro3.core
import numpy as np
import pandas as pd
import pmsm_rs as pm
import polars as pl
import pyarrow as pa
import pytest
from conftest import MACHINE, Columns, csv_text
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.support.demo import recording_files

ORDER = ["t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e"]
ROWS = 1500


@pytest.fixture(scope="module")
def demo() -> pm.Recording:
    whole = pm.load(recording_files()[0])
    return pm.Recording({name: whole.column(name)[:ROWS] for name in whole.names})


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A log under names of its own, and the machine file that says what they are; beside it another log."""
    whole = pm.load(recording_files()[0])
    for file, first in (("run.csv", 0), ("other.csv", 5000)):
        rows = slice(first, first + ROWS)
        columns = {name: whole.column(name)[rows] for name in ORDER}
        (tmp_path / file).write_text(csv_text(columns, {"v_d": "x1", "v_q": "x2"}))
    text = Path(recording_files()[2]).read_text()
    names = "\n".join(f'{name} = "{name}"' for name in ORDER if name not in {"v_d", "v_q"})
    (tmp_path / "m.toml").write_text(f'{text}\n[columns]\nv_d = "x1"\nv_q = "x2"\n{names}\n')
    return tmp_path / "run.csv", tmp_path / "m.toml"


def same(one: pm.Diagnosis, other: pm.Diagnosis) -> bool:
    return (one.verdict, one.model, one.fit) == (other.verdict, other.model, other.fit)


def test_diagnose_takes_names_of_files(files: tuple[Path, Path]) -> None:
    run, machine = files
    other = run.with_name("other.csv")
    first, second = pm.load(run, machine), pm.load(other, machine)
    wanted = pm.diagnose(first, machine, second)
    assert wanted.verdict == "named"
    assert same(pm.diagnose(str(run), str(machine), str(other)), wanted)
    assert same(pm.diagnose(run, machine, second), wanted)
    assert wanted.data["read"]["columns"]["v_d"]["from"] == "x1"
    both, mixed = pm.diagnose([run, other], machine), pm.diagnose([first, str(other)], machine)
    assert same(both, mixed)
    assert [entry["file"] for entry in mixed.recordings] == [str(run), str(other)]


def test_identify_and_track_take_names_of_files(files: tuple[Path, Path]) -> None:
    run, machine = files
    loaded = pm.load(run, machine)
    fit = ["r_s"]
    assert (
        pm.identify(run, machine, fit=fit, method="lm").to_json()
        == pm.identify(loaded, machine, fit=fit, method="lm").to_json()
    )
    by_name, by_object = pm.track(str(run), str(machine)), pm.track(loaded, machine)
    assert [window.parameters for window in by_name] == [window.parameters for window in by_object]


def test_a_tracker_knows_the_load_of_its_machine_file(tmp_path: Path, columns: Columns) -> None:
    (tmp_path / "m.toml").write_text(MACHINE.replace('"unknown_constant"', '"none"'))
    (by_file,) = pm.Tracker(tmp_path / "m.toml", fit=["j"], window=0.3).update(columns)
    plate = read_machine(tmp_path / "m.toml").machine
    (told,) = pm.Tracker(plate, fit=["j"], window=0.3, load="none").update(columns)
    assert by_file.to_json() == told.to_json()
    (free,) = pm.Tracker(plate, fit=["j"], window=0.3).update(columns)
    assert set(free.parameters) > set(by_file.parameters), "without it the load is fitted along"


def test_a_loaded_recording_is_loaded_already(demo: pm.Recording) -> None:
    assert pm.load(demo) is demo
    assert pm.inspect(demo).kind == demo.kind


def test_pandas_takes_a_recording(demo: pm.Recording) -> None:
    frame = pd.DataFrame(demo)
    assert list(frame.columns) == ORDER
    assert frame.shape == (ROWS, len(ORDER))
    assert set(frame.dtypes) == {np.dtype(np.float64)}
    for name in ORDER:
        assert np.array_equal(frame[name], demo.column(name))
    assert pm.load(frame).column("i_a").tobytes() == demo.column("i_a").tobytes()


def test_polars_takes_a_recording(demo: pm.Recording) -> None:
    frame = pl.DataFrame(demo)
    assert frame.columns == ORDER
    assert set(frame.dtypes) == {pl.Float64}
    for name in ORDER:
        assert np.array_equal(frame[name].to_numpy(), demo.column(name))


@pytest.mark.parametrize("take", [pa.table, arro3.core.Table.from_arrow])
def test_whatever_takes_an_arrow_stream_takes_a_recording(
    take: Callable[[Any], Any], demo: pm.Recording
) -> None:
    table = take(demo)
    assert list(table.column_names) == ORDER
    assert np.array_equal(table["omega_e"].to_numpy(), demo.column("omega_e"))
    again = pm.load(table)
    assert again.kind == demo.kind
    assert np.array_equal(again.column("t"), demo.column("t"))


def test_a_stream_in_another_type_is_the_library_s_to_convert(demo: pm.Recording) -> None:
    schema = pa.schema([(name, pa.float32()) for name in ORDER])
    table = pa.table(pa.RecordBatchReader.from_stream(demo, schema=schema))
    assert set(table.schema.types) == {pa.float32()}


def test_rows_are_named_tuples(demo: pm.Recording) -> None:
    rows = iter(demo)
    assert isinstance(rows, Iterator)
    first: Any = next(rows)
    assert first._fields == tuple(ORDER)
    assert first.i_a == demo.column("i_a")[0]
    assert sum(1 for _ in rows) == len(demo) - 1


def test_a_plot_has_axes_for_each_quantity(demo: pm.Recording) -> None:
    figure = demo.plot()
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert labels == ["voltage in V", "current in A", "speed in rad/s"]
    assert figure.axes[-1].get_xlabel() == "t in s"
    lines = figure.axes[1].get_lines()
    assert [line.get_label() for line in lines] == ["i_a", "i_b", "i_c"]
    drawn, measured = np.asarray(lines[0].get_ydata()), demo.column("i_a")
    assert (drawn.min(), drawn.max()) == (measured.min(), measured.max()), "no peak is lost"
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_a_plot_of_other_columns() -> None:
    t = np.arange(50) * 1.0
    columns = {"t": t, "v_d": 1.0 + t, "v_q": t, "i_d": -t, "i_q": t, "omega_e": 10.0 + t, "v_dc": 540.0 + t}
    figure = pm.Recording({**columns, "tau_m": t, "temperature": 20.0 + t}).plot()
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "voltage in V",
        "current in A",
        "speed in rad/s",
        "torque in N·m",
        "DC link in V",
        "temperature in °C",
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure.savefig(io.BytesIO(), format="png")


def test_a_notebook_shows_a_recording(demo: pm.Recording, tmp_path: Path) -> None:
    page = demo._repr_html_()
    assert page.startswith("<div")
    assert "1500 rows, one every 0.1 ms" in page
    for name in ORDER:
        assert f">{name}</td>" in page
    assert len(page) < 10_000
    (tmp_path / "<b>.csv").write_text(csv_text({name: demo.column(name) for name in ORDER}))
    assert "<b>" not in pm.load(tmp_path / "<b>.csv")._repr_html_()


def test_every_repr_is_one_short_line(files: tuple[Path, Path], demo: pm.Recording, tmp_path: Path) -> None:
    run, machine = files
    first = next(iter(pm.track(run, machine)))
    shown = {
        "Recording": repr(demo),
        "Diagnosis": repr(pm.diagnose(run, machine)),
        "Identification": repr(pm.identify(run, machine, fit=["r_s"], method="lm")),
        "Inspection": repr(pm.inspect(run, machine)),
        "Tracker": repr(pm.Tracker(machine)),
        "WindowEstimate": repr(first),
        "Fleet": repr(pm.diagnose_many([run, tmp_path / "none.csv"], machine)),
    }
    for name, text in shown.items():
        assert re.fullmatch(rf"<{name}\b[^\n]*>", text), text
        assert len(text) < 120 + len(str(run))
    assert shown["Recording"].endswith(f"full: {', '.join(ORDER)}>")
    assert shown["Diagnosis"].startswith("<Diagnosis: named: dead_time 9")
    assert "1 named, 1 failed" in shown["Fleet"]
    assert "8 of 8 columns used, full" in shown["Inspection"]
    assert "r_s 1." in shown["WindowEstimate"]


NAMEPLATE = pm.Machine(n_p=4)
DEMO, _, DEMO_MACHINE = recording_files()
WRONG: dict[str, Callable[[pm.Recording], object]] = {
    "a column": lambda run: run.column("nope"),
    "a machine": lambda run: pm.Machine(n_p=0),
    "no machine": lambda run: pm.diagnose(run, 5),  # type: ignore[arg-type]
    "None for a machine": lambda run: pm.identify(run, None),  # type: ignore[arg-type]
    "no machine to track": lambda run: list(pm.track(run, {"n_p": 4})),  # type: ignore[arg-type]
    "no machine for a tracker": lambda run: pm.Tracker("none.toml"),
    "no machine for many": lambda run: pm.diagnose_many([run], 5),  # type: ignore[arg-type]
    "no recording": lambda run: pm.diagnose(5, NAMEPLATE),  # type: ignore[arg-type]
    "no recording of many": lambda run: pm.diagnose_many([5], NAMEPLATE),  # type: ignore[list-item]
    "no recording to load": lambda run: pm.load(5),
    "no recording to inspect": lambda run: pm.inspect(5),
    "no recording to track": lambda run: list(pm.track(5, NAMEPLATE)),
    "no file": lambda run: pm.diagnose("none.csv", NAMEPLATE),
    "no file to judge": lambda run: pm.diagnose(run, NAMEPLATE, "none.csv"),
    "no columns": lambda run: pm.Recording(5),  # type: ignore[arg-type]
    "text in a column": lambda run: pm.Recording({"t": ["a"]}),
    "no kind of load": lambda run: pm.Recording({"t": [0.0, 1.0]}, load=5),  # type: ignore[arg-type]
    "no load": lambda run: pm.Recording({"t": [0.0, 1.0]}, load="known_constant", load_value="x"),  # type: ignore[arg-type]
    "no error of an angle": lambda run: pm.Recording({"t": [0.0, 1.0]}, angle_error="x"),  # type: ignore[arg-type]
    "no window": lambda run: pm.Tracker(NAMEPLATE, window="x"),  # type: ignore[arg-type]
    "no window to track": lambda run: pm.track(run, NAMEPLATE, window="x"),  # type: ignore[arg-type]
    "no share": lambda run: pm.Tracker(NAMEPLATE, search=None),  # type: ignore[arg-type]
    "no swarm": lambda run: pm.identify(run, DEMO_MACHINE, swarm=5),  # type: ignore[arg-type]
    "a wrong swarm": lambda run: pm.identify(run, DEMO_MACHINE, swarm=pm.Swarm(particles=-1)),
    "no options": lambda run: pm.diagnose(run, DEMO_MACHINE, options=5),  # type: ignore[arg-type]
    "no method": lambda run: pm.identify(run, DEMO_MACHINE, method=5),  # type: ignore[arg-type]
    "no names to fit": lambda run: pm.identify(run, DEMO_MACHINE, fit=5),  # type: ignore[arg-type]
    "a number to fit": lambda run: pm.identify(run, DEMO_MACHINE, fit=[5]),  # type: ignore[list-item]
    "no state": lambda run: pm.Tracker.restore("x"),
    "no diagnosis": lambda run: pm.Diagnosis.from_json("x"),
    "an empty diagnosis": lambda run: pm.Diagnosis.from_json("{}"),
    "no identification": lambda run: pm.Identification.from_json("[]"),
    "no window estimate": lambda run: pm.WindowEstimate.from_json('{"window": 1}'),
    "no batch": lambda run: pm.Tracker(NAMEPLATE).update(5),
    "no simulation": lambda run: pm.simulate(5),  # type: ignore[arg-type]
    "no key of a simulation": lambda run: pm.simulate(foo=1),
    "no parameter": lambda run: pm.Fitness(run, NAMEPLATE, ["x"]),
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_whatever_is_refused_is_an_error_of_the_package(
    wrong: Callable[[pm.Recording], object], demo: pm.Recording
) -> None:
    with pytest.raises(pm.PmsmError) as caught:
        wrong(demo)
    assert not isinstance(caught.value, pm.InternalError)
    assert "\n" not in str(caught.value)


def test_all_errors_are_of_one_family() -> None:
    errors = [pm.DataError, pm.MachineError, pm.UsageError, pm.NotIdentifiableError, pm.InternalError]
    assert all(issubclass(error, pm.PmsmError) for error in errors)
    from pmsm_rs import errors as module

    own = [kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, Exception)]
    assert own
    assert all(issubclass(kind, pm.PmsmError) for kind in own)
