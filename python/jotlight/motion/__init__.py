"""Motion: alignment and merging of the bits of moving scenes."""
