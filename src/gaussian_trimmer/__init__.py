"""GaussianTrimmer: sharp object boundaries for segmentations of 3D Gaussian Splatting scenes."""

__version__ = "0.1.0"
