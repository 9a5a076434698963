"""The report of several curves in a real Chromium: sorted, opened by links, no outside request."""

import pytest
from answers import answer, bubble, unanswered, written

SIZES = {"wide": {"width": 1440, "height": 900}, "phone": {"width": 390, "height": 844}}
EVIL = "</script><img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """Of seven curves, of which one has no answer and one is to be checked."""
    folder = tmp_path_factory.mktemp("report")
    moduli = enumerate([5e3, 9e3, 1e3, 7e3, 3e3])
    pairs = [(bubble(f"shot[{k}]", f"g{k % 2}", f"g{k % 2}.csv"), answer(bubble(), G)) for k, G in moduli]
    doubtful = answer(bubble(), 4e3, verdict="check_input", message="the frame rate is odd: give --fps-of-it")
    pairs += [(bubble(f"shot[5] {EVIL}"), doubtful), (bubble("shot[6]"), unanswered("cell 3 is empty"))]
    written(folder, pairs)
    return (folder / "report.html").as_uri()


@pytest.fixture(params=SIZES)
def page(request, chromium, report):
    made, asked, failed = chromium.new_page(viewport=SIZES[request.param]), [], []
    made.on("request", lambda one: asked.append(one.url))
    made.on("pageerror", lambda error: failed.append(str(error)))
    made.on("console", lambda said: failed.append(said.text) if said.type == "error" else None)
    made.goto(report)
    yield made
    made.close()
    assert {url.split("#")[0] for url in asked} == {report}
    assert failed == []


def test_rows_are_sorted_by_each_column_and_those_without_a_number_come_last(page):
    def rows():
        names = page.locator("table.curves a").all_inner_texts()
        return [int(name[name.index("[") + 1]) for name in names]

    head = page.locator("table.curves th").nth(3)  # G
    head.focus()
    page.keyboard.press("Enter")
    assert rows() == [2, 4, 5, 0, 3, 1, 6]
    assert head.get_attribute("aria-sort") == "ascending"
    assert "the frame rate is odd" in page.locator("#curve-5").inner_text()  # a doubt stands below its picture
    page.keyboard.press("Enter")
    assert rows() == [1, 3, 0, 5, 4, 2, 6]
    page.locator("table.curves th").nth(0).click()
    assert rows() == [0, 1, 2, 3, 4, 5, 6]


def test_a_link_leads_to_the_picture_of_its_curve_and_all_can_be_read(page):
    link = page.get_by_role("link", name="[3]")
    link.focus()
    page.keyboard.press("Enter")
    picture = page.locator("#curve-3 svg")
    assert picture.locator("path.measured").count() == picture.locator("path.simulated").count() == 1
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert page.evaluate("getComputedStyle(document.querySelector('.option')).whiteSpace") == "nowrap"
    assert page.locator("#curve-6 path.measured").is_visible()  # one without an answer has its measured points
    page.emulate_media(media="print")
    assert page.locator("article:visible").count() == 7
