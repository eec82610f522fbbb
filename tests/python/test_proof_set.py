"""A set of the proof: what it holds, what is counted over it, and that the tool sees the open files alone."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from verdicts import COULOMB, DRAG, answer, judged, truth  # noqa: E402

from proof import answers, bench, limits, splits  # noqa: E402
from proof.families import family  # noqa: E402
from proof.foreign import FORMS  # noqa: E402
from proof.machines import MACHINES  # noqa: E402
from proof.plan import DRY, FAMILIES, KNOWN, plan, together  # noqa: E402
from proof.summary import brier, calibration, headline  # noqa: E402
from proof.table import markdown, write_results  # noqa: E402


def test_calibration_counts_every_name_and_brier_the_first() -> None:
    rows = [judged(truth("single", COULOMB), answer("named", (COULOMB, 0.9))) for _ in range(3)]
    rows.append(judged(truth("clean"), answer("named", (DRAG, 0.9))))
    rows.append(judged(truth("single", COULOMB), answer("unknown", (DRAG, 1.0))))
    rows.append(judged(truth("clean"), answer("no_mismatch")))
    rows[0] = judged(truth("single", COULOMB), answer("named", (COULOMB, 0.9), (DRAG, 0.05)))
    found = calibration(rows)
    assert [(b.low, b.count, b.observed) for b in found[:1]] == [(0.0, 1, 0.0)]
    found = found[1:]
    assert [(b.low, b.count) for b in found] == [(0.9, 5)]
    assert found[0].stated == pytest.approx(0.92)
    assert found[0].observed == pytest.approx(0.6)
    assert brier(rows).value == pytest.approx((3 * 0.01 + 0.81 + 1.0) / 5)
    assert brier([]).value is None


def test_the_parts_of_a_whole_bench_are_counted() -> None:
    alone = {"dead_time": 5.0, "stribeck_friction": 3.0, "iron_loss": 9.0, DRAG: 1.4}
    what = truth("whole", *alone, alone=alone, family="whole")
    said = answer("partial", ("dead_time", 0.99), (COULOMB, 0.95), ("saturation_d", 0.3))
    said["model"]["effects"] = ["dead_time", COULOMB, "saturation_d"]
    row = judged(what, said)
    # a nested friction counts, the drag is too weak to be asked for, the saturation is not there
    assert (row.strong, row.found, row.names, row.names_right) == (3, 2, 3, 2)
    assert (row.right, row.wrong_confident) == (False, False)
    said["ranking"][0]["equivalent_to"] = ["iron_loss"]
    said["model"]["effects"] = ["dead_time", COULOMB]
    row = judged(what, said)
    assert (row.found, row.right) == (3, True)
    assert not judged(what, {**said, "verdict": "unknown"}).right
    said["ranking"][2]["probability"] = 0.6
    assert judged(what, said).wrong_confident
    assert not judged(what, said).right
    assert str(family([row])["parts of 2 times the noise and more, found"]) == "3 of 3 (100.0 %)"


def test_bench_like_logs_are_counted_apart(tmp_path: Path) -> None:
    rows = [
        judged(truth("single", COULOMB), answer("named", (COULOMB, 0.9))),
        judged(truth("single", COULOMB, degraded="gaps"), answer("named", (DRAG, 0.9))),
    ]
    printed = write_results(rows, tmp_path, cases=2, seed=4, code="abc")
    assert "1 of 1 (100.0 %)" in printed
    score = json.loads((tmp_path / "score.json").read_text())
    name = "identifiable single effects named"
    assert (score["full"][name], score["bench"][name]) == ({"count": 1, "of": 1}, {"count": 0, "of": 1})
    table = (tmp_path / "table.md").read_text()
    assert f"| {name} | 1 of 1 (100.0 %) | 0 of 1 (0.0 %) |" in table
    assert "| v000 | coulomb friction | 4.00 | gaps | rich | none | named | quadratic drag | 0.90 |" in table
    assert (tmp_path / "calibration.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "calibration.svg").read_bytes().startswith(b"<?xml")


def test_a_set_without_cases_of_a_kind_says_so() -> None:
    assert all(str(v) == "–" for v in headline([]).values())
    assert "There is none." in markdown(
        [], {"cases": 1, "seed": 1, "version": "1", "commit": "", "code": "a", "split": "all"}
    )


def test_the_plan_holds_what_the_manual_promises() -> None:
    cases = plan(600, 11)
    assert cases == plan(600, 11)
    assert cases != plan(600, 12)
    assert Counter(c.family for c in cases) == {
        "singles": 117, "pairs": 24, "bench": 75, "clean": 42, "poor": 18, "unknown": 24, "whole": 100,
        "foreign": 100, "limits": 100,
    }  # fmt: skip
    assert Counter(c.simulator for c in cases) == {"plant": 567, "motulator": 21, "gym-electric-motor": 12}
    by = {f: [c for c in cases if c.family == f] for f in FAMILIES}
    assert {c.log for c in by["bench"]} == set(bench.KINDS)
    assert {c.log for c in by["limits"]} == set(limits.KINDS)
    assert Counter(c.kind for c in by["limits"]) == {"clean": 70, "limited": 30}
    assert {c.effects[0] for c in by["singles"]} == set(KNOWN)
    assert {c.effects[0] for c in by["foreign"]} == set(splits.forms("scoring"))
    assert Counter(bool(c.effects[1:]) for c in by["foreign"]) == {True: 50, False: 50}
    assert {len(c.effects) for c in by["whole"]} == {3, 4, 5, 6, 7}
    for c in by["whole"] + by["foreign"] + by["pairs"]:
        assert len(set(c.effects)) == len(c.effects)
        assert together(c.effects)
        assert len(set(c.effects) & set(DRY)) <= 1
    assert set(Counter(c.machine for c in by["clean"])) == set(splits.machines("scoring"))
    for count in (1, 2, 24, 61):
        assert len(plan(count, 3)) == count


def test_a_set_of_some_families_has_no_others() -> None:
    assert {c.family for c in plan(40, 5, ("whole", "limits"))} == {"whole", "limits"}
    assert Counter(c.family for c in plan(40, 5, ("whole", "limits"))) == {"whole": 20, "limits": 20}
    with pytest.raises(ValueError, match="no family half"):
        plan(40, 5, ("half",))


def test_what_scores_shares_no_machine_and_no_form_with_what_calibrates() -> None:
    for of, every in ((splits.machines, MACHINES), (splits.forms, FORMS)):
        scoring, calibration = set(of("scoring")), set(of("calibration"))
        assert not scoring & calibration
        assert scoring | calibration == set(of("all")) == set(every)
    for split in ("scoring", "calibration"):
        # each side of the drive is on both sides of the split
        assert {FORMS[k].equations[0] in ("mechanical", "sensor") for k in splits.forms(split)} == {
            True,
            False,
        }
        assert {"mechanical", "sensor"} <= {FORMS[k].equations[0] for k in splits.forms(split)}
        cases = plan(60, 3, ("foreign",), split)
        assert {c.machine for c in cases} <= set(splits.machines(split))
        assert {c.effects[0] for c in cases} == set(splits.forms(split))
    assert len(FORMS) >= 10


TOOL = """#!{python}
import json, pathlib, sys
told = sys.argv[1:]
pathlib.Path({log!r}).open("a").write(json.dumps(told) + "\\n")
pathlib.Path(told[told.index("--json") + 1]).write_text('{{"verdict": "no_mismatch"}}')
print("a word on standard error", file=sys.stderr)
sys.exit(4)
"""


def test_the_tool_is_given_the_open_files_alone_and_asked_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tool, log = tmp_path / "tool", tmp_path / "calls"
    tool.write_text(TOOL.format(python=sys.executable, log=str(log)))
    tool.chmod(0o755)
    monkeypatch.setattr(answers, "TOOL", tool)
    assert not answers.is_answered(7, tmp_path, "abc")
    cost = answers.answer(7, tmp_path, "abc")
    assert (cost.exit, cost.said, cost.code) == (4, "a word on standard error", "abc")
    assert cost.cpu_seconds >= 0.0
    assert cost.memory_mb > 1.0
    assert json.loads((tmp_path / "answers" / "v007.json").read_text()) == {"verdict": "no_mismatch"}
    called = log.read_text()
    assert "sealed" not in called
    assert called.count(str(tmp_path / "open" / "v007")) == 3
    assert answers.is_answered(7, tmp_path, "abc")
    assert not answers.is_answered(7, tmp_path, "changed")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system tells only what it counts itself")
def test_memory_is_that_of_the_tool_and_not_of_who_called_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = np.ones(40_000_000)
    tool, seen = tmp_path / "tool", tmp_path / "seen"
    # it holds the memory until that has been looked at
    tool.write_text(
        f"#!{sys.executable}\nimport pathlib, time\nheld = bytearray(60_000_000)\n"
        f"while not pathlib.Path({str(seen)!r}).exists():\n    time.sleep(0.01)\n"
    )
    tool.chmod(0o755)
    look = answers.peak

    def peak(process: int) -> float:
        memory = look(process)
        if memory > 60.0:
            seen.touch()
        return memory

    monkeypatch.setattr(answers, "peak", peak)
    monkeypatch.setattr(answers, "TOOL", tool)
    assert 60.0 < answers.answer(1, tmp_path, "abc").memory_mb < 1e-6 * held.nbytes / 2


def test_a_tool_that_does_not_end_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tool = tmp_path / "tool"
    tool.write_text(f"#!{sys.executable}\nimport time\ntime.sleep(60)\n")
    tool.chmod(0o755)
    monkeypatch.setattr(answers, "TOOL", tool)
    monkeypatch.setattr(answers, "TIMEOUT", 0.2)
    assert answers.answer(1, tmp_path, "abc").exit is None
