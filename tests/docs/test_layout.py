"""On windows of any width, nothing of a page is cut off, and no page is wider than its window."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.render.browser import CHROMIUM, needs_chromium

WIDTHS = (390, 768, 1024, 1200, 1280, 1440, 1600)  # [px]

# What sticks out of the window on the right, but for what lies in a box that scrolls and does not stick out itself.
OUTSIDE = """() => {
  const wide = (one) => one.getBoundingClientRect().right > innerWidth + 0.5;
  const scrolls = (one) => ["auto", "scroll"].includes(getComputedStyle(one).overflowX);
  const reached = (one) => {
    while ((one = one.parentElement) && !one.matches("article")) if (scrolls(one) && !wide(one)) return true;
    return false;
  };
  const outside = [...document.querySelectorAll("article *")].filter((one) => wide(one) && !reached(one));
  return [document.documentElement.scrollWidth, outside.map((one) => one.textContent.trim().slice(0, 60))];
}"""


@needs_chromium
def test_pages_fit_their_window(html: Path) -> None:
    api = pytest.importorskip("playwright.sync_api")
    faults = []
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        for path in sorted(html.rglob("*.html")):
            page.goto(path.as_uri())
            for width in WIDTHS:
                page.set_viewport_size({"width": width, "height": 900})
                whole, outside = page.evaluate(OUTSIDE)
                if whole > width or outside:
                    faults.append(f"{path.relative_to(html)} at {width} px: {whole} px wide, {outside[:3]}")
        browser.close()
    assert not faults, "\n".join(faults)


@needs_chromium
def test_on_a_phone_options_say_what_they_mean(html: Path) -> None:
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 390, "height": 900})
        page.goto((html / "reference" / "options.html").as_uri())
        meaning = page.get_by_role("cell", name="contact checks per physics step").bounding_box()
        browser.close()
    assert meaning is not None
    assert meaning["x"] + meaning["width"] <= 390
