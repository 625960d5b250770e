"""Normalisation, activation and padding as one operation: Triton kernels on CUDA, a plain reference elsewhere."""
