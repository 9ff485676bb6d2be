"""`python -m flexmbd`, the same as the command `flexmbd`."""

import sys

from flexmbd.cli import main

sys.exit(main())
