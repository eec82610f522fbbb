"""`make soak` finds the property tests among the others, or it would draw nothing."""

from __future__ import annotations

import runpy

from conftest import ROOT

PROPERTY = runpy.run_path(str(ROOT / ".ci" / "soak.py"))["PROPERTY"]
SOURCE = """
    #[test]
    fn a_plain_one() {}

    #[test]
    #[should_panic(expected = "rows")]
    fn a_plain_one_that_panics() {}

    proptest! {
        #[test]
        fn one_line(x in 0..5usize) {}

        #[test]
        /// What it promises.
        #[cfg_attr(miri, ignore)]
        fn several_lines(
            x in 0..5usize, increments: bool,
        ) {}
    }
"""


def test_tests_with_arguments_are_property_tests() -> None:
    assert PROPERTY.findall(SOURCE) == ["one_line", "several_lines"]


def test_every_file_with_property_tests_has_some() -> None:
    files = [*(ROOT / "crates").rglob("*.rs"), *(ROOT / "tests").rglob("*.rs")]
    texts = {path: path.read_text(encoding="utf-8") for path in files}
    holding = [path for path, text in texts.items() if "proptest! {" in text]
    assert holding
    assert [path for path in holding if not PROPERTY.findall(texts[path])] == []
