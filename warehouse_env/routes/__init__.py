"""From planned cells to lines that a body can drive, and the book that keeps them (book.py)."""
