"""The node for minutes or hours among hostile messages and requests: `python -m svdm_ros.soak`."""
