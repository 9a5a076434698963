"""Pictures of the browser app as it is: the check of a shot (docs/app.png) and the answer on its first page.

    python benchmarks/app_pictures.py    # 20 s; needs Chromium and the extras [app] and [dev]

The answer is the picture of the report of soft_gel[1].
"""

from __future__ import annotations

import shutil
from pathlib import Path

from playwright.sync_api import sync_playwright

from cavirheo import infer, read_curves
from cavirheo.app import steps
from cavirheo.app.server import running_server
from cavirheo.reporting.answer import curve_record
from cavirheo.reporting.panels import answer_panels
from cavirheo.reporting.pictures import curve_svg

ROOT = Path(__file__).parents[1]
ANSWER = ROOT / "src" / "cavirheo" / "app" / "examples" / "answer.svg"
SIZE = {"width": 1260, "height": 1170}
SHOT = "soft_gel.csv"


def check(address: str, path: Path) -> None:
    """Step 4 of a shot with its conventional fit."""
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport=SIZE)  # type: ignore[arg-type]
        page.goto(address)
        page.get_by_role("button", name=SHOT).click()
        page.click("#infer-now:enabled", timeout=120_000)
        page.click("#to-check:enabled", timeout=120_000)
        page.wait_for_selector("#check-plot svg")
        page.click("#fit")
        page.wait_for_selector("#facts :text('least squares')", timeout=120_000)
        page.mouse.move(0, 0)  # off the button
        page.wait_for_timeout(1000)
        page.screenshot(path=path)
        browser.close()


def answer(path: Path) -> None:
    """The first shot's picture of a report, as it stands there."""
    curve = read_curves(steps.examples()[SHOT])[0]
    answer = infer(curve)
    path.write_text(curve_svg(answer_panels(curve, answer.checks, curve_record(curve, answer))), encoding="utf-8")


if __name__ == "__main__":
    answer(ANSWER)
    with running_server() as (address, _):
        check(address, ROOT / "docs" / "app.png")
