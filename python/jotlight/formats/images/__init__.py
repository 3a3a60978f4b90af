"""Stacks of images in PNG and TIFF files."""
