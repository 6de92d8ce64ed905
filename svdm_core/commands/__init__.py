"""The commands of `svdm`, a module each: `add_arguments(parser)` and `run(options)`."""
