"""`play_bag`: a recording published as it was taken."""
