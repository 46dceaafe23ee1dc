"""``python -m benchmarks.friction``."""

import sys

from benchmarks.friction.run import main

if __name__ == '__main__':
    sys.exit(main())
