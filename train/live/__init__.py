"""A simulation behind a page in the browser: a world that can be changed, its thread, what it sends, a server."""
