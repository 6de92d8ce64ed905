"""Stage 3: which disparity wins."""
