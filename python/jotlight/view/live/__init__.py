"""Live captures: files, folders, and standard input that grow while they are viewed.

`options` opens a `capture`. `folder` with its `growing_file`, and `tails` (the ends of files, and
standard input) bring its frames, and `ring` keeps the most recent ones.
"""
