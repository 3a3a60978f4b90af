"""HDF5 files, and the HDF5 library in this process or in a child process.

- `captures`: data sets of bits and counts as captures. `chunks`: the compressed chunks of bits.
- `library`: the calls of the HDF5 library. `isolated`: the same calls in a child process, which
  runs `child`.
"""
