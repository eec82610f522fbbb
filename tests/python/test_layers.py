"""The package has one way down: no module needs, be it for a type or within a function, one that needs it."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pmsm_rs as pm
import pytest


def needs(root: Path) -> dict[str, set[str]]:
    """Per module of the package those that it imports, anywhere in it; names as `cli.main`."""
    files = {
        ".".join(path.relative_to(root).with_suffix("").parts): path
        for path in root.rglob("*.py*")
        if path.suffix in {".py", ".pyi"}
    }
    out = {}
    for name, path in files.items():
        within = name.split(".")[:-1]
        found: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.ImportFrom) or not node.level:
                continue
            base = within[: len(within) + 1 - node.level] + (node.module.split(".") if node.module else [])
            for entry in node.names:
                # `from .a import b` means the module a.b, or what a holds, or what the package a holds.
                homes = ([*base, entry.name], base, [*base, "__init__"])
                found.update([home for home in map(".".join, homes) if home in files][:1])
        out[name] = found - {name}
    return out


def test_no_module_needs_one_that_needs_it() -> None:
    graph = needs(Path(pm.__file__).parent)
    assert {"results.findings", "results.words"} <= graph["view.summary"]
    assert "fleet.recordings" in graph["__init__"]
    order = list(TopologicalSorter(graph).static_order())
    assert order.index("results.findings") < order.index("view.report") < order.index("__init__")


def test_no_package_needs_one_that_needs_it() -> None:
    packages: dict[str, set[str]] = {}
    for module, needed in needs(Path(pm.__file__).parent).items():
        home = module.split(".")[0]
        packages.setdefault(home, set()).update({name.split(".")[0] for name in needed} - {home})
    order = list(TopologicalSorter(packages).static_order())
    assert order.index("quantities") < order.index("io") < order.index("view") < order.index("cli")


def test_an_import_within_a_function_counts(tmp_path: Path) -> None:
    (tmp_path / "low.py").write_text("def f():\n    from .sub.high import g\n    return g\n")
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "high.py").write_text("from .. import low\n")
    graph = needs(tmp_path)
    assert graph == {"low": {"sub.high"}, "sub.high": {"low"}}
    with pytest.raises(CycleError):
        TopologicalSorter(graph).prepare()
