"""Pictures of the report and of the browser app as they are: the answer of a shot in its report (docs/shot.png), the
answer on the app's first page, and the check of a shot in the app (docs/app.png).

    python docs/site/app_pictures.py            # 20 s; needs Chromium and the extras [app] and [dev]
    python docs/site/app_pictures.py report     # without the app

The answer is that of soft_gel[1].
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Browser, sync_playwright

from cavirheo import infer, read_curves
from cavirheo.reporting import result, write_report
from cavirheo.reporting.answer import curve_record
from cavirheo.reporting.panels import answer_panels
from cavirheo.reporting.svg import curve_svg

ROOT = Path(__file__).parents[2]
ANSWER = ROOT / "src" / "cavirheo" / "app" / "examples" / "answer.svg"
SIZE = {"width": 1260, "height": 1170}
SHOT = "soft_gel.csv"


@contextmanager
def chromium() -> Iterator[Browser]:
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        yield browser
        browser.close()


def check(address: str, path: Path) -> None:
    """Step 4 of a shot."""
    with chromium() as browser:
        page = browser.new_page(viewport=SIZE)  # type: ignore[arg-type]
        page.goto(address)
        page.get_by_role("button", name=SHOT).click()
        page.click("#infer-now:enabled", timeout=120_000)
        page.click("#to-check:enabled", timeout=120_000)
        page.wait_for_selector("#check-plot svg")
        page.mouse.move(0, 0)  # off the button
        page.wait_for_timeout(1000)
        page.screenshot(path=path)


def answer(svg: Path, png: Path) -> None:
    """The first shot's picture, and its answer as it stands in the report."""
    curve = read_curves(ROOT / "examples" / SHOT)[0]
    answer = infer(curve)
    svg.write_text(curve_svg(answer_panels(curve, answer.checks, curve_record(curve, answer))), encoding="utf-8")
    with TemporaryDirectory() as folder, chromium() as browser:
        pairs = [(curve, answer)]
        write_report(folder, pairs, result(pairs, f"cavirheo infer {SHOT}"))
        page = browser.new_page(viewport={"width": 1160, "height": 800}, device_scale_factor=1.5)
        page.goto(Path(folder, "report.html").as_uri())
        page.locator("section.group").screenshot(path=png)


if __name__ == "__main__":
    answer(ANSWER, ROOT / "docs" / "shot.png")
    if sys.argv[1:] != ["report"]:
        from cavirheo.app.server import running_server

        with running_server() as (address, _):
            check(address, ROOT / "docs" / "app.png")
