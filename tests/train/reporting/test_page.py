"""Pages: one file that needs no other, with text that cannot break out of its place."""

from __future__ import annotations

import re
from pathlib import Path

from train.reporting.page import Link, Page, PagePart, Shown, made_by
from train.reporting.report import Table


def test_a_page_holds_all_that_it_is_given(tmp_path: Path) -> None:
    table = Table(
        "T", ("name", "figure", "verdict"), (("a<b", "1.5", "better"), ("c", "-2", "may be chance")), "a note"
    )
    part = PagePart(
        "Part", "some *text*", [Shown("<svg></svg>", "a `caption`")], [table], [Link("a b.html", "L", "why")]
    )
    Page("A & B", "sub", ["**bold** <i>"], [part, PagePart(facts=made_by(Seeds="1"))]).write(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    for text in (
        "<title>A &amp; B</title>", "<p><b>bold</b> &lt;i&gt;</p>", "<p>some <i>text</i></p>", "<svg></svg>",
        "a <code>caption</code>", "<td>a&lt;b</td>", '<td class="number">-2</td>', '<a href="a%20b.html">', "a note",
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:",
        '<span class="better">better</span>', "<dt>Seeds</dt><dd>1</dd>", "prefers-color-scheme: dark",
    ):  # fmt: skip
        assert text in page, text
    assert not re.search(r'src=|href="(?!a%20b)|url\(|@import|<script', page)
