"""On windows of any width no page is wider than its window; on a desk nothing has to be scrolled sideways."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.render.browser import CHROMIUM, needs_chromium

WIDTHS = (390, 768, 1024, 1200, 1280, 1440, 1600)  # [px]
DESK = 1024  # [px] from which tables, code and formulas are seen as a whole

# How wide the page is; what sticks out of the window on the right, but for what lies in a box that scrolls and does not
# stick out itself; and the boxes that hold more than they show.
OUTSIDE = """() => {
  const wide = (one) => one.getBoundingClientRect().right > innerWidth + 0.5;
  const scrolls = (one) => ["auto", "scroll"].includes(getComputedStyle(one).overflowX);
  const reached = (one) => {
    while ((one = one.parentElement) && !one.matches("article")) if (scrolls(one) && !wide(one)) return true;
    return false;
  };
  const outside = [...document.querySelectorAll("article *")].filter((one) => wide(one) && !reached(one));
  const hides = (one) => getComputedStyle(one).overflowX !== "visible" && one.scrollWidth > one.clientWidth + 1;
  const hiding = [...document.querySelectorAll("article *")].filter((one) => one.clientWidth > 30 && hides(one));
  const texts = (found) => found.map((one) => one.textContent.trim().slice(0, 60));
  return [document.documentElement.scrollWidth, texts(outside), texts(hiding)];
}"""


@pytest.mark.nightly
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
                whole, outside, hiding = page.evaluate(OUTSIDE)
                hidden = hiding if width >= DESK else []
                if whole > width or outside or hidden:
                    faults.append(f"{path.relative_to(html)} at {width} px: {whole} px wide, {(outside + hidden)[:3]}")
        browser.close()
    assert not faults, "\n".join(faults)
