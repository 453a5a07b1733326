"""The step on a GPU: the kernels of the CPU, compiled for CUDA, and the host's part of each step."""
