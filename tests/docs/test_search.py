"""Words that people look for lead to the page that answers them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.render.browser import CHROMIUM, needs_chromium, until

ANSWERS = {
    "reward function": "how_to/reward.html",
    "how many robots": "how_to/map.html",
    "jupyter": "index.html",
    "near miss": "glossary.html",
    "free flow": "glossary.html",
}


@pytest.mark.nightly
@needs_chromium
def test_the_first_result_is_the_page_that_answers(html: Path) -> None:
    api = pytest.importorskip("playwright.sync_api")
    found = {}
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        for words in ANSWERS:
            page.goto(f"{(html / 'search.html').as_uri()}?q={words.replace(' ', '+')}")
            until(page, "document.querySelector('#search-results li > a') !== null")
            page.wait_for_timeout(500)  # the titles stand at once, texts are read for more
            found[words] = page.get_attribute("#search-results li > a", "href").partition("#")[0]
        browser.close()
    assert found == ANSWERS
