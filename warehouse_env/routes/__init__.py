"""From planned cells to lines that a body can drive, and their cache (book.py)."""
