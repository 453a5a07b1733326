"""One step of time: scalar kernels, the batched step, and Simulator, the one stateful object around them."""
