"""Parts of files, at paths and URLs, and also from untrusted sources.

In reading order:

- ``file_systems``, ``remote_files``: files at URLs. ``file_reader``: any part of a file.
  ``file_lists``: the files of a folder. ``file_sequence``: their frames, and what they lack.
- ``magic``, ``limits``, ``safe_paths``: checks of files from untrusted sources.
- ``checksums``: changes of a file since jotlight wrote it.
- ``locks``: protection of what threads share.
"""
