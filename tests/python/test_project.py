"""What keeps the project going: workflows, templates, the changelog of a release, the maps for newcomers."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from conftest import ROOT
from pmsm_rs.cli import cli

yaml: Any = pytest.importorskip("yaml")

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
TEMPLATES = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
GUIDES = ["CONTRIBUTING.md", "ARCHITECTURE.md", ".github/PULL_REQUEST_TEMPLATE.md"]


def parsed(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_asks_for_little_and_ends(path: Path) -> None:
    workflow = parsed(path)
    assert workflow["permissions"] == {"contents": "read"}
    # YAML 1.1 takes the key `on` for a truth value.
    assert workflow[True]
    for name, job in workflow["jobs"].items():
        if "uses" in job:
            assert (ROOT / job["uses"]).is_file()
            continue
        assert job["timeout-minutes"] <= 120, name
        assert job["runs-on"]
        for step in job["steps"]:
            assert ("uses" in step) != ("run" in step), name
            assert "@" in step.get("uses", "@"), "an action has a version"
    for name, job in workflow["jobs"].items():
        needs = job.get("needs", [])
        assert {*([needs] if isinstance(needs, str) else needs)} <= {*workflow["jobs"]}, name


def test_workflows_call_what_exists() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    for path in WORKFLOWS:
        text = path.read_text(encoding="utf-8")
        assert set(re.findall(r"\bmake ([a-z-]+)", re.sub(r"#.*", "", text))) <= targets
        for script in re.findall(r"python (\.ci/\S+)", text):
            assert (ROOT / script).is_file()
        for command in re.findall(r"^ *(?:- run: )?pmsm-rs ([a-z]+)", text, re.M):
            assert command in cli.commands


def test_tests_and_wheels_cover_all_systems() -> None:
    by_name = {path.stem: parsed(path)["jobs"] for path in WORKFLOWS}
    tested = by_name["ci"]["python"]["strategy"]["matrix"]["runner"]
    built = [entry["runner"] for entry in by_name["wheels"]["wheel"]["strategy"]["matrix"]["include"]]
    for system in (r"ubuntu-[\d.]+$", r"ubuntu-[\d.]+-arm$", r"macos-\d+$", r"windows-\d+$"):
        assert any(re.match(system, runner) for runner in tested), system
        assert any(re.match(system, runner) for runner in built), system
    oldest = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    assert oldest.removeprefix(">=") in by_name["ci"]["python"]["strategy"]["matrix"]["python"]


def test_files_of_a_job_come_from_a_job_before_it() -> None:
    release = parsed(ROOT / ".github" / "workflows" / "release.yml")["jobs"]
    wheels = parsed(ROOT / ".github" / "workflows" / "wheels.yml")["jobs"]
    made = [
        step["with"]["name"]
        for job in [*release.values(), *wheels.values()]
        for step in job.get("steps", ())
        if step.get("uses", "").startswith("actions/upload-artifact")
    ]
    matrix = wheels["wheel"]["strategy"]["matrix"]["include"]
    names = {f"wheels-{entry['system']}-{entry['target']}" for entry in matrix} | {*made}
    for job in release.values():
        for step in job.get("steps", ()):
            if step.get("uses", "").startswith("actions/download-artifact"):
                wanted = step["with"].get("name") or step["with"]["pattern"].replace("*", "sdist")
                assert wanted in names


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_a_template_asks_in_known_kinds(path: Path) -> None:
    template = parsed(path)
    if path.stem == "config":
        assert all(link["url"].startswith("https://") for link in template["contact_links"])
        return
    assert template["name"]
    assert template["description"]
    kinds = {entry["type"] for entry in template["body"]}
    assert kinds <= {"markdown", "textarea", "input", "dropdown", "checkboxes"}
    ids = [entry["id"] for entry in template["body"] if "id" in entry]
    assert len(ids) == len(set(ids))
    for command in re.findall(r"pmsm-rs ([a-z]+)", path.read_text(encoding="utf-8")):
        assert command in cli.commands


def test_the_three_templates() -> None:
    assert {path.stem for path in TEMPLATES} == {"bug", "config", "question", "wrong_diagnosis"}


def test_hooks_have_versions() -> None:
    hooks = parsed(ROOT / ".pre-commit-config.yaml")["repos"]
    assert {hook["id"] for repo in hooks for hook in repo["hooks"]} >= {"ruff-check", "rustfmt", "mypy"}
    assert all("rev" in repo or repo["repo"] == "local" for repo in hooks)


@pytest.mark.parametrize("name", GUIDES)
def test_guides_name_what_exists(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    for link in re.findall(r"\]\((?!https?:)([^)#]+)", text):
        assert (ROOT / link).exists(), link
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    assert set(re.findall(r"`make ([a-z-]+)", text)) <= targets
    for command in re.findall(r"pmsm-rs ([a-z]+) ", text):
        assert command in cli.commands


def test_the_map_names_modules_that_exist() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    core, package = text.split("## Layers of the package")
    core = core.split("## Layers of the core")[1].split("`crates/pmsm-py`")[0]
    package = package.split("## Where a thing lives")[0]
    for part, folder, ending in (
        (core, "crates/pmsm-core/src", ".rs"),
        (package, "python/pmsm_rs", ".py"),
    ):
        for row in re.findall(r"^\| [^|`]+\|(.*)\|$", part, re.M):
            for name in re.findall(r"`([a-z_/]+?)/?`", row):
                places = [
                    ROOT / folder / f"{name}{ending}",
                    ROOT / folder / name,
                    ROOT / folder / "cli" / f"{name}.py",
                    ROOT / folder / f"{name}.pyi",
                ]
                assert any(place.exists() for place in places), name
    for path in re.findall(r"`(python/[a-z_/]+\.py)`", text):
        assert (ROOT / path).exists(), path
    for path in re.findall(r"(?:core: |<br/>)(diagnose/[a-z_]+)", text):
        assert (ROOT / "crates/pmsm-core/src" / f"{path}.rs").exists(), path


@pytest.fixture(scope="module")
def changelog() -> ModuleType:
    spec = importlib.util.spec_from_file_location("changelog", ROOT / ".ci" / "changelog.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def released(root: Path, *, version: str = "1.2.3", heading: str = "1.2.3 (2026-11-28)") -> Path:
    (root / "Cargo.toml").write_text(
        f'[workspace.package]\nversion = "{version}"\n'
        f'[workspace.dependencies]\npmsm-core = {{ path = "x", version = "{version}" }}\n'
    )
    (root / "CITATION.cff").write_text(f"cff-version: 1.2.0\nversion: {version}\n")
    (root / "CHANGELOG.md").write_text(
        f"# Changelog\n\n## {heading}\n\n- new\n\n## 1.2.2 (2026-01-01)\n\n- old\n"
    )
    return root


def test_a_release_has_its_section_of_the_changelog(changelog: ModuleType, tmp_path: Path) -> None:
    root = released(tmp_path)
    assert changelog.problems("v1.2.3", root) == []
    assert changelog.section("1.2.3", root)[1] == "- new"
    assert changelog.section("1.2.2", root)[1] == "- old"


@pytest.mark.parametrize(
    ("tag", "changed", "words"),
    [
        ("v1.2.4", {}, "Cargo.toml says 1.2.3"),
        ("v1.2.4", {}, "CITATION.cff says 1.2.3"),
        ("1.2.3", {}, "not of the form"),
        ("v1.2.3", {"heading": "1.2.3 (unreleased)"}, "unreleased"),
        ("v1.2.3", {"heading": "1.2.30 (2026-11-28)"}, "no section"),
    ],
)
def test_what_keeps_a_release_back(
    tag: str, changed: dict[str, str], words: str, changelog: ModuleType, tmp_path: Path
) -> None:
    assert any(words in line for line in changelog.problems(tag, released(tmp_path, **changed)))


def test_the_version_of_the_project_is_one(changelog: ModuleType) -> None:
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text())
    tag = f"v{cargo['workspace']['package']['version']}"
    assert [line for line in changelog.problems(tag, ROOT) if "unreleased" not in line] == []
