"""Looks for long sentences and banned words in the pages, the docstrings and the messages of the package.

    make words

It reads Markdown pages, Python docstrings and string literals, the table of messages, and Rust string
literals. Code blocks, inline code, link targets and formulas do not count. It prints each finding with file
and line, and exits with 1 if there is any. `docs/glossary.md` says which words to use instead.
"""

from __future__ import annotations

import argparse
import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
LONGEST: Final = 30
"""Most words of a sentence."""
FEWEST: Final = 4
"""Words from which a string literal is a message."""
PAGES: Final = (
    "README.md",
    "SECURITY.md",
    "CONTRIBUTING.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "docs/*.md",
    "proof/README.md",
    "benches/README.md",
)
PYTHON: Final = ("python/pmsm_rs/**/*.py", "docs/*.py", "docs/examples/*.py")
NO_PROSE: Final = ("vocabulary.py",)
"""Python files whose strings are lists of words."""
MESSAGES: Final = ("python/pmsm_rs/messages.toml",)
"""Tables whose texts are messages."""
RUST: Final = ("crates/*/src/**/*.rs",)
DOCUMENTED: Final = ("options.rs",)
"""Rust files whose documentation becomes a page of the manual."""
OTHER_SENSES: Final = r"(?! (?:the|a|an|it|its|them|open|unsaid|to say|unexplained|X as)\b)"
"""Words behind `leave` with which it has its usual sense."""
BANNED: Final[dict[str, str]] = {
    rf"leaves?\b{OTHER_SENSES}(?![^.,;:]{{0,60}}\bout\b)": "has a residual of, remains",
    r"left over": "residual",
    r"(?:stands?|standing|stood) (?:in )?for": "is, means, replaces",
    r"bends?|bent": "change",
    r"ow(?:e|es|ed|ing) (?:its|to|the)": "because of",
    r"judg(?:e|es|ed|ing)": "check, compare, validate",
    r"mend(?:s|ed|ing)?": "correct",
    r"bare machine": "dq-model",
    r"foresee[sn]?|foresaw": "predict",
    r"wild (?:row|point|sample)s?": "outlier",
    r"earn(?:s|ed)?": "explain, have enough evidence",
    r"accus(?:e|es|ed)": "name",
    r"all-clear": "no_mismatch",
    r"makes? nonsense": "contradict",
    r"news": "result",
    r"goes? before": "takes precedence over",
    r"persuade[sd]?": "change",
    r"l(?:ays?|aid) (?:it|them|at)": "assign",
}
"""Patterns of words that the manual does not use, with what it says instead."""
ABBREVIATION: Final = re.compile(
    r"\b(?:e\.g|i\.e|etc|vs|cf|eqs?|Figs?|No|approx|ed|pp|vol|Int|Proc|Trans|Ann|Statist|J|Res|al|resp|max|min)\.$"
)


@dataclass(frozen=True)
class Passage:
    """A piece of prose: where it begins, and its text without code."""

    file: str
    line: int
    text: str


@dataclass(frozen=True)
class Finding:
    """What is wrong where."""

    file: str
    line: int
    message: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.message}"


def plain(text: str) -> str:
    """Prose without link targets and marks; a piece of code or a formula counts as one word."""
    text = re.sub(r"<!--.*?-->", " ", text, flags=re.DOTALL)
    text = re.sub(r"``.+?``|`[^`]+`|\$[^$\n]+\$", "X", text)
    text = re.sub(r"!?\[([^\]]*)\](?:\([^)]*\)|\[[^\]]*\])?", r"\1", text)
    text = re.sub(r"https?://\S+", "X", text)
    return re.sub(r"(?<!\w)[*_]{1,3}|[*_]{1,3}(?!\w)", "", text)


def sentences(text: str) -> list[str]:
    """The sentences of a paragraph."""
    out, begin = [], 0
    for end in re.finditer(r"[.!?][)\"'”’]*(?=\s+(?:[^a-zäöü\s]|[a-z]+_\w)|\s*$)", text):
        part = text[begin : end.end()]
        if not ABBREVIATION.search(part):
            out.append(part.strip())
            begin = end.end()
    rest = text[begin:].strip()
    return [*out, rest] if rest else out


def words(sentence: str) -> int:
    """Words of a sentence: runs without blanks that hold a letter or a digit and are no name of a program."""
    return sum("_" not in word and any(c.isalnum() for c in word) for word in sentence.split())


ENTRY: Final = re.compile(r"[*]{0,2}\w[\w, *]* : \S")
"""The line of a docstring that names a parameter and its type."""


def blocks(text: str, file: str, first: int = 1) -> Iterator[Passage]:
    """Paragraphs, headings, list items and table cells of a text that begins at line `first`."""
    gathered: list[str] = []
    begin, fence, listed, blank = first, "", False, True

    def flush() -> Iterator[Passage]:
        if gathered:
            yield Passage(file, begin, plain(" ".join(gathered)))
            gathered.clear()

    for at, line in enumerate(text.splitlines(), first):
        bare = line.strip()
        mark = re.match(r"(`{3,}|~{3,}|:{3,}|\$\$)", bare)
        if fence:
            fence = "" if bare.startswith(fence) and (bare == fence or fence == "$$") else fence
            continue
        if mark:
            yield from flush()
            # A directive in colons holds prose; a formula may end on its own line.
            if mark[1][0] != ":" and not (mark[1] == "$$" and bare.count("$$") > 1):
                fence = mark[1]
            continue
        item = re.match(r"\s*(?:[-*+] |\d+\. |: )", line)
        if not bare:
            yield from flush()
            blank = True
            continue
        code = line.startswith("    ") and blank and not listed and not gathered
        if code or bare.startswith((">>> ", "... ")):
            continue
        if ENTRY.match(bare):
            yield from flush()
            continue
        if bare.startswith("|") or set(bare) <= set("=-~^+| :"):
            yield from flush()
            cells = [] if set(bare) <= set("=-~^+| :") else re.split(r"(?<!\\)\|", bare.strip("|"))
            yield from (Passage(file, at, plain(cell.strip())) for cell in cells if cell.strip())
        elif bare.startswith(("#", "<!--")):
            yield from flush()
            if bare.startswith("#"):
                yield Passage(file, at, plain(bare.lstrip("# ")))
        else:
            if item:
                yield from flush()
                listed, bare = True, bare[len(item[0].strip()) :].strip()
            elif not line.startswith(" "):
                listed = False
            if not gathered:
                begin = at
            gathered.append(bare.removeprefix("> "))
        blank = False
    yield from flush()


def page(path: Path) -> Iterator[Passage]:
    """The prose of a Markdown page."""
    yield from blocks(path.read_text(encoding="utf-8"), name(path))


def name(path: Path) -> str:
    """Path below the root of the repository."""
    return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else str(path)


def python(path: Path) -> Iterator[Passage]:
    """Docstrings and messages of a Python file, and the text cells of an example of the gallery."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    prose: set[int] = set()
    inner: set[int] = set()
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        for child in body if isinstance(body, list) else []:
            match child:
                case ast.Expr(value=ast.Constant(value=str(docstring)) as value):
                    prose.add(id(value))
                    yield from blocks(clean(docstring), name(path), value.lineno)
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            inner.update(id(part) for part in ast.walk(node) if part is not node)
    for node in ast.walk(tree):
        if id(node) in prose or id(node) in inner:
            continue
        message = literal(node)
        if message is not None and is_message(message) and path.name not in NO_PROSE:
            yield from blocks(clean(message), name(path), getattr(node, "lineno", 1))
    for cell in re.finditer(r"^# %%\n((?:# .*\n|#\n)+)", text, re.MULTILINE):
        line = text[: cell.start(1)].count("\n") + 1
        yield from blocks(re.sub(r"^# ?", "", cell[1], flags=re.MULTILINE), name(path), line)


def literal(node: ast.AST) -> str | None:
    """The text of a string, with `X` for each value of an f-string."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        parts = (str(p.value) if isinstance(p, ast.Constant) else "X" for p in node.values)
        return "".join(parts)
    return None


def clean(text: str) -> str:
    """A docstring without the indentation of its later lines."""
    first, *others = text.split("\n")
    indents = [len(line) - len(line.lstrip()) for line in others if line.strip()]
    least = min(indents, default=0)
    return "\n".join([first.strip(), *(line[least:] for line in others)])


def is_message(text: str) -> bool:
    """Whether a string literal is prose that a user reads, and no pattern, table, markup or program text."""
    if words(text) < FEWEST or len(re.findall(r"[A-Za-z]{2,}", text)) < FEWEST:
        return False
    return not re.search(r"\\[sdwb]|\(\?|<\w+[ >]|[{};]\n|^\s*(?:import|from) |=\s*\[", text)


RUST_TOKEN: Final = re.compile(
    r"(?P<doc>//[/!][^\n]*)|(?P<comment>//[^\n]*|/\*.*?\*/)"
    r"|(?P<raw>r(?P<hash>#*)\".*?\"(?P=hash))|(?P<string>b?\"(?:\\.|[^\"\\])*\")|(?P<char>'(?:\\.[^']*|[^'\\])')",
    re.DOTALL,
)


TESTS: Final = re.compile(r"^#\[cfg\(test\)\]\n(?:#.*\n)*(?:pub )?mod \w+ \{", re.MULTILINE)


def rust(path: Path) -> Iterator[Passage]:
    """Messages of a Rust file without its tests, and its documentation where that becomes a page."""
    text = TESTS.split(path.read_text(encoding="utf-8"))[0]
    docs: list[str] = []
    begin = last = 0
    for token in RUST_TOKEN.finditer(text):
        line = text[: token.start()].count("\n") + 1
        if token["doc"] and path.name in DOCUMENTED:
            if docs and line != last + 1:
                yield from blocks("\n".join(docs), name(path), begin)
                docs = []
            begin = begin if docs else line
            docs.append(re.sub(r"^//[/!] ?", "", token["doc"]))
            last = line
        elif token["string"] or token["raw"]:
            value = token["string"] or token["raw"]
            value = re.sub(r"\\\n\s*", "", value[value.index('"') + 1 : value.rindex('"')])
            value = re.sub(r"\{[^{}]*\}", "X", value.replace("\\n", "\n").replace('\\"', '"'))
            if is_message(value):
                yield from blocks(value, name(path), line)
    if docs:
        yield from blocks("\n".join(docs), name(path), begin)


def messages(path: Path) -> Iterator[Passage]:
    """Causes and cures of a table of messages."""
    lines = path.read_text(encoding="utf-8").splitlines()
    for code, entry in tomllib.loads("\n".join(lines)).items():
        for text in (entry.get("cause"), entry.get("cure")) if isinstance(entry, dict) else ():
            if text is not None:
                yield from blocks(text, name(path), lines.index(f"[{code}]") + 1)


def passages() -> Iterator[Passage]:
    """All prose of the repository that a user may read."""
    for patterns, read in ((PAGES, page), (PYTHON, python), (MESSAGES, messages), (RUST, rust)):
        for path in sorted({path for pattern in patterns for path in ROOT.glob(pattern)}):
            yield from read(path)


def check(passage: Passage) -> Iterator[Finding]:
    """Long sentences and banned words of a passage."""
    for sentence in sentences(passage.text):
        if (count := words(sentence)) > LONGEST:
            yield Finding(passage.file, passage.line, f"{count} words: {sentence}")
    for pattern, instead in BANNED.items():
        for found in re.finditer(rf"\b(?:{pattern})(?!\w)", passage.text, re.IGNORECASE):
            around = passage.text[max(0, found.start() - 30) : found.end() + 30]
            yield Finding(passage.file, passage.line, f"“{found[0]}” (say: {instead}): …{around}…")


def main() -> int:
    """Prints the findings and their number."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.parse_args()
    findings = [finding for passage in passages() for finding in check(passage)]
    for finding in findings:
        print(finding)
    print(f"{len(findings)} findings", file=sys.stderr)
    return int(bool(findings))


if __name__ == "__main__":
    sys.exit(main())
