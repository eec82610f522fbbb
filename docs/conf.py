"""The manual: written pages, pages generated from the package, and examples that are run by the build."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))

from generate import write_pages  # noqa: E402
from pmsm_rs import __version__  # noqa: E402

project = "pmsm-rs"
author = "the pmsm-rs developers"
copyright = author
release = version = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = [
    "_build",
    "examples",
    "gallery/*.ipynb",
    "gallery/*.py",
    "proof/*",
    "data/*",
    "generated/errors.md",
    "generated/findings.md",
]
default_role = "code"
nitpicky = False

html_theme = "furo"
html_title = f"pmsm-rs {release}"
html_show_copyright = False
html_static_path = ["static"]
html_css_files = ["manual.css"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4

autodoc_typehints = "description"
napoleon_google_docstring = False
# Fields of a result as a list of its own class; as attributes they would be described twice.
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}

sphinx_gallery_conf = {
    "examples_dirs": ["examples"],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"/\d+_",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_signature": False,
    "min_reported_time": 1_000_000,
    "capture_repr": ("_repr_html_",),
}
suppress_warnings = ["config.cache"]
# matplotlib says so when a script that is built without a screen asks to show a figure.
warnings.filterwarnings("ignore", message=".*non-interactive.*", category=UserWarning)


def list_further_pages(_app: Any, page: str, source: list[str]) -> None:
    """Names on the first page every written page that it does not name itself."""
    if page == "index":
        named = set(source[0].split())
        further = sorted(path.stem for path in DOCS.glob("*.md") if path.stem not in {*named, "index"})
        source[0] = source[0].replace("FURTHER-PAGES", "\n".join(further))


def setup(app: Any) -> None:
    """Writes the generated pages before anything is read."""
    app.connect("builder-inited", lambda _app: write_pages(DOCS))
    app.connect("source-read", list_further_pages)
