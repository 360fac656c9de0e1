"""Figures that an experiment from outside the tree draws with matplotlib: the same bytes for the same numbers."""

from __future__ import annotations

import io
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


def svg(figure: Any, name: str) -> str:
    """A `matplotlib.figure.Figure` as an SVG element without date or version, whatever a user's settings say."""
    # Loaded where a figure of its own is there already: none of ours needs it.
    import matplotlib.style
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    text = io.StringIO()
    with matplotlib.style.context(["default", _RC]):
        # Not `savefig`, which draws all of it once more beforehand to find out how large it is.
        canvas: Any = FigureCanvasSVG(figure)
        canvas.print_svg(text, metadata={"Date": None, "Creator": "rigctl", "Title": name})
    written = text.getvalue()
    return written[written.index("<svg") :]
