"""The command line, for ``python -m jotlight``."""

from jotlight.cli.entry import main

if __name__ == "__main__":
    main()
