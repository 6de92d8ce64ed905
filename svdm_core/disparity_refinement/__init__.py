"""Stage 4: what happens to the map of the winners."""
