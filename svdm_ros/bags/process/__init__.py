"""`process_bag`: the disparity of every pair of a recording."""
