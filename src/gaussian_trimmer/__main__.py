"""`python -m gaussian_trimmer` is the command line."""

import sys

from gaussian_trimmer.cli import main

sys.exit(main())
