"""``python -m halpipe``."""

from halpipe.cli import main

main()
