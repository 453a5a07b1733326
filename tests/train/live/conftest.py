"""The browser of the tests of pages, for the live page as well."""

from tests.render.conftest import browser

__all__ = ["browser"]
