"""A browser, and a report written once with its page, and its figures."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from plants.report_values import report_content, write_report

from elastid.report.content import ReportContent
from elastid.report.page.page import html

# Without background traffic: a page that opens offline must not wait for anything.
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A real one, without a window, started once."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as engine:
        chromium = engine.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield chromium
        chromium.close()


@pytest.fixture
def visit(browser) -> Iterator[Callable[..., Any]]:
    """Opens a file of a page in the browser; its console stays empty, and it asks the network for nothing."""
    complaints = []
    contexts = []

    def opened(path: Path, **options: Any) -> Any:
        contexts.append(browser.new_context(viewport={"width": 1200, "height": 900}, **options))
        page = contexts[-1].new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: complaints.append(request.url) if request.url.startswith("http") else None)
        page.goto(path.as_uri())
        return page

    yield opened
    for context in contexts:
        context.close()
    assert contexts
    assert complaints == []


@pytest.fixture(scope="session")
def report_folder(tmp_path_factory) -> Path:
    """The report of two configurations of a two-axis robot with files of its figures."""
    folder = tmp_path_factory.mktemp("report")
    write_report(report_content(), folder, ("png",))
    return folder


@pytest.fixture
def written(tmp_path) -> Callable[[ReportContent], Path]:
    """Writes the page of a content without its figures."""

    def write(content: ReportContent) -> Path:
        path = tmp_path / "report.html"
        path.write_text(html(content, []), "utf-8")
        return path

    return write
