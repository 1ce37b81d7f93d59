"""``python -m limen.cli`` is the console command ``limen``."""

from limen.cli.app import main

main()
