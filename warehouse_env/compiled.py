"""The compiled kernels kept on disk must be those of the source.

Numba keeps a kernel beside the file that defines it and compiles it anew when that file changes, but not when another
one does whose functions it has taken in. So one changed file makes all of them stale. A folder of the user's choice
(NUMBA_CACHE_DIR) may serve several versions at a time, even several machines, so each has a folder of its own in it.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

_STAMP = "kernels.stamp"


def drop_stale_kernels(package: Path) -> None:
    """Forget all kept kernels of a package whose source is another than when this was last called; a millisecond.

    Files that were only touched, or lie on a disk that other machines see with other times, are the same source.
    """
    with contextlib.suppress(OSError):  # a folder that cannot be written has no kernels of ours in it
        files = sorted(package.rglob("*.py"))
        text = "".join(f"{file.relative_to(package)} {(s := file.stat()).st_mtime_ns} {s.st_size}\n" for file in files)
        times, stamp = hashlib.sha256(text.encode()).hexdigest(), package / "__pycache__" / _STAMP
        before = stamp.read_text(encoding="utf-8").split() if stamp.is_file() else []
        if before[:1] == [times]:
            return
        source = source_digest(package)
        if before[1:] != [source]:
            for index in package.rglob("__pycache__/*.nbi"):
                index.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(f"{times}\n{source}\n", encoding="utf-8")


def source_digest(package: Path) -> str:
    """Return a digest of the content of a package's modules."""
    digest = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        digest.update(f"{file.relative_to(package).as_posix()}\n".encode() + file.read_bytes())
    return digest.hexdigest()
