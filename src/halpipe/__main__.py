"""``python -m halpipe``, and the command ``halpipe``."""

import sys


def main() -> None:
    """Run the command line; see `halpipe.cli.main`."""
    try:
        from halpipe.cli import main as run
    except KeyboardInterrupt:
        sys.exit(130)
    run()


if __name__ == "__main__":  # worker processes import this module too
    main()
