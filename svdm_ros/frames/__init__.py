"""A pair of messages to results, in any message library."""
