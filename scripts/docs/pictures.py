"""The pictures of the README and of the pages, from a run of the demo, with a tuned move, and one of friction.

    uv run --group docs python scripts/docs/pictures.py [--demo DIR] [--friction DIR] [--bench DIR]

From folders of runs: of the demo, of the template friction, of the template recorded.  Each picture is below 120 KB,
beside this script in pictures/. First screens of reports need chromium; without it those pictures stay as they are.
`shown.txt` has in words and numbers what the pictures show; a slow test compares it with a run of the README, so that
a picture of an earlier page is found.
"""

import argparse
import html
import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullFormatter
from PIL import Image

import elastid as ei
from elastid.base.errors import DataError
from elastid.report.figures.use import move_figure
from elastid.store.results import read_tune
from elastid.use.map import map_workspace
from elastid.use.postures import random_postures

HERE = Path(__file__).parent / "pictures"
MOST_BYTES = 120_000


def responses(run: Path, path: Path) -> None:
    """Draw magnitudes of one configuration, the fitted model with its 95 % band, as an n_y x n_u matrix."""
    result = ei.load(run / "fit.h5")
    measured = next(G for G in ei.load(run / "frf.h5") if G.configuration.name in result.configurations)
    model = result.model(measured.configuration.name)
    dense = np.geomspace(*measured.freq_hz[[0, -1]], 800)
    G, std = np.abs(model.response(dense).G), model.response_std(dense)
    figure = Figure(figsize=(9, 5.4), layout="constrained")
    axes = figure.subplots(*measured.G.shape[1:], sharex=True, sharey=True)
    for (i, j), ax in np.ndenumerate(axes):
        ax.loglog(measured.freq_hz, np.abs(measured.G[:, i, j]), ".", ms=3, color="#0072b2", label="measured")
        ax.loglog(dense, G[:, i, j], color="#d55e00", lw=1.2, label="model")
        band = 1.96 * std[:, i, j]
        ax.fill_between(dense, np.maximum(G[:, i, j] - band, 1e-9), G[:, i, j] + band, color="#d55e00", alpha=0.3, lw=0)
        ax.set_title(f"{measured.inputs[j]} → {measured.outputs[i]}", fontsize=8)
        ax.grid(True, which="both", lw=0.3)
        ax.tick_params(labelsize=7)
        ax.xaxis.set_major_locator(FixedLocator([2, 5, 10, 20, 50]))
        ax.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        ax.xaxis.set_minor_formatter(NullFormatter())
    low, high = np.percentile(np.abs(measured.G), [1, 100])
    axes[0, 0].set_ylim(low / 2, 2 * high)
    axes[0, 0].legend(fontsize=7)
    figure.supxlabel("frequency (Hz)", fontsize=9)
    figure.supylabel("acceleration per torque, rad/s² per Nm", fontsize=9)
    figure.savefig(path, dpi=110)


def friction(run: Path, path: Path) -> None:
    """Draw levels and law of friction with the band."""
    figure = ei.plot.friction_curve(ei.load(run / "friction.h5"), "1")
    figure.savefig(path, dpi=110)


def workspace(run: Path, path: Path) -> None:
    """Draw the softest static compliance at a thousand random postures."""
    result = ei.load(run / "fit.h5")
    mapped = map_workspace(result, random_postures(result.robot, 1000), name="demo")
    ei.plot.workspace(mapped).savefig(path, dpi=110)


def move(run: Path, path: Path) -> None:
    """Draw the last tuned move of the run: errors of the tool, and torques."""
    move_figure(read_tune(run / "tune.h5")).savefig(path, dpi=90)


def axes(path: Path) -> None:
    """Draw driven axis, elastic axes behind it, and the offset of a row of the table, in the plane of two links."""
    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for ax, offset, words in ((left, 0.0, "offset: 0"), (right, 90.0, "offset: 90 deg")):
        for angle, color in ((0.0, "0.75"), (30.0, "#0072b2")):
            along = np.array([np.cos(np.radians(offset + angle)), np.sin(np.radians(offset + angle))])
            ax.plot([0, along[0]], [0, along[1]], lw=9, color=color, alpha=0.5, solid_capstyle="round")
            ax.annotate(f"q = {angle:g} deg", 1.06 * along + [0.0, 0.05], fontsize=10, ha="center", va="bottom")
        turned = np.radians(30.0)  # the offset comes behind the elastic joints: their axes turn by q alone
        x, y = np.array([np.cos(turned), np.sin(turned)]), np.array([-np.sin(turned), np.cos(turned)])
        for direction, name, place in ((x, "x of joint 1x", (0.34, 0.06)), (y, "y of joint 1y", (-0.82, 0.36))):
            ax.annotate("", 0.5 * direction, (0, 0), arrowprops={"arrowstyle": "-|>", "color": "#d55e00", "lw": 1.8})
            ax.annotate(name, place, fontsize=10, va="bottom", color="#d55e00")
        ax.plot(0, 0, "o", ms=9, mfc="white", mec="black")
        ax.plot(0, 0, ".", ms=4, color="black")
        ax.annotate("z, driven: joint 1, towards you", (0, 0), fontsize=10, xytext=(4, -19), textcoords="offset points")
        ax.axhline(0, lw=0.5, color="0.6", ls="--")
        ax.set(aspect="equal", xlim=(-0.85, 1.3), ylim=(-0.4, 1.25), title=words)
        ax.axis("off")
    figure.suptitle(
        "angle of the link: offset + q (here q = 0 and 30 deg); axes of elastic joints rotate by q, without offset",
        fontsize=10,
    )
    figure.savefig(path, dpi=110)


def page(run: Path, path: Path) -> None:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as engines:
        browser = engines.chromium.launch(executable_path=_chromium(), args=["--no-sandbox"])
        screen = browser.new_page(viewport={"width": 1180, "height": 800})
        screen.goto((run / "report.html").resolve().as_uri())
        screen.screenshot(path=str(path))
        browser.close()


def first_screen_text(demo: Path) -> str:
    """Return the text of the page's first screen, and the estimates, one in each row."""
    text = (demo / "report.html").read_text(encoding="utf-8")
    screen = text[text.index('<header class="top">') : text.index('id="q-next"')]
    screen = re.sub(r"<(svg|script|style|output)\b.*?</\1>", " ", screen, flags=re.DOTALL)
    texts = [html.unescape(" ".join(part.split())) for part in re.split(r"<[^>]*>", screen)]
    parameters = json.loads((demo / "summary.json").read_text(encoding="utf-8"))["parameters"]
    numbers = [f"{name} {each['value']:.4g} +- {each['std']:.2g}" for name, each in parameters.items() if "std" in each]
    return "\n".join([*filter(None, texts), *numbers, ""])


def _chromium() -> str:
    from shutil import which

    browser = which("chromium") or which("google-chrome")
    if browser is None:
        raise FileNotFoundError("chromium is not on the path; install it for the picture of the report")
    return browser


def smaller(path: Path) -> int:
    """Return the picture with 64 colors at most, in bytes; RuntimeError if it is too large for a README."""
    Image.open(path).convert("RGB").quantize(64, method=Image.Quantize.MEDIANCUT).save(path, optimize=True)
    if (size := path.stat().st_size) > MOST_BYTES:
        raise RuntimeError(f"{path} has {size} bytes, more than {MOST_BYTES}; draw it smaller")
    return size


def draw_pictures(demo: Path, friction_run: Path, bench: Path) -> Iterator[tuple[str, int]]:
    """Yield every picture with its size in bytes."""
    draw = {
        "frf.png": lambda path: responses(demo, path),
        "friction.png": lambda path: friction(friction_run, path),
        "axes.png": axes,
        "map.png": lambda path: workspace(demo, path),
        "tune.png": lambda path: move(demo, path),
        "report.png": lambda path: page(demo, path),
        "compensation.png": lambda path: page(friction_run, path),
        "bench.png": lambda path: page(bench, path),
    }
    for name, drawn in draw.items():
        path = HERE / name
        try:
            drawn(path)
        except (FileNotFoundError, ModuleNotFoundError, DataError) as error:
            print(f"{name} is not drawn: {error}")
            continue
        yield name, smaller(path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--demo", type=Path, default=Path("runs/demo"), metavar="DIR")
    parser.add_argument("--friction", type=Path, default=Path("runs/friction_of_an_axis"), metavar="DIR")
    parser.add_argument("--bench", type=Path, default=Path("runs/recorded"), metavar="DIR")
    asked = parser.parse_args()
    print(json.dumps(dict(draw_pictures(asked.demo, asked.friction, asked.bench))))
    (Path(__file__).parent / "shown.txt").write_text(first_screen_text(asked.demo), encoding="utf-8")
