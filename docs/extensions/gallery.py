"""`make gallery`: make the moving pictures of docs/gallery.md from its own code; film pages in a Chromium."""

from __future__ import annotations

import io
import os
import re
import shlex
import shutil
import tempfile
from pathlib import Path

import matplotlib.image
import numpy as np

from train.cli import main as warehouse
from warehouse_env import VideoWriter

DOCS = Path(__file__).parents[1]
PICTURES = DOCS / "gallery"
SIZE = {"width": 900, "height": 600}  # [px] of the filmed window
FRAMES, EVERY, FPS = 18, 3, 6.0  # env steps between two
BEGIN, ROBOT, KEYS = 20.0, 18, "++"  # [s]; the followed robot; the keys pressed first


def blocks(language: str) -> list[str]:
    """Return the code blocks of a language on the page."""
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def film_page(page: Path, path: Path) -> None:
    """Film a replay page, 1.8 times as fast as real."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright, VideoWriter(path, FPS) as video:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        shown = browser.new_page(viewport=SIZE)
        shown.goto(f"{page.as_uri()}#robot={ROBOT}&t={BEGIN}")
        while not shown.evaluate("window.replay !== undefined"):
            shown.wait_for_timeout(50)
        for key in KEYS:
            shown.keyboard.press(key)
        first = shown.evaluate("replay.frame()")
        for frame in range(FRAMES):
            shown.evaluate(f"replay.seek({first + EVERY * frame})")
            shown.wait_for_timeout(100)  # until it is drawn
            picture = matplotlib.image.imread(io.BytesIO(shown.screenshot()), format="png")
            video.add((picture[..., :3] * 255).round().astype(np.uint8))
        browser.close()


def main() -> None:
    """Run the page's code in a temporary folder, film its replay pages, and store the pictures."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for source in blocks("python"):
            exec(compile(source, "gallery.md", "exec"), {})
        for line in "".join(blocks("sh")).splitlines():
            if warehouse(shlex.split(line)[1:]) != 0:
                raise SystemExit(f"failed: {line}")
        for page in Path(folder).glob("*.html"):
            film_page(page, page.with_suffix(".gif"))
        for path in sorted(Path(folder).glob("*.gif")):
            shutil.move(path, PICTURES / path.name)
            print(f"{path.name}: {(PICTURES / path.name).stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
