"""The tuner: a page in the browser on which parameters are moved and the disparity is seen to change."""
