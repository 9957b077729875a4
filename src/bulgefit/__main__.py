"""python -m bulgefit"""

import sys

from bulgefit.cli.main import main

sys.exit(main())
