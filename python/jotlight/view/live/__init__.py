"""Live captures: files, folders, and standard input that grow while they are viewed."""
