"""`python -m coopsim` is the same as `coopsim`."""

import sys

from coopsim.cli import main

sys.exit(main())
