"""The commands of `svdm`, one module each: `add_arguments(parser)`, and `run(options)` that returns the exit code."""
