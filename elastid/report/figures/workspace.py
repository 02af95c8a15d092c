"""A map of the workspace in two cuts, from above and from the side, coloured by a quantity."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from elastid.report.figures import style
from elastid.use.map import WorkspaceMap

# Unit of a figure and factor, by the SI unit of a quantity.
SHOWN = {"m/N": ("µm/N", 1e6), "m": ("mm", 1e3), "Hz": ("Hz", 1.0)}


def workspace_figure(workspace: WorkspaceMap, quantity: str = "softest_compliance") -> Figure:
    """Positions of the frame, each coloured by the quantity there; the softest posture is marked."""
    own = workspace[quantity]
    unit, factor = SHOWN[own.unit]
    value = factor * np.where(np.isfinite(own.value), own.value, np.nan)
    figure, axes = style.panels(1, 2, (style.WIDE, 4.2), (0.7, 0.3, 0.6, 0.6), (0.25, 0.0))
    finite = value[np.isfinite(value)]
    if not finite.size:
        finite = np.array([0.0, 1.0])
    wide = finite.min() > 0 and finite.max() > 10 * finite.min()
    norm = (LogNorm if wide else Normalize)(finite.min(), finite.max())
    x, y, z = workspace.position.T
    soft = int(workspace.softest[0])
    # The softer ones on top, since they are what is looked for.
    order = np.argsort(np.where(np.isfinite(value), value, -np.inf), kind="stable")
    for ax, (a, b), names in zip(
        axes[0], ((x, y), (np.hypot(x, y), z)), (("x", "y"), ("√(x² + y²)", "z")), strict=True
    ):
        dots = ax.scatter(a[order], b[order], c=value[order], s=9, cmap="viridis", norm=norm, linewidths=0)
        ax.plot(a[soft], b[soft], "o", mfc="none", mec=style.TRUTH, ms=9, mew=1.6)
        ax.set_xlabel(f"{names[0]} in m", fontsize=style.NORMAL)
        ax.set_ylabel(f"{names[1]} in m", fontsize=style.NORMAL)
        ax.set_aspect("equal", adjustable="datalim")
        ax.grid(True, color=style.GRID, lw=0.4)
        ax.tick_params(labelsize=style.SMALL)
    bar = figure.colorbar(dots, ax=axes[0].tolist(), fraction=0.04, pad=0.02)
    bar.set_label(f"{own.text} in {unit}", fontsize=style.SMALL)
    bar.ax.tick_params(labelsize=style.SMALL)
    style.add_title(figure, f"{workspace.name}, {workspace.frame}: {own.text}")
    return figure
