"""The compiled kernels kept on disk must be those of the source.

Numba keeps a kernel beside the file that defines it and compiles it anew when that file changes, but not when another
one does whose functions it has taken in. So one changed file makes all of them stale.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

_STAMP = "kernels.stamp"


def drop_stale_kernels(package: Path) -> None:
    """Forget all kept kernels of a package whose source is another than when this was last called; a millisecond."""
    with contextlib.suppress(OSError):  # a folder that cannot be written has no kernels of ours in it
        files = sorted(package.rglob("*.py"))
        text = "".join(f"{file.relative_to(package)} {(s := file.stat()).st_mtime_ns} {s.st_size}\n" for file in files)
        now, stamp = hashlib.sha256(text.encode()).hexdigest(), package / "__pycache__" / _STAMP
        if stamp.is_file() and stamp.read_text(encoding="utf-8") == now:
            return
        for index in package.rglob("__pycache__/*.nbi"):
            index.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(now, encoding="utf-8")
