"""What the package is made of: licences that are allowed, requirements that are audited, fuzz targets."""

from __future__ import annotations

import importlib.util
import tomllib
from pathlib import Path
from types import ModuleType

import pytest
from conftest import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("expression", "allowed"),
    [
        ("MIT", True),
        ("MIT/Apache-2.0", True),
        ("Unlicense OR MIT", True),
        ("(MIT OR Apache-2.0) AND Zlib", True),
        ("(MIT OR Apache-2.0) AND GPL-3.0-only", False),
        ("GPL-3.0-only", False),
        ("Apache-2.0 WITH LLVM-exception", False),
        ("none told", False),
        ("", False),
    ],
)
def test_a_licence_is_allowed_where_a_way_through_it_is(expression: str, allowed: bool) -> None:
    pytest.importorskip("packaging")
    assert script("licences").is_allowed(expression, frozenset({"MIT", "Apache-2.0", "Zlib"})) is allowed


def test_licences_of_python_packages_are_read_from_any_form_of_metadata() -> None:
    pytest.importorskip("packaging")
    told = dict(script("licences").packages())
    assert {name.split()[0] for name in told} >= {"numpy", "click", "matplotlib", "jinja2"}
    assert all(told.values())


def test_all_that_people_install_is_audited() -> None:
    audited = script("requirements").requirements()
    extras = PROJECT["optional-dependencies"]
    formats = extras["formats"][0].removeprefix("pmsm-rs[").removesuffix("]").split(",")
    assert {*audited} == {*PROJECT["dependencies"], *(need for name in formats for need in extras[name])}


def test_the_names_of_crates_that_are_refused_are_strings_and_licences_are_given() -> None:
    rules = tomllib.loads((ROOT / "deny.toml").read_text())
    assert PROJECT["license"].split(" OR ")[0] in rules["licenses"]["allow"]
    assert rules["sources"]["unknown-registry"] == rules["sources"]["unknown-git"] == "deny"


def test_fuzz_targets_are_files_and_stand_in_a_workspace_of_their_own() -> None:
    manifest = tomllib.loads((ROOT / "fuzz" / "Cargo.toml").read_text())
    assert "workspace" in manifest
    named = {target["path"] for target in manifest["bin"]}
    found = {path.relative_to(ROOT / "fuzz").as_posix() for path in (ROOT / "fuzz").glob("fuzz_targets/*.rs")}
    assert named == found
    members = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["members"]
    assert not any(Path(member).parts[0] == "fuzz" for member in members)
