"""How good a matcher is on scenes with ground truth: data sets, figures, comparisons with OpenCV and with the paper."""
