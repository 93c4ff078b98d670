"""``python -m hillsphere``: the same as the command ``hillsphere``."""

from hillsphere.cli import main

if __name__ == "__main__":
    main()
