"""Stage 2: whose costs are added up."""
