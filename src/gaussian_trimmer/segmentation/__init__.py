"""Virtual View Segmentation (VVS), the second stage: labels corrected in 3D, and a mask of the object in each view."""
