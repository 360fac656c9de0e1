"""Figures that an experiment from outside the tree draws with matplotlib: the same bytes for the same numbers."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_RC: dict[str, Any] = {
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "legend.frameon": False,
    # Text stays text: it can be searched, and takes the page's colour.
    "svg.fonttype": "none",
    # Else matplotlib draws the ids of clip paths at random, and equal figures differ as files.
    "svg.hashsalt": "rigctl",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Draw and save within: matplotlib's defaults with ours, whatever a user's settings say; nothing without it."""
    # Who draws with it has loaded it; none of our figures needs it.
    if "matplotlib" not in sys.modules:
        yield
        return
    import matplotlib.style

    with matplotlib.style.context(["default", _RC]):
        yield


def svg(figure: Any, name: str) -> str:
    """A `matplotlib.figure.Figure`, drawn within `figure_style`, as an SVG element without date or version."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    text = io.StringIO()
    # Not `savefig`, which draws all of it once more beforehand to find out how large it is.
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(text, metadata={"Date": None, "Creator": "rigctl", "Title": name})
    written = text.getvalue()
    return written[written.index("<svg") :]
