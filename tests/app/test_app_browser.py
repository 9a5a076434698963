"""The browser app in a real Chromium: journeys of visitors, wide and narrow, without a request to elsewhere."""

import json
import zipfile

import pytest
from conftest import until

from cavirheo.app.session import VisitorLimits

FITS = "document.documentElement.scrollWidth <= innerWidth"
WIDE, PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
INPUT = "#upload input[type=file]"


@pytest.fixture(scope="module")
def served():
    from cavirheo.app.server import running_server  # gradio takes seconds, which collecting tests need not wait for

    with running_server(limits=VisitorLimits(file_mb=1.0)) as (address, visitors):
        yield address, visitors


@pytest.fixture(scope="module")
def browser(chromium):
    context = chromium.new_context()  # of all pages: scripts are loaded once
    yield context
    context.close()


@pytest.fixture
def visit(served, browser):
    """A new visitor's page of this size; at the end: no request went elsewhere, no script failed."""
    pages, elsewhere, failed = [], [], []

    def one(size=WIDE):
        page = browser.new_page()
        pages.append(page)
        page.set_viewport_size(size)
        page.set_default_timeout(60_000)
        page.on("request", lambda request: elsewhere.append(request.url))
        page.on("websocket", lambda socket: elsewhere.append(socket.url))
        page.on("pageerror", lambda error: failed.append(str(error)))
        page.goto(served[0])
        page.wait_for_selector(INPUT, state="attached")
        return page

    yield one
    for page in pages:
        page.close()
    assert [url for url in elsewhere if not url.startswith((served[0], "data:", "blob:"))] == []
    assert failed == []


def slide(page, where, share):
    move = "(one, share) => { one.value = share * one.max; one.dispatchEvent(new Event('input', {bubbles: true})); }"
    page.locator(f"{where} input[type=range]").evaluate(move, share)


def drag(page, share):
    """Move its slider, and wait until the simulation is drawn."""
    line = "document.querySelector('#check-plot path.what-if')?.getAttribute('d') || ''"
    before = page.evaluate(line)
    slide(page, "#slider-viscosity", share)
    page.wait_for_function(f"before => ({line}) !== before", arg=before)


def layers(page):
    paths = "document.querySelectorAll('#check-plot path')"
    return set(page.evaluate(f"[...{paths}].map(one => one.getAttribute('class'))"))


def answered(page, shots):
    rows = "document.querySelectorAll('#answers .curves tbody tr')"
    page.wait_for_function(f"{rows}.length === {shots} && !document.querySelector('#answers .busy')", timeout=180_000)
    page.wait_for_selector("#steps [role=tab]:enabled:has-text('4 Check')")


def example(page):
    page.get_by_role("button", name="soft_gel.csv").click()
    page.wait_for_selector("#overview svg")
    assert page.locator("#shots-table tbody tr").count() == 5


def take(page, folder):
    """The zip of the last step, unpacked."""
    page.get_by_role("tab", name="5 Export").click()
    with page.expect_download() as download:
        page.click("#make-zip")
    download.value.save_as(folder / "result.zip")
    with zipfile.ZipFile(folder / "result.zip") as archive:
        archive.extractall(folder)
    return folder / "cavirheo-result"


def test_five_steps_on_a_shipped_example(visit, tmp_path):
    page = visit()
    example(page)
    page.get_by_role("tab", name="2 Prepare").click()
    page.wait_for_selector("#prepared-curve svg.picture")
    for k in (2, 4, 5):
        page.get_by_label(f"soft_gel[{k}]", exact=True).uncheck()
    page.fill("#density input", "1050")
    page.press("#density input", "Tab")
    page.wait_for_selector("#prepared-curve li")
    page.get_by_role("tab", name="3 Infer").click()
    page.get_by_label("neo-Hookean Kelvin-Voigt").check()
    page.click("#infer")
    answered(page, 2)
    page.get_by_role("tab", name="4 Check").click()
    page.wait_for_selector("#check-plot svg")
    page.wait_for_selector("#facts article")
    assert "what-if" not in layers(page)
    drag(page, 0.2)
    first = page.inner_text("#trial")
    drag(page, 0.6)
    assert page.inner_text("#trial") != first
    assert {"what-if", "measured", "simulated", "draws", "residual"} <= layers(page)
    assert page.evaluate(FITS)
    assert not page.evaluate(  # every field has a name
        "[...document.querySelectorAll('input:not([type=file]), button, select')]"
        ".filter(one => one.offsetParent && !(one.labels?.length || one.getAttribute('aria-label') || one.title"
        " || one.innerText.trim())).map(one => one.outerHTML)"
    )

    folder = take(page, tmp_path)
    curves = json.loads((folder / "result.json").read_text())["curves"]
    assert [(one["name"], one["medium"]["density"]) for one in curves] == [("soft_gel[1]", 1050), ("soft_gel[3]", 1050)]
    assert (folder / "report.html").exists()


def test_nothing_is_kept_of_a_page_that_was_left(served, visit, monkeypatch):
    _, visitors = served
    kept = visitors.on_forget.__self__.blocks.state_holder.session_data  # gradio's, with figures
    before = {*kept}
    page = visit()
    example(page)
    (mine,), link = {*kept} - before, page.url.partition("session=")[2]
    monkeypatch.setattr(visitors, "limits", VisitorLimits(absent_seconds=0.05))
    page.close()
    until(lambda: visitors.forget_absent() or mine not in kept)
    assert visitors.reopen("another page", link) is None
