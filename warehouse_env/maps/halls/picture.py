"""Grey pictures: PGM of bytes (P5) is read and written here; PNG, BMP and PGM of text (P2) need Pillow.

PGM: Poskanzer, "pgm(5)", Netpbm; with at most 255 levels.
"""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warehouse_env.errors import MapError, shown
from warehouse_env.files import complete_file, read_bytes

SUFFIXES = (".pgm", ".png", ".bmp")
MOST_PIXELS = 32_000_000
_LARGEST_FILE = 256_000_000  # [bytes]
_GAP = rb"(?:\s|#[^\n]*\n)+"
_HEADER = re.compile(_GAP.join([rb"P5", *3 * [rb"(\d{1,9})"]]) + rb"(?:#[^\n]*\n)?\s")


class Picture(NamedTuple):
    """Levels uint8[H, W] from 0 (black) to 255, and opaque bool[H, W], or None if all are."""

    grey: NDArray[np.uint8]
    opaque: NDArray[np.bool_] | None = None


def read_picture(path: Path) -> Picture:
    """Return the picture in a file; MapError in one sentence if it is none or too large."""
    if path.suffix.lower() not in SUFFIXES:
        raise MapError(f"{path} is no picture of a map; known are {', '.join(SUFFIXES)}")
    content = read_bytes(path, "picture", _LARGEST_FILE)
    return _by_pillow(path, content) if content[:2] == b"P2" or content[:1] != b"P" else _pgm(path, content)


def write_pgm(grey: NDArray[np.uint8], path: Path) -> None:
    """Write uint8[H, W] as a PGM, whole or not at all."""
    rows, columns = grey.shape
    with complete_file(path) as part:
        part.write_bytes(b"P5\n%d %d\n255\n" % (columns, rows) + np.ascontiguousarray(grey).tobytes())


def _check_size(path: Path, columns: int, rows: int) -> None:
    if not 1 <= rows * columns <= MOST_PIXELS:
        raise MapError(f"{path} has {columns:,} x {rows:,} pixels; make it coarser, to at most {MOST_PIXELS:,} in all")


def _pgm(path: Path, content: bytes) -> Picture:
    header = _HEADER.match(content)
    if header is None:
        raise MapError(f"{path} is no PGM: it must begin with P5 or P2, width, height and the highest level")
    columns, rows, highest = map(int, header.groups())
    _check_size(path, columns, rows)
    if not 1 <= highest <= 255:
        raise MapError(f"{path} has levels up to {highest}; a map has at most 255, so save it with 8 bits a pixel")
    count = rows * columns
    levels = np.frombuffer(content, np.uint8, min(count, len(content) - header.end()), header.end())
    if len(levels) < count:
        raise MapError(f"{path} holds {len(levels):,} of its {count:,} pixels; copy it again")
    if levels.max() > highest:
        raise MapError(f"{path} holds level {levels.max()}, above its highest, {highest}")
    grey = levels.reshape(rows, columns)
    return Picture(grey if highest == 255 else np.rint(grey * (255.0 / highest)).astype(np.uint8))


def _by_pillow(path: Path, content: bytes) -> Picture:
    try:
        from PIL import Image
    except ImportError:
        raise MapError(f"{path} needs Pillow: pip install pillow, or save the picture as a binary PGM (P5)") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about large pictures, whose size is checked here
            with Image.open(io.BytesIO(content), formats=("PNG", "BMP", "PPM")) as image:
                _check_size(path, *image.size)
                return _grey(image)
    except MapError:
        raise
    except Exception as error:  # whatever a damaged picture makes a decoder raise
        raise MapError(f"{path} is no picture that can be read: {shown(str(error))[1:-1]}") from None


def _grey(image: Any) -> Picture:
    """Return the mean of the colours, as map_server does, and where a picture is opaque."""
    if image.mode.startswith("I;16") or image.mode == "I":
        wide = np.asarray(image).astype(np.int64)
        return Picture((np.clip(wide, 0, 65535) // 257).astype(np.uint8))
    bands = np.asarray(image.convert("RGBA"))
    grey = np.rint(bands[..., :3].mean(axis=2)).astype(np.uint8)
    opaque = bands[..., 3] == 255
    return Picture(grey, None if opaque.all() else opaque)
