"""The node from outside, for demo and benchmark: its process, a camera, and a session that listens to it."""
