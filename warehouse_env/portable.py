"""Objects that can be pickled and deep-copied at any moment, and go on elsewhere as if nothing had happened."""

from __future__ import annotations

from typing import Any, ClassVar


class Portable:
    """Leaves behind what belongs to one object in one process: views of arrays, caches, connections, windows.

    A subclass makes such attributes in `_bind` alone, which its constructor calls and every copy calls again, and
    names them in `bound`. All else goes along as it is.
    """

    bound: ClassVar[tuple[str, ...]]

    def _bind(self) -> None:
        """Make the attributes named in `bound` from all others."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        """Return all attributes but the bound ones."""
        return {name: value for name, value in vars(self).items() if name not in self.bound}

    def __setstate__(self, attributes: dict[str, Any]) -> None:
        """Take the attributes of another and make the bound ones anew."""
        vars(self).update(attributes)
        self._bind()
