"""The browser app in a real Chromium: the five steps, wide and narrow, errors, two visitors, no outside request."""

import json
import os
import re
import shutil
import time
import zipfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from conftest import messages

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
for found, lacking in (
    (find_spec("gradio"), "the app extra is not installed"),
    (find_spec("playwright"), "playwright is not installed"),
    (CHROMIUM, "no Chromium on this machine"),
):
    if found is None:
        pytest.skip(lacking, allow_module_level=True)

from cavirheo.app.session import VisitorLimits  # noqa: E402
from cavirheo.app.steps import examples  # noqa: E402
from cavirheo.inference import input_checks  # noqa: E402
from cavirheo.inference.analysis import Analysis  # noqa: E402
from cavirheo.io import read_curves, write_csv  # noqa: E402
from cavirheo.posterior import Checks, Posterior  # noqa: E402
from cavirheo.reporting import result, wall_page  # noqa: E402
from cavirheo.reporting.material import PopulationRecord  # noqa: E402
from cavirheo.writing.digits import MISSING  # noqa: E402

ANSWER = Posterior(
    ("log10_shear_modulus", "log10_viscosity"), ("Pa", "Pa s"),
    np.column_stack([np.linspace(3.6, 3.9, 60), np.linspace(-1.5, -1.4, 60)]), Checks("ok"), "nhkv", "verified",
)  # fmt: skip
MATERIAL = PopulationRecord(
    line="", model="nhkv, equilibrium", n=4, shear_modulus_Pa={"median": 5432.0, "q05": 4321.0, "q95": 6543.0},
    viscosity_Pa_s={"median": 0.03456, "q05": 0.03123, "q95": 0.03789},
    spreads_decades={name: {"median": 0.2, "q05": 0.1, "q95": 0.3} for name in ("shear_modulus", "viscosity")},
)  # fmt: skip
WALL = """(() => {
  const boxed = [...document.querySelectorAll(".value dd, footer p, footer span, .badge, h1, svg, .said")];
  const box = new Map(boxed.map(one => [one, one.getBoundingClientRect()]));
  const tall = innerWidth > innerHeight ? innerHeight : document.documentElement.scrollHeight;
  const beyond = boxed.filter(one => box.get(one).right > innerWidth + 1 || box.get(one).bottom > tall + 1);
  const meets = (a, b) => a.left < b.right && b.left < a.right && a.top + 3 < b.bottom && b.top + 3 < a.bottom;
  const apart = (a, b) => a.contains(b) || b.contains(a) || !meets(box.get(a), box.get(b));
  const across = boxed.filter(a => boxed.some(b => !apart(a, b)));
  const written = [...document.querySelectorAll("body *")].filter(one => [...one.childNodes].some(
    node => node.nodeType === 3 && node.textContent.trim()));
  const size = one => parseFloat(getComputedStyle(one).fontSize) * (one.closest("svg")?.getScreenCTM().a ?? 1);
  const words = list => list.map(one => one.outerHTML);
  return {beyond: words(beyond), across: words(across), smallest: Math.min(...written.map(size))};
})()"""
EXAMPLES = Path(__file__).parent.parent / "examples"
WIDE, PHONE = (1440, 900), (390, 844)
MANY = 20
VERIFIED = {"ok", "undetermined"}  # verdicts of a recording that nothing speaks against


@pytest.fixture(scope="module")
def served():
    from cavirheo.app.server import running  # gradio takes seconds, which collecting tests need not wait for

    with running(limits=VisitorLimits(file_mb=1.0)) as (address, visitors):
        yield address, visitors


@pytest.fixture
def wall(tmp_path):
    from cavirheo.app.server import running

    with running(folder=tmp_path) as (address, _):
        yield address, tmp_path


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        sandbox = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []  # Chromium refuses it to root
        one = driver.chromium.launch(executable_path=CHROMIUM, args=sandbox)
        yield one.new_context()  # of all pages: scripts are loaded once
        one.close()


@pytest.fixture
def visit(served, browser):
    """A new visitor's page of this size; at the end: no request went elsewhere, no script failed."""
    pages, elsewhere, failed = [], [], []

    def one(size=WIDE):
        page = browser.new_page()
        pages.append(page)
        page.set_viewport_size({"width": size[0], "height": size[1]})
        page.set_default_timeout(60_000)
        page.on("request", lambda request: _foreign(request.url, served[0]) and elsewhere.append(request.url))
        page.on("websocket", lambda socket: elsewhere.append(socket.url))
        page.on("pageerror", lambda error: failed.append(str(error)))
        page.goto(served[0])
        page.wait_for_selector("#upload input[type=file]", state="attached")
        return page

    yield one
    for page in pages:
        page.close()
    assert elsewhere == []
    assert failed == []


def _foreign(url, address):
    return not url.startswith((address, "data:", "blob:"))


def drop(page, *files):
    page.set_input_files("#upload input[type=file]", [str(file) for file in files])
    page.wait_for_selector("#found table, #refused .failed-message")


def drag(page, name, share):
    """Move a slider to this share of its range, and wait until the simulation is drawn."""
    before = page.evaluate("document.body.dataset.redrawn || '0'")
    page.locator(f"#slider-{name} input[type=range]").evaluate(
        "(one, share) => { one.value = share * one.max; one.dispatchEvent(new Event('input', {bubbles: true})); }",
        share,
    )
    page.wait_for_function("before => (document.body.dataset.redrawn || '0') !== before", arg=before)


def traces(page):
    """{name: number of points} of the upper panel of the check."""
    return page.evaluate(
        "Object.fromEntries(document.querySelector('#check-plot .js-plotly-plot').data"
        ".filter(one => one.showlegend !== false).map(one => [one.name, one.x.length ?? one.x.shape]))"
    )


def quick(page, level="not verified (fastest)"):
    """Answers without simulations, where the answers themselves are not looked at."""
    page.get_by_role("button", name="More about the method").click()
    page.get_by_label(level).check()


def answered(page, shots):
    rows = "document.querySelectorAll('#answers .curves tbody tr')"
    page.wait_for_function(f"{rows}.length === {shots} && !document.querySelector('#answers .soon')")
    page.wait_for_selector("#to-check:enabled")


def closed(page):
    """Numbers of the steps that cannot be opened."""
    return [k for k, tab in enumerate(page.locator("#steps [role=tab]").all(), 1) if tab.is_disabled()]


def fits_the_screen(page):
    return page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def take(page, folder):
    """The zip of the last step, unpacked."""
    page.get_by_role("tab", name="5 Export").click()
    with page.expect_download() as download:
        page.click("#make")
    download.value.save_as(folder / "result.zip")
    with zipfile.ZipFile(folder / "result.zip") as archive:
        archive.extractall(folder)
    return folder / "cavirheo-result"


def test_five_steps_on_a_shipped_example(visit, tmp_path):
    page = visit(WIDE)
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#overview .js-plotly-plot")
    page.wait_for_selector("#overview-normalised .js-plotly-plot")
    assert page.locator("#found tbody tr").count() == 5
    assert fits_the_screen(page)

    page.click("#to-prepare")
    page.wait_for_selector("#prepared svg.picture")
    for k in (2, 4, 5):
        page.get_by_label(f"soft_gel[{k}]", exact=True).uncheck()
    page.fill("#density input", "1050")
    page.press("#density input", "Tab")
    page.wait_for_selector("#prepared li")

    page.click("#to-infer")
    page.click("#infer")
    answered(page, 2)
    assert re.search(r"G\s*kPa", page.inner_text("#answers .curves thead"))
    assert page.locator("#answers .curves .badge").first.inner_text() == "ok"

    page.click("#to-check")
    page.wait_for_selector("#check-plot .js-plotly-plot")
    page.wait_for_selector("#facts article")
    assert len(re.findall(r"[\d.]+ %", page.inner_text("#facts"))) >= 3  # RMSE, mean and largest difference
    assert traces(page)["sliders"] == 0
    drag(page, "viscosity", 0.2)
    first = page.inner_text("#trial")
    assert traces(page)["sliders"] > 100
    drag(page, "viscosity", 0.6)
    assert re.search(r"RMSE [\d.]+ %", page.inner_text("#trial"))
    assert page.inner_text("#trial") != first
    assert not page.locator("#stop-fit").is_visible()
    page.click("#fit")
    page.wait_for_selector("#stop-fit", state="visible")
    page.wait_for_selector("#facts :text('least squares')")
    page.wait_for_selector("#stop-fit", state="hidden")
    page.wait_for_function("document.querySelector('#check-plot .js-plotly-plot')?.data?.length > 7")
    assert {"sliders", "measured", "simulation: best draw", "least squares"} <= traces(page).keys()
    assert fits_the_screen(page)

    folder = take(page, tmp_path)
    document = json.loads((folder / "result.json").read_text())
    assert [record["name"] for record in document["curves"]] == [f"soft_gel[{k}]" for k in (1, 3)]
    assert "--density 1050" in document["command"]
    assert document["curves"][0]["medium"]["density"] == 1050
    assert (folder / "least-squares" / "report.html").exists()
    assert page.locator(".toast-wrap :text('Not done')").count() == 0


def test_the_network_answers_first_and_is_not_trusted(visit, monkeypatch):
    """Its intervals stand there while simulations verify them, which replace them one by one."""
    held, real = {f"soft_gel[{k}]": Event() for k in range(1, 6)}, Analysis.answer

    def slow(analysis, curve, **options):
        if analysis.verify == "auto":
            held[curve.name].wait(60)
        return real(replace(analysis, verify="map"), curve, **options)

    monkeypatch.setattr(Analysis, "answer", slow)
    page = visit(WIDE)
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#infer-now:enabled")
    page.click("#infer-now")
    page.wait_for_selector("#answers .curves tbody tr >> nth=4")
    badges = page.locator("#answers .curves .badge")
    assert badges.all_inner_texts() == ["not verified"] * 5
    assert re.search(r"\[[\d.]+, [\d.]+\]", page.inner_text("#answers .curves tbody tr >> nth=0"))
    assert "0 of 5 shots count" in page.inner_text("#answers .groups")
    assert page.locator("#answers .material").count() == 0
    assert closed(page) == [4, 5]
    page.locator("#answers .curves td").first.click()  # nothing to check yet
    assert page.locator("#infer").is_visible()
    assert fits_the_screen(page)
    held["soft_gel[1]"].set()
    page.wait_for_selector("#answers :text('1 of 5 shots done')")
    first, *rest = badges.all_inner_texts()
    assert first in VERIFIED
    assert rest == ["not verified"] * 4
    page.click("#stop")
    page.wait_for_selector("#answers :text('Stopped: 1 of 5')")
    assert badges.all_inner_texts() == [first]
    for one in held.values():
        one.set()
    page.click("#infer")
    answered(page, 5)
    assert {*badges.all_inner_texts()} <= VERIFIED
    assert page.locator("#answers :text('not yet')").count() == 0


@pytest.mark.slow
def test_many_shots_in_three_clicks_on_a_phone_and_a_stop(visit, tmp_path):
    """Drop, infer, look; then a run with intervals is stopped: those that are done stay, and the page goes on."""
    page = visit(PHONE)
    drop(page, _mat_of_many(tmp_path))
    assert page.locator("#found tbody tr").count() == MANY
    assert fits_the_screen(page)
    page.click("#infer-now")
    answered(page, MANY)
    done = page.locator("#answers .curves tbody tr")
    assert fits_the_screen(page)
    for button, shown in (("to-check", "#facts article"), ("to-export", "#make")):
        page.click(f"#{button}")
        page.wait_for_selector(shown)
        assert fits_the_screen(page)
    page.get_by_role("tab", name="2 Prepare").click()
    page.wait_for_selector("#prepared svg.picture")
    assert fits_the_screen(page)
    tabs = page.locator("#steps [role=tab]")
    heights = tabs.evaluate_all("all => all.map(one => one.getBoundingClientRect().height)")
    assert min(heights) >= 40  # for a thumb

    page.get_by_role("tab", name="3 Infer").click()
    quick(page, "Gaussian")
    page.click("#infer")
    page.wait_for_selector(rf"text=/\b(?!{MANY})[1-9][0-9]* of {MANY} shots/")  # not what the answers before say of all
    page.click("#stop")
    page.wait_for_selector("#answers [role=status]:has-text('Stopped')")
    assert 1 <= done.count() < MANY
    assert f"{done.count()} of {MANY}" in page.inner_text("#answers [role=status] >> nth=0")
    assert re.search(r"\[[\d.]+, [\d.]+\]", done.first.inner_text())
    page.wait_for_selector("#stop", state="hidden")
    assert page.evaluate("[...document.querySelectorAll('.wide')].every(one => one.scrollWidth <= one.clientWidth)")
    page.get_by_label("not verified (fastest)").check()
    page.click("#infer")
    answered(page, MANY)
    (said,) = page.locator("#answers [role=status]").all_inner_texts()
    assert "not verified by simulations" in said


def _mat_of_many(folder):
    """The five shots of the shipped .mat, several times."""
    from scipy.io import loadmat, savemat

    content = {key: value for key, value in loadmat(examples()["stiff_gel.mat"]).items() if key[:2] != "__"}
    wide = {key: np.tile(value, MANY // 5) for key, value in content.items() if value.size == 5}
    assert {"R_nondim_All", "t_nondim_All", "RmaxList"} <= wide.keys()
    wide["RmaxList"] = wide["RmaxList"] * np.linspace(1.0, 1.001, MANY)  # equal recordings count once
    savemat(folder / "many.mat", content | wide)
    return folder / "many.mat"


def test_errors_are_told_and_mended(visit, tmp_path):
    page = visit(WIDE)
    bad, huge, short = tmp_path / "bad.mat", tmp_path / "huge.csv", tmp_path / "short.csv"
    bad.write_bytes(examples()["stiff_gel.mat"].read_bytes()[:3000])
    huge.write_bytes(b"time_us,radius_um\n" + b"1,2\n" * 400_000)
    short.write_text("time_us,radius_um\n" + "".join(f"{k},{100 - k * k}\n" for k in range(3)))
    drop(page, bad)
    assert "bad.mat" in page.inner_text("#refused .failed-message")
    page.set_input_files("#upload input[type=file]", str(huge))
    page.wait_for_selector(".toast-body.error")
    page.click("#clear")  # nothing is loaded that could be lost
    page.wait_for_selector("#refused .failed-message", state="detached")
    drop(page, short)
    page.click("#infer-now")
    page.wait_for_selector("#answers .badge.failed")
    assert "short" in page.inner_text("#answers [role=status]")
    page.click("#to-check")
    page.wait_for_selector("#facts .message.failed")
    page.wait_for_selector("#check-plot .js-plotly-plot")
    assert not any(name.startswith("simulation") for name in traces(page))
    page.get_by_role("tab", name="3 Infer").click()
    page.get_by_role("tab", name="2 Prepare").click()
    page.wait_for_timeout(500)  # nobody types in the moment in which the steps change
    page.fill("#rmax-um input", "-5")
    page.press("#rmax-um input", "Tab")
    page.wait_for_selector("#rmax-um :text('-5')")
    assert page.locator(".toast-body :text('-5')").count() == 0


def test_what_is_wrong_is_said_at_its_field_and_nowhere_else(visit):
    page = visit(WIDE)
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#found table")
    page.click("#to-prepare")
    for field, text, said in (("density", "1,050", "two ways"), ("stretch", "0.5", "between 1 and 100")):
        page.fill(f"#{field} input", text)
        page.wait_for_selector(f"#{field} :text('{said}')")
        page.fill(f"#{field} input", "")
        page.wait_for_selector(f"#{field} :text('{said}')", state="detached")
    page.fill("#stretch input", "0.5")
    page.click("#to-infer")
    page.click("#infer")
    page.wait_for_selector("#wrong [role=alert]:has-text('between 1 and 100')")
    page.wait_for_selector("#stop", state="hidden")
    page.get_by_role("tab", name="1 Data").click()  # the message covers no step
    page.focus("#clear")
    page.keyboard.press("Enter")
    page.wait_for_selector("#lost :text('soft_gel.csv')")
    page.wait_for_function("document.activeElement.id === 'keep'")
    page.keyboard.press("Enter")
    page.wait_for_selector("#sure", state="hidden")
    assert page.locator("#found table").count() == 1
    page.click("#clear")
    page.click("#delete")
    page.wait_for_selector("#found table", state="detached")
    assert not page.locator("#sure").is_visible()
    page.wait_for_selector("#wrong [role=alert]", state="detached")
    assert page.locator(".toast-body").count() == 0


@pytest.mark.slow
def test_the_page_has_one_state(visit, tmp_path):
    """Steps are open where they can work; changed settings grey the answers; a reload brings all of it back."""
    page = visit(WIDE)
    assert closed(page) == [2, 3, 4, 5]
    assert page.locator("#welcome img").is_visible()
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#found table")
    assert page.locator("#welcome").count() == 0 or not page.locator("#welcome").is_visible()
    assert closed(page) == [4, 5]
    page.click("#to-prepare")
    page.click("#to-infer")
    quick(page)
    page.click("#infer")
    answered(page, 5)
    assert closed(page) == []
    page.wait_for_selector("#cloud .js-plotly-plot")
    assert "density 998" in page.inner_text("#answers")
    page.get_by_label("Newtonian fluid").check()
    page.wait_for_selector("#answers :text('Settings changed')")
    assert closed(page) == [4, 5]
    assert page.locator("#answers .stale").count() == 1
    page.get_by_label("neo-Hookean Kelvin-Voigt").check()
    page.wait_for_selector("#answers :text('Settings changed')", state="detached")
    assert closed(page) == []

    head = page.locator("#answers .curves thead th").first
    names = page.locator("#answers .curves tbody td:first-child")
    for _ in range(2):
        head.press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    assert names.all_inner_texts() == [f"soft_gel[{k}]" for k in (5, 4, 3, 2, 1)]
    names.nth(1).press("Enter")
    page.wait_for_selector("#facts h3:text('soft_gel[4]')")
    width = "document.querySelector('#check-plot .main-svg').getBoundingClientRect().width"
    before = page.evaluate(width)
    page.get_by_role("tab", name="3 Infer").click()
    page.click("#infer")
    page.wait_for_selector("#stop", state="visible")
    page.wait_for_selector("#stop", state="hidden")
    page.wait_for_function("document.querySelector('#facts h3')?.textContent === 'soft_gel[1]'")  # of the new answers
    page.get_by_role("tab", name="4 Check").click()
    page.wait_for_function(f"Math.abs({width} - {before}) < 2")  # not as wide as a figure that was drawn unseen

    assert "?session=" in page.url
    page.reload()
    page.wait_for_selector("#found table")
    page.get_by_role("tab", name="3 Infer").click()
    answered(page, 5)
    assert closed(page) == []
    page.get_by_role("tab", name="4 Check").click()
    page.wait_for_selector("#facts h3:text('soft_gel[1]')")
    again = page.context.new_page()
    again.goto(page.url.replace("session=", "session=x"))  # nobody's
    again.wait_for_selector("#upload input[type=file]", state="attached")
    assert closed(again) == [2, 3, 4, 5]
    again.close()


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_the_first_screen_says_what_can_be_done(visit, size):
    page = visit(size)
    assert page.locator("#to-prepare").is_disabled()
    assert page.locator("#infer-now").is_disabled()
    assert "The cavirheo developers" in page.inner_text("#welcome")
    label = page.locator("#upload label[data-testid=block-label]").bounding_box()
    assert label["height"] < 36  # one line
    assert fits_the_screen(page)
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#to-prepare:enabled")
    page.click("#clear")
    page.wait_for_selector("#delete")
    assert fits_the_screen(page)
    page.click("#delete")
    page.wait_for_selector("#to-prepare:disabled")


@pytest.mark.slow
def test_two_materials_in_single_files_are_asked_about_and_told_apart(visit, tmp_path):
    page, files = visit(WIDE), []
    for name, example in (("soft", "soft_gel.csv"), ("stiff", "stiff_gel.mat")):
        for k, curve in enumerate(read_curves(examples()[example])[:3], 1):
            files.append(tmp_path / f"{name}_{k}.csv")
            write_csv(files[-1], curve)
    drop(page, *files)
    page.wait_for_selector("#found tbody tr >> nth=5")
    page.click("#to-prepare")
    page.click("#to-infer")
    quick(page)
    page.click("#infer")
    answered(page, 6)
    assert "several materials" in page.inner_text("#answers [role=status] >> nth=0")
    assert "named soft, stiff" in page.inner_text("#answers")
    assert page.locator("#answers .differences").count() == 0
    page.get_by_role("tab", name="2 Prepare").click()
    page.locator("#group input").click()
    page.get_by_role("option", name="whose files have one name").click()
    page.get_by_role("tab", name="3 Infer").click()
    page.wait_for_selector("#answers :text('Settings changed')")
    page.click("#infer")
    page.wait_for_selector("#answers .differences")
    assert page.locator("#answers .groups tbody tr:not(.trend) td:first-child").all_inner_texts() == ["soft", "stiff"]
    (said,) = page.locator("#answers .differences li").all_inner_texts()
    assert re.match(r"stiff over soft: G [\d.]+ \[[\d.]+, [\d.]+\], larger with probability", said)
    assert "several materials" not in page.inner_text("#answers")
    assert re.search(r"G would change: soft [+-][\d.]+ %, stiff [+-][\d.]+ %", page.inner_text("#answers"))
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert fits_the_screen(page)


@pytest.mark.slow
def test_materials_are_typed_beside_their_files(visit, tmp_path):
    """By keyboard; before and after the answers, which are pooled anew."""
    page = visit(WIDE)
    drop(page, *(_one_shot(tmp_path / f"{name}.csv", 1.01 + 0.01 * k) for k, name in enumerate("abc")))
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#found tbody tr >> nth=7")
    boxes = page.locator("#found input[data-file]")
    assert [box.input_value() for box in boxes.all()] == ["your files"] * 3 + ["soft_gel"] * 5
    page.get_by_label("Material of b").fill("agarose 1 %")
    page.keyboard.press("Enter")
    page.get_by_label("Material of soft_gel[1]").fill("gel")  # the first of its file
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.ariaLabel") == "Density of soft_gel[1], kg/m³"
    assert [box.input_value() for box in boxes.all()][3:] == ["gel"] * 5
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert fits_the_screen(page)
    page.set_viewport_size({"width": WIDE[0], "height": WIDE[1]})
    page.get_by_role("tab", name="3 Infer").click()
    quick(page)
    page.click("#infer")
    answered(page, 8)
    groups = page.locator("#answers .groups tbody tr:not(.trend) td:first-child")
    assert groups.all_inner_texts() == ["your files", "agarose 1 %", "gel"]
    page.get_by_role("tab", name="1 Data").click()
    page.get_by_label("Material of soft_gel[1]").fill("agarose 1 %")
    page.get_by_label("Material of soft_gel[1]").press("Enter")
    page.wait_for_function("document.querySelectorAll('#answers .groups tbody tr:not(.trend)').length === 2")
    assert groups.all_text_contents() == ["your files", "agarose 1 %"]
    assert page.locator("#answers .stale").count() == 0


@pytest.mark.slow
def test_the_bubble_is_chosen(visit, tmp_path):
    page = visit(WIDE)
    drop(page, _one_shot(tmp_path / "one.csv"))
    page.click("#to-prepare")
    page.click("#to-infer")
    quick(page)
    page.get_by_label("the field's: equilibrium contents").check()
    page.click("#infer")
    answered(page, 1)
    document = json.loads((take(page, tmp_path) / "result.json").read_text())
    assert [record["bubble"]["contents"] for record in document["curves"]] == ["equilibrium"]
    assert "--bubble field" in document["command"]


@pytest.mark.slow
def test_published_values_stand_beside_the_answers(visit, tmp_path):
    page = visit(WIDE)
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#to-prepare:enabled")
    page.click("#to-prepare")
    page.click("#to-infer")
    quick(page)
    assert page.locator("#published").count() == 0 or not page.locator("#published").is_visible()
    page.click("#infer")
    answered(page, 5)
    wrong, values = tmp_path / "wrong.csv", tmp_path / "values.csv"
    wrong.write_text("set,who\nsoft_gel,IMR\n")
    lines = ("set,method,quantity,mean,std", "gel,IMR,G_kPa,6.4,1.6", "gel,IMR,mu_Pa_s,0.03,0.01", "gel,<b>,G_Pa,1300,")
    values.write_text("\n".join(lines))
    for file in (wrong, values):
        with page.expect_file_chooser() as chooser:
            page.click("#published")
        chooser.value.set_files(str(file))
        if file is wrong:
            page.wait_for_selector("#wrong [role=alert]:has-text('wrong.csv, line 1, column who')")
            assert str(tmp_path) not in page.inner_text("#wrong")
    page.wait_for_selector("#answers .published")
    *rows, own = page.locator("#answers .published tbody tr").all_inner_texts()
    assert own.split("\t")[1] == "cavirheo"
    assert [[cell.strip() for cell in row.split("\t")] for row in rows] == [
        ["soft_gel", "IMR", "6.4 ± 1.6", "0.030 ± 0.010"], ["soft_gel", "<b>", "1.30\n80 % from IMR", MISSING]
    ]  # fmt: skip
    with page.expect_file_chooser() as chooser:
        page.click("#published")
    chooser.value.set_files([str(EXAMPLES / f"soft_gel_{kind}_sweep.csv") for kind in ("strain", "frequency")])
    page.wait_for_selector("#answers .published tbody tr >> nth=3")
    row = page.inner_text("#answers .published tbody tr >> nth=2").split("\t")
    assert row[:2] == ["soft_gel", "rheometer, 0.063 to 100 rad/s, strain ≤ 1.0 %"]
    assert row[2].split() == ["1.50", "77", "%", "from", "IMR"]
    assert row[3].split() == ["13.5", "at", "1", "rad/s"]
    assert "not a contradiction" in page.inner_text("#answers .published")
    page.wait_for_function(
        "document.querySelector('#cloud .js-plotly-plot').data.some(one => one.name === 'soft_gel, IMR')"
    )
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert fits_the_screen(page)
    document = json.loads((take(page, tmp_path) / "result.json").read_text())
    assert len(document["groups"][0]["published"]) == 3


def test_nothing_is_kept_of_a_page_that_was_left(served, visit, monkeypatch):
    page, (_, visitors) = visit(WIDE), served
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#overview .js-plotly-plot")
    kept = visitors.forgotten.__closure__[
        0
    ].cell_contents.blocks.state_holder.session_data  # gradio's, with every figure of each page
    (mine,) = [name for name, link in visitors._links.items() if link in page.url]
    assert mine in kept
    monkeypatch.setattr(visitors, "limits", VisitorLimits(absent=0.05))
    page.close()
    until = time.monotonic() + 20
    while mine in kept and time.monotonic() < until:
        time.sleep(0.05)
    assert mine not in kept
    assert mine not in visitors._links


def test_a_class_with_one_file(visit, tmp_path):
    """All drop the same file at the same time."""
    pages, one = [visit(WIDE) for _ in range(3)], _one_shot(tmp_path / "one.csv")
    for page in pages:
        page.set_input_files("#upload input[type=file]", str(one))
    for page in pages:
        page.bring_to_front()  # a page behind others draws nothing
        page.wait_for_selector("#found tbody tr")
        assert page.locator("#found tbody td:first-child").all_inner_texts() == ["one"]
        assert page.locator("#refused .failed-message").count() == 0


def test_a_file_that_is_dropped_while_another_loads(visit, tmp_path):
    page, files = visit(WIDE), [_one_shot(tmp_path / "one.csv"), _one_shot(tmp_path / "other.csv", 1.5)]
    with page.expect_response(lambda answer: "/upload?" in answer.url):
        page.set_input_files("#upload input[type=file]", str(files[0]))
    page.wait_for_timeout(200)  # until the list of what was sent stands where files are dropped
    page.set_input_files("#upload input[type=file]", str(files[1]))
    page.wait_for_selector("#found tbody tr >> nth=1")
    assert page.locator("#found tbody td:first-child").all_inner_texts() == ["one", "other"]
    assert "taken as one material" in page.inner_text("#found")


def test_the_table_of_files_does_not_wait_for_the_solver(visit, tmp_path, monkeypatch):
    """Which is compiled on the first day, for a minute where the machine is busy."""
    page, held = visit(WIDE), Event()
    monkeypatch.setattr(input_checks, "of_scale", lambda *_: messages("check the scale") if held.wait(60) else [])
    drop(page, _one_shot(tmp_path / "one.csv"))
    page.wait_for_selector("#infer-now:enabled")
    assert page.locator("#warned .message").count() == 0
    assert not held.is_set()
    held.set()
    page.wait_for_selector("#warned .message:has-text('check the scale')")


def test_a_density_is_typed_for_a_material(visit, tmp_path):
    page = visit(WIDE)
    drop(page, *(_one_shot(tmp_path / f"{name}.csv", 1.01 + 0.01 * k) for k, name in enumerate("abc")))
    page.wait_for_selector("#found tbody tr >> nth=2")
    page.get_by_label("Material of c").fill("dense")
    page.keyboard.press("Enter")
    page.get_by_label("Density of a").fill("1050")
    page.keyboard.press("Tab")
    densities = page.locator("#found input.density")
    assert [box.input_value() for box in densities.all()] == ["1050", "1050", ""]
    assert page.evaluate("document.activeElement.ariaLabel") == "Material of b"  # the focus is not lost
    page.get_by_label("Material of c").fill("your files")
    page.keyboard.press("Enter")
    assert densities.nth(2).input_value() == "1050"
    page.get_by_label("Density of b").fill("1,050")
    page.keyboard.press("Enter")
    page.wait_for_selector("#wrong :text('two ways')")
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert fits_the_screen(page)


@pytest.mark.slow
def test_the_keyboard_goes_the_whole_way(visit):
    """Tab, Enter and arrows alone, from the example to the files; the focus is never lost."""
    page, lost = visit(WIDE), []

    def reach(wanted):
        for _ in range(60):
            page.keyboard.press("Tab")
            if page.evaluate("one => document.activeElement.matches(one)", wanted):
                return
        raise AssertionError(f"no Tab leads to {wanted}")

    def then(shown):
        page.wait_for_selector(shown)
        page.wait_for_timeout(300)
        lost.extend([shown] * page.evaluate("document.activeElement === document.body"))

    for wanted, shown in (
        ("#upload *", "#upload"),
        ("button.sm", "#found table"),  # the first example
        ("#to-prepare", "#prepared svg.picture"),
        ("#density input", "#density"),
        ("#to-infer", "#infer"),
        ("#infer", "#to-check:enabled"),
        ("#to-check", "#facts article"),
        ("#slider-viscosity input[type=range]", "#check-plot .js-plotly-plot"),
        ("#to-export", "#make"),
        ("#make", ".file-preview:has-text('result')"),
    ):
        reach(wanted)
        if "range" in wanted:
            page.keyboard.press("ArrowRight")
            page.wait_for_selector("#trial :text('RMSE')")
        elif "#upload" not in wanted and "#density" not in wanted:
            page.keyboard.press("Enter")
        then(shown)
    assert lost == []


@pytest.mark.slow
@pytest.mark.skipif("CAVIRHEO_AXE" not in os.environ, reason="no axe-core (CAVIRHEO_AXE: its axe.min.js)")
@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_no_rule_of_axe_is_violated_on_any_step(visit, size, monkeypatch):
    with open(os.environ["CAVIRHEO_AXE"], encoding="utf-8") as file:
        axe = file.read()
    page, wrong = visit(size), []

    def look(step):
        page.wait_for_timeout(500)
        page.evaluate(axe)
        found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")["violations"]
        wrong.extend((step, one["id"], [node["html"][:120] for node in one["nodes"]]) for one in found)

    look(0)
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#overview .js-plotly-plot")
    look(1)
    page.click("#to-prepare")
    page.wait_for_selector("#prepared svg.picture")
    look(2)
    page.fill("#density input", "1,050")
    page.wait_for_selector("#density :text('two ways')")
    look("2, wrong")
    page.fill("#density input", "")
    page.click("#to-infer")
    quick(page)
    page.click("#infer")
    answered(page, 5)
    look(3)
    page.click("#to-check")
    page.wait_for_selector("#facts article")
    look(4)
    page.click("#to-export")
    page.click("#make")
    page.wait_for_selector(".file-preview:has-text('result')")
    look(5)
    page.get_by_role("tab", name="3 Infer").click()
    page.get_by_label("Newtonian fluid").check()
    page.wait_for_selector("#answers :text('Settings changed')")
    look("3, stale")
    held, real = Event(), Analysis.answer

    def slow(analysis, curve, **options):
        if analysis.verify != "none":
            held.wait(60)
        return real(analysis, curve, **options)

    monkeypatch.setattr(Analysis, "answer", slow)
    page.get_by_label("weighed by simulations").check()
    page.click("#infer")
    page.wait_for_selector("#answers .badge.unverified >> nth=5")
    look("3, not verified")
    page.click("#stop")
    page.wait_for_selector("#stop", state="hidden")
    held.set()
    assert wrong == []


@pytest.mark.slow
def test_stop_goes_when_a_run_raises(visit):
    page = visit(WIDE)
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#overview .js-plotly-plot")
    page.click("#to-prepare")
    page.wait_for_selector("#prepared svg.picture")
    for k in range(1, 6):
        page.get_by_label(f"soft_gel[{k}]", exact=True).uncheck()
    page.click("#to-infer")
    page.click("#infer")
    page.wait_for_selector("#wrong [role=alert]:has-text('no shots')")
    assert page.locator(".toast-body").count() == 0
    page.wait_for_selector("#stop", state="hidden")


@pytest.mark.slow
@pytest.mark.skipif(find_spec("av") is None, reason="the video extra is not installed")
@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_a_recording_is_measured_looked_at_and_confirmed(visit, tmp_path, size):
    page = visit(size)
    page.set_input_files("#upload input[type=file]", str(examples()["bubble.mp4"]))
    page.wait_for_selector("#measure")
    page.click("#measure")
    for field in ("film-rate", "film-scale"):
        page.wait_for_selector(f"#{field} :text('missing')")
    assert page.locator(".toast-body").count() == 0
    page.fill("#film-rate input", "500000")
    page.fill("#film-scale input", "4")
    page.press("#film-scale input", "Enter")
    page.wait_for_selector("#film-frame img")
    page.wait_for_selector("#film-plot .js-plotly-plot")
    page.locator("#film-number input[type=range]").evaluate(
        "one => { one.value = 40; one.dispatchEvent(new Event('input', {bubbles: true})); }"
    )
    page.wait_for_selector("#film-frame :text('Frame 40 of 80')")
    page.click("#film-toggle")
    page.wait_for_selector("#film-frame .excluded")
    page.wait_for_selector("#film-toggle:has-text('Bring')")
    assert page.input_value("#film-excluded input") == "40"
    page.fill("#film-excluded input", "40, 99")
    page.wait_for_selector("#film-excluded :text('1 to 80')")
    page.fill("#film-excluded input", "40-45")
    page.wait_for_selector("#film-told :text('70 of 80')")
    assert fits_the_screen(page)
    page.fill("#film-scale input", "5")
    page.click("#confirm")
    page.wait_for_selector("#film-scale :text('measure again')")
    page.fill("#film-scale input", "4")
    page.click("#confirm")
    page.wait_for_selector("#found tbody tr")
    page.click("#infer-now")
    answered(page, 1)
    (record,) = json.loads((take(page, tmp_path) / "result.json").read_text())["curves"]
    assert "excluded by hand: frames 40-45" in record["notes"]


@pytest.mark.slow
def test_two_visitors_do_not_see_each_other_and_need_no_mouse(visit, tmp_path):
    pages, files = (visit(WIDE), visit(PHONE)), [_one_shot(tmp_path / f"{name}.csv") for name in ("mine", "yours")]
    for page, file in zip(pages, files, strict=True):
        drop(page, file)
        page.wait_for_selector("#infer-now:enabled")
        page.focus("#infer-now")
        page.keyboard.press("Enter")
    for page, file in zip(pages, files, strict=True):
        answered(page, 1)
        names = page.locator("#answers .curves tbody td:first-child").all_inner_texts()
        assert names == [file.stem]
    page = pages[0]
    page.focus("#to-check")
    page.keyboard.press("Enter")
    page.wait_for_selector("#facts article")
    page.locator("#slider-shear_modulus input[type=range]").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#trial :text('RMSE')")
    unnamed = page.evaluate(  # every field has a name
        "[...document.querySelectorAll('input:not([type=file]), button, select')]"
        ".filter(one => one.offsetParent && !(one.labels?.length || one.getAttribute('aria-label') || one.title"
        " || one.innerText.trim())).map(one => one.outerHTML)"
    )
    assert unnamed == []


@pytest.mark.parametrize("size", [(2560, 1440), (1920, 1080), PHONE], ids=["wall", "small wall", "phone"])
def test_the_page_for_the_wall(wall, browser, tmp_path, size):
    """Everything is on the screen and large, for long names, too; a new page is seen without a hand."""
    address, folder = wall
    page = browser.new_page()
    page.set_viewport_size({"width": size[0], "height": size[1]})
    foreign = []
    page.on("request", lambda request: _foreign(request.url, address) and foreign.append(request.url))
    curve = read_curves(examples()["soft_gel.csv"])[0]
    for name, message in (("soft_gel[1]", ""), ("2026-03-04 agarose 0.5 % " + "x" * 80, "R_max is doubtful: " * 12)):
        doubtful = replace(ANSWER, checks=Checks("check_input", messages(message, code="check_input.test")))
        answers = [doubtful if message else ANSWER] * 4
        curves = [replace(curve, meta={"name": f"{name} {k}", "group": name, "source": name}) for k in range(4)]
        shown = result(list(zip(curves, answers, strict=True)), "x")
        shown.groups[0].population = MATERIAL
        wall_page.write(folder / wall_page.PAGE, shown, 3, curves[3], answers[3])
        page.goto(f"{address}live") if not message else page.wait_for_selector(".said")
        seen = page.evaluate(WALL)
        assert seen["beyond"] == []
        assert seen["across"] == []
        assert seen["smallest"] >= (14 if size == PHONE else 0.02 * size[0])  # from three metres
        assert page.locator("footer :text('still wanted')").is_visible()
    page.close()
    assert foreign == []


def _one_shot(path, scale=1.0):
    curve = read_curves(examples()["soft_gel.csv"])[0]
    write_csv(path, replace(curve, radius=scale * curve.radius))
    return path
