"""What all kernels are made with: where they are cached, vectors, the types of their arrays."""
