"""Many robots: the wait-for graph, shield, right of way, recovery and live replanning."""
