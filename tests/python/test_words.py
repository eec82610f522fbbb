"""The pages, messages and docstrings keep to short sentences and to the words of the glossary."""

from __future__ import annotations

import sys

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "docs"))

import words


def findings(text: str) -> list[str]:
    """What is found in a Markdown text."""
    found = (finding for passage in words.blocks(text, "page.md") for finding in words.check(passage))
    return [finding.message for finding in found]


LONG = " ".join(["word"] * 31)


def test_nothing_is_found_in_the_repository() -> None:
    found = [str(finding) for passage in words.passages() for finding in words.check(passage)]
    assert not found, "\n".join(found)


def test_all_kinds_of_prose_are_read() -> None:
    files = {passage.file for passage in words.passages()}
    assert {
        "README.md",
        "docs/glossary.md",
        "python/pmsm_rs/run.py",
        "docs/examples/01_diagnose.py",
        "crates/pmsm-core/src/diagnose/locate.rs",
    } <= files


@pytest.mark.parametrize("text", [f"{LONG}.", f"- {LONG}\n", f"| a | {LONG} |\n|---|---|\n", f"# {LONG}"])
def test_a_long_sentence_is_found_wherever_it_stands(text: str) -> None:
    assert [message.split(":")[0] for message in findings(text)] == ["31 words"]


@pytest.mark.parametrize(
    "text",
    [
        f"```text\n{LONG}\n```\n",
        f"Before.\n\n    {LONG}\n",
        f"`{LONG}`",
        f"$$\n{LONG}\n$$\n",
        f"[one](page.md#{LONG.replace(' ', '-')})",
        f"<!-- {LONG} -->",
        "Half a sentence of fifteen words, which goes on and on until it ends here. " * 3,
        f"- {' '.join(['word'] * 20)}\n- {' '.join(['word'] * 20)}\n",
        "See Fig. 3 of the paper, e.g. that of Liu et al. in 2008.",
    ],
)
def test_code_formulas_and_targets_of_links_are_no_sentences(text: str) -> None:
    assert findings(text) == []


def test_a_banned_word_is_found_in_its_private_sense_alone() -> None:
    assert findings("The equation leaves 3 times the noise.")
    assert findings("A run that only judges.")
    assert findings("What the model leaves.")
    assert not findings("The model leaves out dead time. Leave the field empty. It leaves the file as is.")
    assert not findings("The code `judge` is a name of a program.")


def test_a_message_of_a_program_is_read_with_its_values(tmp_path: object) -> None:
    from pathlib import Path

    path = Path(str(tmp_path), "module.py")
    path.write_text(f'def f(x):\n    raise ValueError(f"{{x}} {LONG[:60]} "\n    "{LONG[60:]}.")\n')
    assert [finding.line for passage in words.python(path) for finding in words.check(passage)] == [2]
    path = Path(str(tmp_path), "lib.rs")
    path.write_text(
        f'// "{LONG}"\nfn f() {{ g("{LONG[:60]} \\\n  {LONG[60:]}") }}\n'
        f'#[cfg(test)]\nmod tests {{ const S: &str = "{LONG}"; }}\n'
    )
    assert [finding.line for passage in words.rust(path) for finding in words.check(passage)] == [2]
