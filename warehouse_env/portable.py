"""Objects that can be pickled and deep-copied at any moment and continue from there."""

from typing import Any, ClassVar


class Portable:
    """Base of objects whose copies leave out process-local state: views of arrays and caches.

    A subclass creates such attributes only in `_bind`, which its constructor and every copy call, and names them in
    `bound`. All other attributes are copied.
    """

    bound: ClassVar[tuple[str, ...]]

    def _bind(self) -> None:
        """Create the attributes named in `bound` from the others."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        """Return all attributes but the bound ones."""
        return {name: value for name, value in vars(self).items() if name not in self.bound}

    def __setstate__(self, attributes: dict[str, Any]) -> None:
        """Take the attributes of the original and create the bound ones again."""
        vars(self).update(attributes)
        self._bind()
