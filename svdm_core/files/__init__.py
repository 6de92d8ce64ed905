"""Files read and written: images, PFM, disparities, pictures."""
