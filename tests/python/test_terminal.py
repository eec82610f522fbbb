"""What people see of the command line: JSON alone, quiet, colours, progress, help, completion."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
import pmsm_rs as pm
import pytest
from conftest import Ran, csv_text, plausible
from pmsm_rs.cli import cli, terminal
from pmsm_rs.cli.manual import page
from pmsm_rs.cli.progress import DIAGNOSIS, WIDTH, Bar, identification
from pmsm_rs.support.demo import recording_files

Run = Callable[..., Ran]
RECORDING, VALIDATION, MACHINE = recording_files()
FIT = ("identify", RECORDING, "--machine", MACHINE, "--fit", "r_s", "--method", "lm")
WIDE = "120"


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    path = tmp_path / "m.toml"
    path.write_text("[machine]\nn_p = 3\n")
    return path


def test_json_goes_to_standard_output_alone(run: Run) -> None:
    ran = run(*FIT, "--json", "-")
    assert ran.code in (0, 4)
    assert ran.err == ""
    answer = json.loads(ran.out)
    assert set(answer["parameters"]) >= {"r_s"}
    assert ran.out.count("\n") >= 1
    assert not Path("-").exists()


def test_json_on_standard_output_is_utf8_whatever_the_terminal_has(tmp_path: Path) -> None:
    code = f"from pmsm_rs.cli import main; main({[*FIT, '--json', '-']!r})"
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=False, env=environment
    )
    assert json.loads(ran.stdout.decode("utf-8"))["parameters"]["r_s"]["unit"]


def test_signs_that_a_terminal_lacks_do_not_cost_the_answer(tmp_path: Path) -> None:
    code = "from pmsm_rs.cli import main; main(['effects', 'dead_time'])"
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252"}
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=False, env=environment
    )
    assert ran.returncode == 0, ran.stderr
    assert b"Equation:" in ran.stdout


def test_a_refusal_is_still_an_answer_on_standard_output(tmp_path: Path, machine: Path, run: Run) -> None:
    columns = {name: values for name, values in plausible().items() if not name.startswith("v_")}
    (tmp_path / "r.csv").write_text(csv_text(columns))
    ran = run("diagnose", tmp_path / "r.csv", "--machine", machine, "--json", "-")
    assert ran.code == 4
    assert json.loads(ran.out)["verdict"] == "undetermined"
    assert ran.err.startswith("pmsm-rs: ")


def test_inspect_gives_its_json_alone(tmp_path: Path, run: Run) -> None:
    (tmp_path / "r.csv").write_text(csv_text(plausible()))
    ran = run("inspect", tmp_path / "r.csv", "--json", "-")
    assert json.loads(ran.out)["schema"] == "pmsm-rs.inspection/1"


def test_track_gives_its_json_alone(tmp_path: Path, machine_file: Path, run: Run) -> None:
    (tmp_path / "r.csv").write_text(csv_text(plausible()))
    arguments = ("track", tmp_path / "r.csv", "--machine", machine_file, "--window", "0.1")
    written = run(*arguments, "--json", tmp_path / "a.json")
    alone = run(*arguments, "--json", "-")
    assert "windows" in written.out
    assert alone.out == (tmp_path / "a.json").read_text()
    assert len(json.loads(alone.out)["windows"]) == 4


def test_a_live_stream_has_standard_output_already(machine_file: Path, run: Run) -> None:
    ran = run("track", "-", "--machine", machine_file, "--json", "-")
    assert ran.code == 2
    assert "name a file" in ran.err


@pytest.mark.parametrize("option", ["--report", "--trajectories"])
def test_only_json_goes_to_standard_output(option: str, machine: Path, run: Run) -> None:
    ran = run("diagnose", RECORDING, "--machine", machine, option, "-")
    assert ran.code == 2
    assert "only --json" in ran.err


def test_quiet_prints_nothing_and_writes_everything(tmp_path: Path, run: Run) -> None:
    ran = run(*FIT, "--quiet", "--json", tmp_path / "a.json")
    assert (ran.out, ran.err) == ("", "")
    assert json.loads((tmp_path / "a.json").read_text())["parameters"]


def test_quiet_still_tells_of_errors(tmp_path: Path, machine: Path, run: Run) -> None:
    ran = run("diagnose", tmp_path / "none.csv", "--machine", machine, "--quiet")
    assert ran.code == 2
    assert "none.csv" in ran.err


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("environment", "coloured"),
    [
        ({}, True),
        ({"NO_COLOR": "1"}, False),
        ({"NO_COLOR": ""}, True),
        ({"TERM": "dumb"}, False),
        ({"FORCE_COLOR": "1", "TERM": "dumb"}, True),
        ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, False),
    ],
)
def test_colours_are_for_terminals_that_want_them(
    environment: dict[str, str], coloured: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert terminal.is_coloured(Terminal()) is coloured
    assert terminal.is_coloured(io.StringIO()) is ("FORCE_COLOR" in environment and coloured)


def test_colours_change_nothing_but_the_colour(monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    plain = run("effects", "dead_time").out
    assert "\x1b" not in plain
    monkeypatch.setenv("FORCE_COLOR", "1")
    coloured = run("effects", "dead_time").out
    assert "\x1b[1m" in coloured
    assert click.unstyle(coloured) == plain
    wrong = run("effects", "dead_tim").err
    assert wrong.startswith("\x1b")
    assert click.unstyle(wrong).startswith("pmsm-rs: ")


def test_headings_and_warnings_are_set_off() -> None:
    text = "The finding\nin two lines.\n  ! a warning\n\nRead\n  t (s)\n\nNext\n  more"
    painted = terminal.painted(text)
    assert click.unstyle(painted) == text
    bold, heading = "\x1b[1m", click.style("Read", fg="cyan", bold=True)
    assert painted.startswith(f"{bold}The finding")
    assert heading in painted
    assert click.style("!", fg="yellow", bold=True) in painted
    assert "\n  t (s)\n" in painted


def drawn(out: io.StringIO) -> list[str]:
    """The lines that followed one another on the terminal."""
    return [line.rstrip() for line in out.getvalue().split("\r") if line.strip()]


def test_progress_never_runs_backwards(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", WIDE)
    out = io.StringIO()
    times = iter(range(100))
    bar = Bar(out, DIAGNOSIS, clock=lambda: float(next(times)))
    for stage, fraction in [
        ("bare machine", 0.0),
        ("least squares", 0.9),
        ("bare machine", 0.1),
        ("effects", 0.6),
        ("effects", 0.4),
        ("alternatives", 0.85),
        ("answer", 0.97),
        ("bare machine", 0.1),
        ("answer", 1.5),
    ]:
        bar(stage, fraction)
    lines = drawn(out)
    shares = [int(line.split("%")[0].split()[-1]) for line in lines]
    assert shares == sorted(shares)
    assert shares == [0, 10, 60, 85, 97, 100]
    assert "least squares" not in out.getvalue(), "steps within a stage are not shown"
    assert "looking for effects" in lines[2]
    assert lines[-1].endswith("s")


def test_the_stages_of_an_identification_follow_one_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", WIDE)
    out = io.StringIO()
    bar = Bar(out, identification("pso+lm"), clock=lambda: 0.0)
    for stage, fraction in [("particle swarm", 0.5), ("particle swarm", 1.0), ("least squares", 0.5)]:
        bar(stage, fraction)
    assert [int(line.split("%")[0].split()[-1]) for line in drawn(out)] == [40, 80, 90]


@pytest.mark.parametrize("method", ["pso", "lm", "pso+lm"])
def test_an_identification_ends_at_the_whole(method: str) -> None:
    stages = identification(method)
    assert stages["particle swarm"].begin == 0.0
    assert stages["particle swarm"].end == stages["least squares"].begin
    assert stages["least squares"].end == 1.0


def test_a_narrow_terminal_cuts_the_line_and_shows_other_signs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "30")
    out = io.TextIOWrapper(io.BytesIO(), encoding="ascii", write_through=True)
    Bar(out, DIAGNOSIS, clock=lambda: 0.0)("alternatives", 0.85)
    assert isinstance(out.buffer, io.BytesIO)
    line = out.buffer.getvalue().decode("ascii").lstrip("\r")
    assert len(line) == 29
    assert line.startswith("#" * round(0.85 * WIDTH) + ".")


def test_progress_is_for_terminals_only(monkeypatch: pytest.MonkeyPatch) -> None:
    assert terminal.progress() is None
    monkeypatch.setattr(sys, "stderr", Terminal())
    assert terminal.progress() is not None
    with click.Context(cli) as context:
        terminal.keep_quiet(context)
        assert terminal.progress() is None


def test_the_core_tells_of_the_stages_that_are_shown() -> None:
    whole = pm.load(RECORDING, MACHINE)
    short = pm.Recording({name: whole.column(name)[:1000] for name in whole.names})
    told: set[str] = set()

    def until_known(stage: str, _fraction: float) -> None:
        told.add(stage)
        if stage in DIAGNOSIS:
            raise LookupError

    with pytest.raises(LookupError):
        pm.diagnose(short, MACHINE, threads=1, progress=until_known)
    told.clear()

    def until_told(stage: str, _fraction: float) -> None:
        told.add(stage)
        raise LookupError

    with pytest.raises(LookupError):
        pm.identify(whole, MACHINE, threads=1, progress=until_told)
    assert told <= {*identification("pso+lm")}


COMMANDS = sorted(cli.commands)


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_every_help_has_examples_and_exit_codes(command: str | None, run: Run) -> None:
    text = run(*([] if command is None else [command]), "--help").out
    examples, codes = text.split("\nExamples:\n")[1].split("\nExit codes:\n")
    lines = [line.strip() for line in examples.strip().splitlines()]
    assert lines
    for line in lines:
        assert f"pmsm-rs {command or ''}".strip() in line
    listed = [int(line.split()[0]) for line in codes.splitlines() if line.strip()[:1].isdigit()]
    assert listed == sorted(listed)
    assert {0, 1, 2} <= {*listed} <= {0, 1, 2, 3, 4, 130}


@pytest.mark.parametrize("command", COMMANDS)
def test_examples_name_options_that_exist(command: str) -> None:
    options = {name for parameter in cli.commands[command].params for name in parameter.opts}
    for line in cli.commands[command].examples:  # type: ignore[attr-defined]
        used = [word for word in line.split() if word.startswith("--")]
        assert {*used} <= {*options}, line


def test_every_command_has_a_section_and_a_sentence_that_fits() -> None:
    listed = cli.list_commands(click.Context(cli))
    assert sorted(listed) == COMMANDS
    for command in cli.commands.values():
        assert command.get_short_help_str(300) == command.get_short_help_str(62), command.name


def test_a_misspelt_command_names_the_nearest(run: Run) -> None:
    ran = run("digonse")
    assert ran.code == 2
    assert "did you mean 'diagnose'" in ran.err


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_completion_script_asks_the_program(shell: str, run: Run) -> None:
    ran = run("completion", shell)
    assert ran.code == 0
    assert f"_PMSM_RS_COMPLETE={shell}_complete" in ran.out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("pmsm-rs dia", ["diagnose"]),
        ("pmsm-rs effects dead", ["dead_time"]),
        ("pmsm-rs man ide", ["identify"]),
        ("pmsm-rs identify --method l", ["lm"]),
        ("pmsm-rs diagnose --val", ["--validate"]),
    ],
)
def test_completion_knows_commands_options_and_effects(
    words: str, expected: list[str], monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    monkeypatch.setenv("_PMSM_RS_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert [line.split(",", 1)[1] for line in run().out.splitlines()] == expected


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_manual_pages_hold_what_the_help_holds(command: str | None, run: Run) -> None:
    text = run("man", *([] if command is None else [command])).out
    assert text.startswith(".TH ")
    for heading in ("NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS", "EXAMPLES", "EXIT STATUS", "SEE ALSO"):
        assert f"\n.SH {heading}\n" in text
    what = cli if command is None else cli.commands[command]
    for parameter in what.params:
        for name in parameter.opts if isinstance(parameter, click.Option) else ():
            assert name.replace("-", r"\-") in text
    lines = text.splitlines()
    known = {".TH", ".SH", ".PP", ".TP", ".nf", ".fi"}
    assert {line.split()[0] for line in lines if line.startswith(".")} <= known
    assert not [line for line in lines if line.startswith("'")]


@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not installed")
def test_groff_has_nothing_to_say_on_manual_pages() -> None:
    text = "\n".join(page(cli, name) for name in [None, *COMMANDS])
    ran = subprocess.run(
        ["groff", "-man", "-Tutf8", "-ww", "-z"], input=text, capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stderr) == (0, "")


def test_a_manual_page_of_no_command_names_the_nearest(run: Run) -> None:
    ran = run("man", "diagnos")
    assert ran.code == 2
    assert "did you mean 'diagnose'" in ran.err
