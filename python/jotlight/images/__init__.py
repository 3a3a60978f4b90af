"""Images: reading, writing, and tone curves for a display.

- `io`: read photographs, write estimates.
- `sets`: read many images from a folder or an array.
- `color`: color to gray.
- `tone`: curves from intensities to a display.
- `image_stack`: several named images in one file.
- `video`: one image per window of frames.
- `exr`: the OpenEXR format.
"""
