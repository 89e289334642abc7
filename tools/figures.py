"""How the figures of docs are drawn."""

from io import BytesIO
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "svg.hashsalt": "isi",
    "svg.fonttype": "none",
    "figure.dpi": 160,
}


def rendered(canvas: Figure, form: str) -> bytes:
    """A canvas as ``svg`` or ``png``; equal figures give equal bytes."""
    buffer = BytesIO()
    with mpl.rc_context(STYLE):
        canvas.savefig(buffer, format=form, metadata={"Date": None} if form == "svg" else None)
    return buffer.getvalue()
