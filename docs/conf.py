"""The documentation site: the pages of this folder as they are, and what is made of docstrings.

`make docs` builds it with Sphinx into docs/site, without a network, and fails at a warning.
"""

from importlib.metadata import version as _version
from pathlib import Path

from sphinx.application import Sphinx

_ROOT = Path(__file__).parents[1]
_OUTSIDE = {"CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
"""Pages at the root, and the page that includes each."""

project = "nrs-cosim"
author = "the authors of nrs-cosim"
release = version = _version("nrs-cosim")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["site"]

myst_heading_anchors = 4
default_role = "code"
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = True

html_theme = "furo"
html_title = "nrs-cosim"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = html_show_copyright = html_copy_source = False
html_theme_options = {"navigation_with_keys": True}


def _inside(_app: Sphinx, name: str, source: list[str]) -> None:
    """Let links to pages at the root lead to the pages that include them."""
    above = "../" * (name.count("/") + 1)
    for outside, page in _OUTSIDE.items():
        source[0] = source[0].replace(f"({above}{outside}", f"({above[3:]}{page}")


def _plain(
    _app: Sphinx, what: str, _name: str, _object: object, _options: object, lines: list[str]
) -> None:
    """Take docstrings as text: `|x|` and `*` are no markup. Of a module's, the first line."""
    if what == "module":
        del lines[1:]
    lines[:] = [line.replace("|", "\\|").replace("*", "\\*") for line in lines]


def setup(app: Sphinx) -> None:
    """Connect what the pages need."""
    app.connect("source-read", _inside)
    app.connect("autodoc-process-docstring", _plain, priority=100)
