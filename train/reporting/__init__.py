"""What is written down: rows of results, and the tables made of them."""
