"""Pages have the numbers that `make validate` measured, and no others between their markers."""

from __future__ import annotations

import pytest
from conftest import ROOT

from validation import pages

RESULTS = pages.read_results()


@pytest.mark.parametrize("page", [str(path.relative_to(ROOT)) for path in pages.marked_pages()])
def test_a_page_has_the_numbers_of_the_results(page):
    text = (ROOT / page).read_text("utf-8")
    assert text == pages.filled(text, RESULTS), "run python -m validation --fill"


@pytest.mark.repository
def test_the_page_of_claims_is_that_of_the_results():
    assert pages.PAGE.read_text("utf-8") == pages.page(RESULTS), "run python -m validation --page"
    assert len(RESULTS) == len(pages.CLAIMS) == 10


def test_another_number_is_filled_and_an_unknown_one_is_refused():
    results = {"solver": {"numbers": {"error": {"value": 2.1e-3, "standard_error": 4e-4, "n": 7}}}}
    text = "<!--solver.error:.1e-->0<!--/--> ± <!--solver.error:se.0e-->0<!--/-->, <!--solver.error:n-->0<!--/-->"
    words = [part.partition("<")[0] for part in pages.filled(text, results).split("-->")[1::2]]
    assert words == ["2.1e-3", "4e-4", "7"]
    with pytest.raises(ValueError, match="python -m validation solver"):
        pages.filled("<!--solver.time:.1f-->0<!--/-->", results)


@pytest.mark.repository
@pytest.mark.parametrize("page", ["README.md", "docs/how-far.md", "docs/validation.md"])
def test_headline_numbers_are_marked(page):
    assert pages.MARKED.search((ROOT / page).read_text("utf-8"))
    assert not pages.AT_BEGINNING.search((ROOT / page).read_text("utf-8"))
