"""Recordings of any kind, read."""
