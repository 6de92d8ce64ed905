"""The node: its parameters, its topics, its thread, and what it tells of itself."""
