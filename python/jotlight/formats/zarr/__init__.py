"""zarr folders: arrays of packed bits, of booleans, or of counts.

- `captures`: arrays as captures. `store`: their files, with limits. `writing`: new folders.
- `codecs`, `packbits`, `shards`: how chunks are stored.
- `manifest`: the files that a folder must contain.
"""
