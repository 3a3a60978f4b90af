"""Stacks of images in PNG and TIFF files.

- `captures`, `maps`: counts, and maps of jots. `writing`: counts and readings as files.
- `tiff_layout`, `kept_directories`: what the pages of a TIFF file mean, and where they are.
- `tiff_directories`, `tiff_segments`, `png_chunks`: checks before a library decodes a file.
- `png_notes`: how jotlight computed an image.
"""
