"""``python -m benchmarks.slip``."""

import sys

from benchmarks.slip.run import main

if __name__ == '__main__':
    sys.exit(main())
