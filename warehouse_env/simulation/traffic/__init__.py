"""Many robots: who waits for whom, the protective field, right of way, making room, live routes."""
