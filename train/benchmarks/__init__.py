"""The measurements of `warehouse bench`: speeds on this machine, and the step beside fixed work."""
