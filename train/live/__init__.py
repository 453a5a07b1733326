"""A simulation behind a page in the browser: a world that can be replaced, its thread, what it sends, a server."""
