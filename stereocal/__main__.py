"""`python -m stereocal`."""

import sys

from stereocal.cli import main

if __name__ == "__main__":
    sys.exit(main())
