"""Pictures of what a user sees, of the shots that come with the package: the six of docs/pictures.md, and the answer on
the app's first page.

    make pictures      # two minutes; needs Chromium and the extras [app] and [dev]

Screens are what the commands print, in the colours of a terminal.
"""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Browser, sync_playwright
from rich.console import Console
from rich.terminal_theme import MONOKAI
from rich.text import Text

from cavirheo import infer, read_curves
from cavirheo.reporting.panels import curve_panels
from cavirheo.reporting.pictures import picture

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
ANSWER = ROOT / "src" / "cavirheo" / "app" / "examples" / "answer.svg"
SIZE = {"width": 1260, "height": 1170}
WIDE = {"width": 1160, "height": 800}
SHOT = "soft_gel.csv"
COLUMNS = 88  # of the terminal
SCREEN = (
    "<body style='margin:0;background:#fff'><pre style='display:inline-block;margin:0;padding:16px 20px;"
    "border-radius:8px;background:{background};color:{foreground};font:15px/1.35 DejaVu Sans Mono,monospace'>"
    "{code}</pre></body>"
)


@contextmanager
def chromium() -> Iterator[Browser]:
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        yield browser
        browser.close()


def printed(words: str, folder: Path) -> str:
    """What a command of cavirheo prints in a terminal, without its progress."""
    surroundings = os.environ | {"FORCE_COLOR": "1", "COLUMNS": str(COLUMNS), "PYTHONPATH": str(ROOT / "src")}
    call = [sys.executable, "-m", "cavirheo", *words.split()[1:]]
    return subprocess.run(call, cwd=folder, env=surroundings, capture_output=True, text=True, check=True).stdout


def screen(browser: Browser, words: str, folder: Path, path: Path) -> None:
    """A picture of the command and of what it prints."""
    console = Console(record=True, width=COLUMNS, file=io.StringIO(), force_terminal=True, color_system="truecolor")
    console.print(Text.assemble(("$ ", "dim"), words), Text.from_ansi(printed(words, folder).strip()), sep="\n")
    page = browser.new_page(device_scale_factor=1.5)
    page.set_content(console.export_html(theme=MONOKAI, inline_styles=True, code_format=SCREEN))
    page.locator("pre").screenshot(path=path)


def part_of_report(browser: Browser, folder: Path, part: str, path: Path) -> None:
    """The first part of the report in this folder that a selector of CSS names."""
    page = browser.new_page(viewport=WIDE, device_scale_factor=1.5)  # type: ignore[arg-type]
    page.goto(Path(folder, "report.html").as_uri())
    page.locator(part).first.screenshot(path=path)


def check(browser: Browser, address: str, path: Path) -> None:
    """Step 4 of a shot in the app."""
    page = browser.new_page(viewport=SIZE)  # type: ignore[arg-type]
    page.goto(address)
    page.get_by_role("button", name=SHOT).click()
    page.click("#infer-now:enabled", timeout=400_000)
    page.click("#steps [role=tab]:enabled:has-text('4 Check')", timeout=400_000)
    page.wait_for_selector("#check-plot svg")
    page.mouse.move(0, 0)  # off the tab
    page.evaluate("window.scrollTo(0, 0)")
    page.wait_for_timeout(1000)
    page.screenshot(path=path)


def main() -> None:
    from cavirheo.app.server import running_server  # not where the app's processes start, which import this file anew

    curve = read_curves(ROOT / "examples" / SHOT)[0]
    answer = infer(curve)
    ANSWER.write_text(picture(curve_panels(curve, answer.checks, answer.method)), encoding="utf-8")
    with TemporaryDirectory() as name, chromium() as browser:
        folder = Path(name)
        shutil.copytree(ROOT / "examples", folder / "examples")
        printed(f"cavirheo infer examples/{SHOT} --shots 1 -o shot", folder)
        part_of_report(browser, folder / "shot", "section.group", DOCS / "shot.png")
        film = "examples/bubble.mp4 --fps 500000 --um-per-px 4"
        screen(browser, f"cavirheo infer {film} -o result", folder, DOCS / "terminal.png")
        printed(f"cavirheo measure {film} -o measured", folder)
        shutil.copy(folder / "measured" / "contact.png", DOCS / "video.png")
        printed(f"cavirheo infer examples/{SHOT} --density 998 -o gel", folder)
        part_of_report(browser, folder / "gel", "section.group", DOCS / "group.png")
        screen(browser, "cavirheo design gel/result.json --fps 250e3,1e6 -o plan", folder, DOCS / "design.png")
        with running_server() as (address, _):
            check(browser, address, DOCS / "app.png")


if __name__ == "__main__":
    main()
