"""zarr folders: arrays of packed bits, of booleans, or of counts."""
