"""Time and accuracy of the matcher beside those of OpenCV."""
