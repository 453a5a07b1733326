"""Records of an episode: metrics, recordings, the wait-for graph."""
