"""Cameras: their matrices, the files that hold them, and what turns a disparity into a depth."""
