"""`images_to_bag`: image files of a stereo pair to a recording."""
