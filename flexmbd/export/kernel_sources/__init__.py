"""LLVM IR of kernels, written as C99; it knows nothing of machines."""
