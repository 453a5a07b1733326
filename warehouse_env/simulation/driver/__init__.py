"""One robot on its line: the path follower, and the manoeuvres where the line cannot be followed."""
