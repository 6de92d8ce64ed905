"""This process: its threads, its memory, its processors, Ctrl-C."""
