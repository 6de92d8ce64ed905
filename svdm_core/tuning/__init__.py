"""Finding parameters on scenes with ground truth."""
