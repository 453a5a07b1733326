"""Records of an episode: metrics, recordings, the count of deadlocks."""
