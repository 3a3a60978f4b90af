"""HDF5 files, and the HDF5 library in this process or in a child process."""
