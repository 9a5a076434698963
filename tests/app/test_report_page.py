"""The report of several curves in a real Chromium: sorted, filtered, opened by links, no outside request."""

import os
import shutil
from importlib.util import find_spec

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
if find_spec("playwright") is None or CHROMIUM is None:
    pytest.skip("needs playwright and a Chromium", allow_module_level=True)

from answers import COMMAND, answer, bubble, unanswered  # noqa: E402

from cavirheo.reporting import write_report  # noqa: E402

SIZES = {"wide": (1440, 900), "phone": (390, 844)}
EVIL = "</script><img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Of seven curves, of which one has no answer and one is to be checked."""
    folder = tmp_path_factory.mktemp("report")
    curves = [bubble(f"shot[{k}]", group=f"g{k % 2}", source=f"g{k % 2}.csv") for k in range(5)]
    moduli = [5e3, 9e3, 1e3, 7e3, 3e3]
    pairs = [(curve, answer(curve, G)) for curve, G in zip(curves, moduli, strict=True)]
    doubtful = bubble(f"shot[5] {EVIL}")
    pairs.append((doubtful, answer(doubtful, 4e3, verdict="check_input", message="the frame rate is odd")))
    pairs.append((bubble("shot[6]"), unanswered("cell 3 is empty")))
    write_report(folder, pairs, COMMAND)
    return (folder / "report.html").as_uri()


@pytest.fixture(scope="module")
def chromium():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        sandbox = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
        one = driver.chromium.launch(executable_path=CHROMIUM, args=sandbox)
        yield one
        one.close()


@pytest.fixture(params=SIZES)
def page(request, chromium, report):
    width, height = SIZES[request.param]
    made, asked, failed = chromium.new_page(viewport={"width": width, "height": height}), [], []
    made.on("request", lambda one: asked.append(one.url))
    made.on("pageerror", lambda error: failed.append(str(error)))
    made.on("console", lambda said: failed.append(said.text) if said.type == "error" else None)
    made.goto(report)
    yield made
    made.close()
    assert {url.split("#")[0] for url in asked} == {report}
    assert failed == []


def names(page):
    return [text.split()[0] for text in page.locator("table.curves a:visible").all_inner_texts()]


def test_rows_are_sorted_by_each_column_numbers_last_that_are_not_there(page):
    head = page.locator("table.curves th").nth(2)
    head.locator("button").focus()
    page.keyboard.press("Enter")
    assert names(page) == [f"shot[{k}]" for k in (2, 4, 5, 0, 3, 1, 6)]
    assert head.get_attribute("aria-sort") == "ascending"
    below = page.locator("table.curves tbody tr", has=page.locator("a", has_text="shot[5]")).locator("+ tr")
    assert "the frame rate is odd" in below.inner_text()  # a doubt goes with its row
    page.keyboard.press("Enter")
    assert names(page) == [f"shot[{k}]" for k in (1, 3, 0, 5, 4, 2, 6)]
    page.locator("table.curves th").nth(0).locator("button").click()
    assert names(page) == [f"shot[{k}]" for k in range(7)]
    assert head.get_attribute("aria-sort") is None


def test_rows_are_filtered_by_verdict_and_by_any_word(page):
    def shown(count):
        page.wait_for_function(f"document.querySelector('#shown').value === '{count} of 7 curves'")

    page.locator("#verdict").select_option("!ok")
    shown(2)
    assert names(page) == ["shot[5]", "shot[6]"]
    page.locator("#verdict").select_option("")
    page.locator("#words").fill("EMPTY")
    shown(1)
    assert names(page) == ["shot[6]"]
    page.locator("#words").fill("g1.csv shot")
    shown(2)
    assert names(page) == ["shot[1]", "shot[3]"]
    page.locator("#words").fill("nothing like this")
    shown(0)
    assert names(page) == []


def test_articles_are_sorted_and_filtered_with_the_rows(page):
    page.locator("table.curves th").nth(2).locator("button").click()
    heads = page.locator("#articles summary:visible")
    assert [text.split()[0] for text in heads.all_inner_texts()] == [f"shot[{k}]" for k in (2, 4, 5, 0, 3, 1, 6)]
    page.locator("#verdict").select_option("!ok")
    assert [text.split()[0] for text in heads.all_inner_texts()] == ["shot[5]", "shot[6]"]


def test_a_link_opens_its_curve_with_its_picture(page):
    assert page.locator("article:visible").count() == 0
    link = page.get_by_role("link", name="shot[3]")
    link.focus()
    page.keyboard.press("Enter")
    picture = page.locator("article:visible svg")
    assert picture.count() == 1
    box = picture.bounding_box()
    assert box["width"] >= 300
    assert box["height"] > 150
    assert picture.locator("path.measured").count() == picture.locator("path.simulated").count() == 1
    letters = [one.bounding_box()["height"] for one in picture.locator("text").all()]
    assert min(letters) > 8  # px: it can be read on a phone, too
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.get_by_role("link", name="shot[6]").click()  # one without an answer has its measured points, and says so
    assert page.locator("#curve-6 path.measured").is_visible()
    assert "no answer" in page.locator("#curve-6 svg").text_content()


@pytest.mark.parametrize("wide", [1200, 390])
def test_of_several_curves_each_is_a_line_that_its_link_and_print_open(chromium, tmp_path, wide):
    curves = [bubble(f"shot[{k}]", top=(2.6 + 0.01 * k) * 1e-4) for k in range(12)]
    write_report(tmp_path, [(one, answer(one)) for one in curves], "x")
    page = chromium.new_page(viewport={"width": wide, "height": 800})
    page.goto((tmp_path / "report.html").as_uri())
    assert page.locator("article:visible").count() == 0
    assert page.evaluate("document.documentElement.scrollHeight") < 3500
    reading = page.get_by_text("How to read this")
    assert reading.bounding_box()["y"] < page.get_by_text("shot[0]").last.bounding_box()["y"]
    page.get_by_role("link", name="shot[7]").click()
    assert page.locator("details:has(article:visible) summary").first.inner_text().startswith("shot[7]")
    shown = page.locator("article:visible svg").bounding_box()
    assert 0 <= shown["x"] <= wide - shown["width"]  # no part of a figure is cut off
    page.emulate_media(media="print")
    assert page.locator("article:visible").count() == 12
    page.close()


def test_without_script_all_is_there(chromium, report):
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(report)
    assert page.locator("article svg").count() == 7
    assert page.locator("table.curves a").count() == 7
    page.locator("summary", has_text="shot[2]").click()
    assert page.locator("#curve-2 svg").is_visible()
    context.close()
