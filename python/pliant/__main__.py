"""`python -m pliant` is the command `pliant`."""

import sys

from . import main

sys.exit(main())
