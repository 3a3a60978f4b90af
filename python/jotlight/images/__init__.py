"""Images: reading, writing, and tone curves for a display.

- `io`: read photographs, write estimates.
- `sets`: read many images from a folder or an array.
- `color`: color to gray.
- `tone`: curves from intensities to a display, and the white of an image that states none.
  `clipping`: the pixels of a film that are brighter than its white.
- `saving`: images and films of any kind of number in files.
- `image_stack`: several named images in one file.
- `video`: one image per window of frames. `gif` and `mp4`: its formats for display.
- `exr`, `png`, `tiff`: these formats.
"""
