"""``python -m verification.checker DIR``: re-check every certificate of a folder."""

import sys

from verification.checker.folder import main

sys.exit(main(sys.argv[1:]))
