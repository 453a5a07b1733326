"""The commands of `warehouse` that are no study: a dataclass of options each."""
