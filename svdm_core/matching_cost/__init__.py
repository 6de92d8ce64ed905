"""Stage 1: what two pixels cost."""
