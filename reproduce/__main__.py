"""``python -m reproduce`` is the command ``reproduce``."""

import sys

from reproduce.cli import main

sys.exit(main())
