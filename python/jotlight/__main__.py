"""``python -m jotlight``: the command line."""

from jotlight.cli.app import main

if __name__ == "__main__":
    main()
