"""`python -m fabcraft` is `fabcraft`."""

import sys

from fabcraft.cli import main

if __name__ == "__main__":
    sys.exit(main())
