"""How fast the node is. `python -m svdm_ros.benchmark` measures it."""
