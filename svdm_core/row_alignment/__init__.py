"""Row alignment: rectified pairs whose rows are some tenths of a pixel apart are measured and resampled."""
