"""Pages of the manual that say what the package says: effects, command line, interface, thresholds."""

from __future__ import annotations

import inspect
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import pmsm_rs
from pmsm_rs import DiagnosisOptions, effects, plot
from pmsm_rs.cli import cli
from pmsm_rs.experiments.outcome import Certainty, Outcome
from pmsm_rs.live.window import Drift
from pmsm_rs.messages import entries
from pmsm_rs.quantities.canonical import CANONICAL, LOGS
from pmsm_rs.quantities.units import UNITS
from pmsm_rs.results.estimates import Estimate
from pmsm_rs.results.findings import Candidate, Location
from pmsm_rs.results.unmodelled import Term, Unmodelled
from pmsm_rs.results.words import EQUATIONS, number, unit
from pmsm_rs.view.notebook import Page

SOURCES = Path(__file__).parents[1] / "crates" / "pmsm-core" / "src"


def write_pages(docs: Path) -> None:
    """Writes all generated pages below `docs/generated`; pages that say what they did keep their time."""
    catalogue = effects()
    pages = {f"effects/{entry['id']}.md": effect_page(entry) for entry in catalogue}
    pages["effects/index.md"] = effect_index(catalogue)
    pages["command_line.md"] = command_line()
    pages["api.rst"] = interface()
    pages["columns.md"] = columns()
    pages["thresholds.md"] = thresholds()
    pages["errors.md"] = messages("error")
    pages["findings.md"] = messages("finding")
    root = docs / "generated"
    for old in [path for path in root.rglob("*") if path.is_file()]:
        if old.relative_to(root).as_posix() not in pages:
            old.unlink()
    for name, text in pages.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def effect_page(entry: dict[str, Any]) -> str:
    """What the catalogue knows of an effect."""
    alike = [f"[{name}]({name}.md)" for name in entry["look_alikes"]]
    rows = [
        [
            f"`{p['name']}`",
            p["meaning"],
            f"{number(p['low'])} … {number(p['high'])}",
            number(p["typical"]),
            unit(p["unit"]) or "1",
        ]
        for p in entry["parameters"]
    ]
    parameters = table(["parameter", "meaning", "range", "typical", "unit"], rows)
    results = [[f"`{r['name']}`", r["meaning"], unit(r["unit"]) or "1"] for r in entry["derived"]]
    derived = (
        f"\n## Answers also give\n\n{table(['result', 'meaning', 'unit'], results)}\n" if results else ""
    )
    return f"""# {entry["title"]}

`{entry["id"]}`

{entry["sentence"]}

```text
{entry["equation"]}
```

Acts in
: {EQUATIONS.get(entry["acts_in"], entry["acts_in"])}

Shows as
: {entry["fingerprint"]}

Resembles
: {", ".join(alike) or "nothing else in the catalogue"}

Source
: {entry["source"]}

## Parameters

{parameters}

Ranges and typical values are those for one servo motor; in a diagnosis they follow from the machine and
the recording.
{derived}"""


def effect_index(catalogue: list[dict[str, Any]]) -> str:
    """All effects by the equation in which they act."""
    parts = [
        "# Effects\n\nThe diagnosis names these effects and no others. The pages are made from the\n"
        "catalogue of the package, as is `pmsm-rs effects NAME`.\n"
    ]
    for site in dict.fromkeys(entry["acts_in"] for entry in catalogue):
        rows = [
            [f"[{entry['title']}]({entry['id']}.md)", entry["sentence"]]
            for entry in catalogue
            if entry["acts_in"] == site
        ]
        heading = EQUATIONS.get(site, site)
        parts.append(
            f"## {heading[0].upper()}{heading[1:]}\n\n{table(['effect', 'what was left out'], rows)}\n"
        )
    names = "\n".join(entry["id"] for entry in catalogue)
    parts.append(f"```{{toctree}}\n:hidden:\n\n{names}\n```\n")
    return "\n".join(parts)


def command_line() -> str:
    """The help of every command."""
    parts = ["# Command line\n", help_of(cli, "pmsm-rs", None)]
    context = click.Context(cli, info_name="pmsm-rs", max_content_width=100)
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        assert command is not None, "click lists only what it has"
        parts.append(f"## {name}\n\n{help_of(command, name, context)}")
    return "\n".join(parts)


def help_of(command: click.Command, name: str, parent: click.Context | None) -> str:
    """The help of one command as a block."""
    context = click.Context(command, info_name=name, parent=parent, max_content_width=100, terminal_width=100)
    return f"```text\n{command.get_help(context)}\n```\n"


def interface() -> str:
    """Every public name with its documentation."""
    parts = ["Python\n======\n\n.. currentmodule:: pmsm_rs\n"]
    kinds: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors": []}
    for name in pmsm_rs.__all__:
        value = getattr(pmsm_rs, name)
        if inspect.isclass(value):
            # Fields are described by the class itself; listing each would only repeat the types.
            error = issubclass(value, Exception)
            members = (
                "" if error else "   :members:\n   :undoc-members:\n   :inherited-members: tuple, Sequence\n"
            )
            line = f".. autoclass:: {name}\n{members}"
            kinds["Errors" if error else "Classes"].append(line)
        elif callable(value):
            kinds["Functions"].append(f".. autofunction:: {name}\n")
    # They are met in answers and never made by hand: their names are those of their modules.
    kinds["Parts of answers"] = [
        f".. autoclass:: {part.__module__}.{part.__qualname__}\n   :members:\n   :undoc-members:\n"
        for part in (Estimate, Location, Candidate, Unmodelled, Term, Drift, Page, Outcome, Certainty)
    ]
    for heading, lines in kinds.items():
        parts.append(f"{heading}\n{'-' * len(heading)}\n\n" + "\n".join(lines))
    drawn = [
        name
        for name, value in vars(plot).items()
        if inspect.isfunction(value) and value.__module__ == plot.__name__ and name[0] != "_"
    ]
    lines = "\n".join(f".. autofunction:: {name}\n" for name in drawn)
    parts.append(
        "Plots\n-----\n\n.. automodule:: pmsm_rs.plot\n   :no-members:\n\n"
        f".. currentmodule:: pmsm_rs.plot\n\n{lines}"
    )
    return "\n".join(parts)


def messages(kind: str) -> str:
    """The errors or the findings by group; each code is an anchor of the page that includes this."""
    groups: dict[str, list[list[str]]] = {}
    for entry in entries().values():
        if entry.kind == kind:
            says = "<br>".join(entry.says or (entry.title,))
            anchor = f'<a id="{entry.code}" href="#{entry.code}">{entry.code}</a>'
            groups.setdefault(entry.group, []).append([anchor, says, entry.cause, entry.cure])
    head = ["code", kind, "cause", "cure"]
    return "\n".join(f"### {title}\n\n{table(head, rows)}\n" for title, rows in groups.items())


def columns() -> str:
    """The canonical columns, units, and the logs whose names are known."""
    rows = [
        [f"`{name}`", q.unit, q.meaning, ", ".join(f"`{u}`" for u in UNITS[q.dimension])]
        for name, q in CANONICAL.items()
    ]
    parts = [
        "# Columns and units\n\nA file may use these names, or any others that `[columns]` of the\n"
        "machine file maps to them.\n",
        table(["column", "unit", "meaning", "units that are understood"], rows),
        "\n## Logs that are recognised\n",
    ]
    for log, (_, known) in LOGS.items():
        parts.append(f"\n### {log}\n")
        parts.append(
            table(
                ["in the log", "column", "unit"],
                [[f"`{a}`", f"`{b}`", c or "to be told"] for a, (b, c) in known.items()],
            )
        )
    return "\n".join(parts) + "\n"


def thresholds() -> str:
    """The constants on which verdicts rest: their values, and what the source of the core says of each."""
    text = (SOURCES / "diagnose" / "options.rs").read_text(encoding="utf-8")
    meanings = re.findall(r"((?:^    /// [^\n]*\n)+)^    pub (\w+): \w+,", text, re.MULTILINE)
    values = asdict(DiagnosisOptions())
    rows = [
        [f"`{name}`", f"{values[name]:g}", " ".join(doc.replace("///", " ").split())]
        for doc, name in meanings
    ]
    return (
        "# Options of the diagnosis\n\n"
        "The fields of `pmsm_rs.DiagnosisOptions`; every answer lists them under `options`.\n\n"
        + table(["option", "value", "meaning"], rows)
        + "\n"
    )
