"""The site of these pages: `make docs`. Pages stay plain Markdown; what a site needs beyond that is done here."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)

project = "rigctl"
html_title = project
html_theme = "furo"
html_show_copyright = False
html_show_sourcelink = False
html_use_index = False
smartquotes = False
extensions = ["myst_nb", "sphinx.ext.autodoc"]
exclude_patterns = ["certificates"]

myst_heading_anchors = 4
# Docstrings say `name` as Markdown does.
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"

# Run on every build, in a directory of its own; an error in a cell is a warning with its traceback.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_show_tb = True
nb_execution_timeout = 120

# Excerpts with "..." in them are none of their language.
suppress_warnings = ["misc.highlighting_failure"]

_OUTSIDE = re.compile(r"\[([^][]*)\]\((\.\./[^)#]*)(?:#[^)]*)?\)")


def with_contents(app: Sphinx, page: str, source: list[str]) -> None:
    """Add the contents that the site is made along, from the links of the index; hidden, as the links show."""
    del app
    if page == "index":
        parts = re.split(r"^(?=## )", source[0], flags=re.MULTILINE)
        source[0] = "".join(map(_with_toctree, parts))


def _with_toctree(part: str) -> str:
    title, pages = re.match(r"## (.*)", part), _linked_pages(part)
    if title is None or not pages:
        return part
    listed = "\n".join(pages)
    return f"{part}\n```{{toctree}}\n:hidden:\n:titlesonly:\n:caption: {title[1]}\n{listed}\n```\n\n"


def of_decisions(app: Sphinx, page: str, source: list[str]) -> None:
    """Decisions have contents of their own, their README, and no place in the site's: they would be most of it."""
    directory, _, name = page.rpartition("/")
    if directory != "decisions":
        return
    if name != "README":
        source[0] = f"---\norphan: true\n---\n{source[0]}"
        return
    linked = _linked_pages(source[0])
    for path in Path(app.srcdir, directory).glob("0*.md"):
        if path.name not in linked:
            logger.warning("%s is not in the table", path.name, location=page)


def _linked_pages(text: str) -> list[str]:
    """Pages of the same directory and below that a text links, each once."""
    return list(dict.fromkeys(re.findall(r"\]\(((?!\.\./)[^)#]+\.(?:md|ipynb))", text)))


def without_ways_out(app: Sphinx, page: str, source: list[str]) -> None:
    """Files of the source tree are named, not linked: a site has only these pages. What is not there is a warning."""
    here = Path(app.srcdir, page).parent

    def named(link: re.Match[str]) -> str:
        target = (here / link[2]).resolve()
        if target.is_relative_to(app.srcdir):
            return link[0]
        if not target.exists():
            logger.warning("no such file: %s", link[2], location=page)
        return link[1]

    source[0] = _OUTSIDE.sub(named, source[0])


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", with_contents)
    app.connect("source-read", of_decisions)
    app.connect("source-read", without_ways_out)
